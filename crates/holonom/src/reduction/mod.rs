//! From dependent to independent coordinates: parametrization, recovery, assembly.

pub mod assembly;
mod chart;
mod manifold;
mod null_space;
mod partitioning;
mod point;
mod redundant;
mod relatives;
mod saddle;
mod tangent_plane;
mod tree;

pub use chart::{Chart, Parametrization, Projection, structural_nonzeros, structural_null_space};
pub use manifold::{Manifold, RecoveryCounters, largest_index};
pub use partitioning::{RANK_TOLERANCE, partition, scaled_jacobian};
pub use point::Point;
pub use relatives::{BodyRows, Relatives, Source};
pub use saddle::Saddle;
pub use tangent_plane::{Choice, choose};
