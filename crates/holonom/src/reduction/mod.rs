//! From dependent to independent coordinates: parametrization, recovery, assembly.

pub mod accelerations;
pub mod assembly;
mod body_rows;
mod body_tree;
mod chart;
mod chosen;
mod closing;
mod loops;
mod manifold;
mod null_space;
mod parametrization;
mod partitioning;
mod point;
mod recent;
mod redundant;
mod refinement;
mod relatives;
mod saddle;
mod square;
mod stated_joints;
mod stiffness;
mod structural;
mod tangent_plane;
mod tree;

pub use body_rows::BodyRows;
pub use body_tree::{BodyTree, ByPosition};
pub use chart::Chart;
pub use chosen::{ChosenVelocity, chosen_velocities};
pub use manifold::{Manifold, RecoveryCounters};
pub use parametrization::{Parametrization, Projection, largest_index};
pub use partitioning::{RANK_TOLERANCE, partition, scaled_jacobian};
pub use point::Point;
pub use relatives::{Relatives, Source};
pub use saddle::Saddle;
pub use structural::{disturb, structural_nonzeros, structural_null_space};
pub use tangent_plane::{Choice, choose};
