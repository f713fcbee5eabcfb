//! Fixed-size mathematics that knows nothing mechanical: the sealed scalar, rotations, functions of
//! time and tables.

mod interpolation;
mod real;
mod time_function;

pub use interpolation::{MonotoneCubic, Spline, TableError};
pub use real::Real;
pub use time_function::TimeFunction;
