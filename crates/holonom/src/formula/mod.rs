//! Integration formulas as data.

mod adams;
mod dormand_prince;
mod kinks;
mod nystrom;
mod radau;
mod rosenbrock;
mod sdirk;

pub use adams::{
    ADAMS_GAMMA_STAR, ADAMS_MAX_ORDER, AdamsCoefficients, adams_interpolation, adams_polynomials,
};
pub use dormand_prince::{DOP853, DOPRI5, ExplicitRungeKutta};
pub use kinks::error_at_kinks;
pub use nystrom::{Continuation, Nystrom};
pub use radau::{RADAU_IIA_5, Radau};
pub use rosenbrock::{ROSENBROCK_NYSTROM_4, Rosenbrock};
pub use sdirk::{SDIRK4_15, SDIRK4_16, Sdirk};

#[cfg(test)]
mod trees;
