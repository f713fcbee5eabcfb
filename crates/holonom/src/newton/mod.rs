//! Newton's matrix at one point: linearized, factored for a step and solved with.

mod alignment;
mod blocks;
mod chosen;
mod complex;
mod descriptor;
mod descriptor_pattern;
mod differences;
mod extra;
mod forest;
mod general;
mod linearization;
mod matrix;
mod reduced;
mod simplified;
mod solver;
mod sparse;
mod sparse_pattern;
mod spectrum;
mod tangent;
mod units;
mod zeros;

pub use crate::model::{JacobianSource, Representation};
pub use blocks::ReducedBlocks;
pub use chosen::Chosen;
pub use descriptor::{DescriptorMatrix, Unknowns};
pub use holonom_linalg::Complex64;
pub use linearization::Linearization;
pub use matrix::{DescriptorForm, FirstOrderMatrix, Matrix, MatrixOptions};
pub use reduced::ReducedMatrix;
pub use solver::Newton;
pub use sparse::SparseMatrix;
pub use spectrum::{SmallRotations, SpectrumError};
pub use tangent::Tangent;
