//! Decisions of a run as pure functions: step size, first step, iteration stopping.

mod contraction;
mod initial_step;
mod newton;
mod step;

pub use contraction::Contractions;
pub use initial_step::{starting_step, trial_step};
pub use newton::{IterationVerdict, NewtonControl, NewtonMonitor, noise};
pub use step::{StepControl, StepHistory, StepLaw, StepVerdict};
