//! Why a run ended, in the user's words.

use super::options::Options;
use super::statistics::{Status, StopReason};
use crate::method::stepper::Rejection;

/// Why the loop ended early.
pub(super) enum Stop {
    Interrupted,
    MaxSteps,
    MaxSeconds,
    Sink(String),
    Failed { cause: Option<Rejection>, step_size: f64 },
}

/// Status and reason of a run that ended at `time`.
pub(super) fn diagnose(
    stop: Result<(), Stop>,
    time: f64,
    options: &Options,
) -> (Status, StopReason) {
    let reason = |code, message: String, step_size, help| StopReason {
        code,
        message,
        time,
        step_size,
        item: None,
        help,
    };
    match stop {
        Ok(()) => {
            let message = format!("reached the end time {time} s");
            (Status::Completed, reason("simulation/end-time", message, 0.0, ""))
        }
        Err(Stop::Interrupted) => {
            let message = format!("interrupted at t = {time:.6} s");
            let help = "start again from the last state to go on";
            (Status::Interrupted, reason("simulation/interrupted", message, 0.0, help))
        }
        Err(Stop::MaxSteps) => {
            let limit = options.max_steps;
            let message = format!("`max_steps` = {limit} reached at t = {time:.6} s");
            let help = "raise `max_steps`, loosen the tolerance, or use an implicit code";
            (Status::Limit, reason("simulation/max-steps", message, 0.0, help))
        }
        Err(Stop::MaxSeconds) => {
            let limit = options.max_seconds;
            let message = format!("`max_seconds` = {limit} reached at t = {time:.6} s");
            let help = "raise `max_seconds`, or loosen the tolerance";
            (Status::Limit, reason("simulation/max-seconds", message, 0.0, help))
        }
        Err(Stop::Sink(message)) => {
            let help = "the trajectory could not be stored; check space and access";
            (Status::Failed, reason("simulation/sink", message, 0.0, help))
        }
        Err(Stop::Failed { cause, step_size }) => (Status::Failed, failure(cause, time, step_size)),
    }
}

fn failure(cause: Option<Rejection>, time: f64, step_size: f64) -> StopReason {
    let (code, message, help) = match cause {
        Some(Rejection::Evaluation(f) | Rejection::SingularMatrix(f)) => {
            let help = match f.code {
                "simulation/branch" | "simulation/singular-configuration" => {
                    "the mechanism comes to a singular configuration (a dead point); change \
                     its lengths or its start, or stop before it"
                }
                "simulation/position-recovery" => {
                    "the joints cannot be closed any more: look at the mechanism near this \
                     time, and at the forces that drive it there"
                }
                _ => "look at the forces near this time; plot the last states",
            };
            (f.code, f.message, help)
        }
        Some(Rejection::NewtonDivergence | Rejection::NewtonSlow) => (
            "simulation/newton-divergence",
            format!(
                "the iteration diverged at t = {time:.6} s with steps down to {step_size:.1e} s"
            ),
            "look for a stop, contact or kink in a force law there",
        ),
        _ => (
            "simulation/step-size-underflow",
            format!("the step size fell to {step_size:.1e} s at t = {time:.6} s"),
            "look for a jump in a force law there, or loosen the tolerance",
        ),
    };
    let item = named_item(&message);
    StopReason { code, message, time, step_size, item, help }
}

/// The joint, body or coordinate that a message names: names stand between backticks.
fn named_item(message: &str) -> Option<String> {
    let mut parts = message.split('`');
    parts.next();
    parts.next().filter(|name| !name.is_empty()).map(str::to_owned)
}
