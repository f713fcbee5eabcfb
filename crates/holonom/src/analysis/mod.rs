//! Uses of a system beside a run: the stiffness spectrum.

mod spectrum;

pub use spectrum::{LARGEST_DENSE, Spectrum, SpectrumError, fastest, spectrum};
