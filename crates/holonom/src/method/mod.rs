//! One step: a method with a formula.

mod acceleration_buffers;
pub mod adams;
mod adams_history;
pub mod attempt;
mod balance;
mod codes;
mod counted;
mod descriptor;
mod equation_form;
mod explicit_form;
pub mod explicit_rk;
mod first_order;
mod inside;
mod iteration;
mod matrices;
mod memory;
pub mod nystrom;
mod nystrom_start;
pub mod ode;
pub mod radau;
mod residuals;
mod response;
pub mod rosenbrock;
pub mod sdirk;
mod segment;
mod simplification;
mod stage_errors;
mod stages;
mod state_space_method;
pub mod stepper;
mod ties;
mod weights;

#[cfg(test)]
mod adams_tests;
#[cfg(test)]
mod stepper_tests;
#[cfg(test)]
mod stiff_tests;
#[cfg(test)]
mod test_systems;

pub use crate::model::Profile;
pub use codes::{
    CODES, Code, CodeInfo, DEFAULT_CODE, Newmark, UnknownMethod, build_form, build_stepper,
};
pub use descriptor::{Descriptor, Iterate};
pub use equation_form::EquationForm;
pub use explicit_form::ExplicitForm;
pub use first_order::FirstOrder;
pub use segment::interpolate;
pub use weights::Weights;
