//! One step: a method with a formula.

pub mod ode;
pub mod sdirk;
pub mod stepper;

#[cfg(test)]
mod test_systems;
