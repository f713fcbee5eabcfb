//! One step: a method with a formula.

pub mod ode;
