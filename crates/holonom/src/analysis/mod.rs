//! Uses of a system beside a run: the stiffness spectrum.

mod spectrum;

pub use crate::newton::SpectrumError;
pub use spectrum::{LARGEST_DENSE, Spectrum, fastest, spectrum};
