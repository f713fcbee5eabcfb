//! One step: a method with a formula.

pub mod adams;
pub mod explicit_rk;
pub mod ode;
pub mod rosenbrock;
pub mod sdirk;
pub mod stepper;

#[cfg(test)]
mod stepper_tests;
#[cfg(test)]
mod test_systems;
