//! What a run refuses before it starts.

use super::options::{Options, OutputTimes};
use crate::method::{Code, JacobianSource};
use crate::reduction::assembly::AssemblyError;
use crate::system::{Channel, State, System};
use std::sync::Arc;

/// Why a run could not start.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RunError {
    /// No consistent start.
    #[error(transparent)]
    Assembly(#[from] AssemblyError),
    /// A channel that does not exist.
    #[error("unknown channel `{name}`{}", nearest.as_ref().map_or(String::new(), |n| format!("; did you mean `{n}`?")))]
    UnknownChannel {
        /// What was asked for.
        name: String,
        /// The channel nearest in name.
        nearest: Option<String>,
    },
    /// An option out of range.
    #[error("`{option}` is {value}; it must be {rule}")]
    Option {
        /// Name of the option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        rule: &'static str,
    },
    /// The code needs an exact Jacobian.
    #[error(
        "`jacobian` is differences; {code} needs the exact Jacobian, without which it loses its \
         order; use analytic, or another code"
    )]
    InexactJacobian {
        /// Name of the code.
        code: &'static str,
    },
    /// A start state of another model.
    #[error("the start state has {found} {what}, the model {expected}")]
    StartState {
        /// Which array.
        what: &'static str,
        /// Length found.
        found: usize,
        /// Length expected.
        expected: usize,
    },
}

pub(super) fn check_options(options: &Options) -> Result<(), RunError> {
    let positive = |option, value: f64| {
        if value > 0.0 {
            return Ok(());
        }
        Err(RunError::Option { option, value, rule: "positive" })
    };
    positive("tolerance.relative", options.tolerance.relative)?;
    positive("tolerance.translation", options.tolerance.translation)?;
    positive("tolerance.rotation", options.tolerance.rotation)?;
    positive("max_step", options.max_step)?;
    positive("initial_step", options.initial_step.unwrap_or(1.0))?;
    positive("fixed_step", options.fixed_step.unwrap_or(1.0))?;
    positive("repartition_factor", options.repartition_factor)?;
    if !options.end_time.is_finite() {
        let value = options.end_time;
        return Err(RunError::Option { option: "end_time", value, rule: "finite" });
    }
    if let OutputTimes::Interval(value) = options.output {
        positive("interval", value)?;
    }
    if options.jacobian == JacobianSource::Differences && options.code == Code::ForRosen {
        return Err(RunError::InexactJacobian { code: options.code.info().name });
    }
    Ok(())
}

pub(super) fn check_state(system: &Arc<dyn System>, state: &State) -> Result<(), RunError> {
    let sizes = system.structure().sizes;
    for (what, found, expected) in [
        ("coordinates", state.q.len(), sizes.coordinates),
        ("velocities", state.v.len(), sizes.coordinates),
        ("accelerations", state.a.len(), sizes.coordinates),
        ("multipliers", state.lambda.len(), sizes.rows),
        ("extra states", state.z.len(), sizes.extra_states),
        ("windings", state.winding.len(), sizes.windings),
    ] {
        if found != expected {
            return Err(RunError::StartState { what, found, expected });
        }
    }
    Ok(())
}

pub(super) fn find_channels(
    system: &Arc<dyn System>,
    names: &[String],
) -> Result<Vec<Channel>, RunError> {
    let all = system.channels();
    names
        .iter()
        .map(|name| {
            all.iter().find(|c| c.name == *name).cloned().ok_or_else(|| RunError::UnknownChannel {
                name: name.clone(),
                nearest: nearest(name, all),
            })
        })
        .collect()
}

/// The channel that shares most with a misspelled name, if it shares at least half.
fn nearest(name: &str, all: &[Channel]) -> Option<String> {
    let score = |other: &str| strsim::jaro_winkler(name, other);
    all.iter()
        .map(|c| (score(&c.name), &c.name))
        .filter(|(s, _)| *s > 0.7)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, n)| n.clone())
}
