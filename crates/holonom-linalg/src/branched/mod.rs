//! Symmetric matrices whose zeros follow the branches of a tree: factored without fill.
//!
//! The inertia matrix of a tree of bodies in joint coordinates couples a coordinate with those on its
//! path to the root and with those that hang on it, and with no other. With children numbered before
//! their parents its Cholesky factor has the same zeros. Sources: Negrut's thesis, section 3.4.3 (Lemmas 2
//! to 4, Algorithm 4); Featherstone, *Int. J. Robotics Research* 24 (2005) 487, who calls it
//! branch-induced sparsity.

mod blocks;
mod dense;
mod factors;
mod operations;
mod plan;

pub use dense::DenseAugmented;
pub use factors::BranchedCholesky;
pub use operations::{Operations, Stages};
pub use plan::{BranchedPlan, CutRows};
