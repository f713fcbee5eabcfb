//! Fixed-size mathematics that knows nothing mechanical: the sealed scalar, rotations, functions of
//! time and tables.

mod interpolation;
pub mod matrix;
pub mod planar;
mod real;
mod solids;
pub mod spatial;
mod time_function;
mod trigonometry;
pub mod turn;
pub mod vector;

pub use interpolation::{MonotoneCubic, Spline, TableError};
pub use real::Real;
pub use solids::{OpenEdge, Solid};
pub use time_function::TimeFunction;
