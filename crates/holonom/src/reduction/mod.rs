//! From dependent to independent coordinates: parametrization, recovery, reduced blocks, assembly.

pub mod assembly;
mod chart;
mod displacements;
mod manifold;
mod null_space;
mod partitioning;
mod reduced_blocks;
mod redundant;
mod saddle;
mod tangent_plane;

pub use chart::{Chart, Parametrization, Projection, structural_nonzeros, structural_null_space};
pub use displacements::BodyRows;
pub use manifold::{Manifold, RecoveryCounters, largest_index};
pub use partitioning::{RANK_TOLERANCE, partition, scaled_jacobian};
pub use reduced_blocks::ReducedBlocks;
pub use saddle::Saddle;
pub use tangent_plane::{Choice, choose};
