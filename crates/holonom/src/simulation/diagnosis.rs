//! Why a run ended, in the user's words.

use super::options::Options;
use super::statistics::{Status, StopReason};
use crate::method::EquationForm;
use crate::method::stepper::{Rejection, Stepper};
use crate::reduction::singular_elements::ASIDE;
use crate::system::{Measure, State, System};
use crate::watch::GivenUp;

/// m, rad and their rates: no machine comes there, and squares are soon no numbers any more.
const RUNAWAY: f64 = 1e100;
/// Items that a message names.
const SHOWN: usize = 6;

/// What to try where the step could not be shortened because its size is fixed: that it is too long is likelier than a
/// fault of the model.
const SHORTER: &str =
    "take a smaller `fixed_step`, or leave it out, so that the steps follow the tolerance";
/// The same where the mechanism may be at fault after all.
const SHORTER_OR_DEAD_POINT: &str = "take a smaller `fixed_step`, or leave it out; where that does not help, the \
    mechanism comes to a dead point: change its lengths or its start, or stop before it";

/// What to try where the ends of a spring have met.
const APART: &str = "let its force vanish with its length, as with `free_length = 0`, or keep its ends apart: a little \
    beside each other where they pass, or by a stop";

/// Why the loop ended early.
pub(super) enum Stop {
    Interrupted,
    MaxSteps,
    MaxSeconds,
    Sink(String),
    Failed { cause: Option<Rejection>, step_size: f64 },
}

impl From<GivenUp> for Stop {
    fn from(given_up: GivenUp) -> Self {
        match given_up {
            GivenUp::Asked => Self::Interrupted,
            GivenUp::OutOfTime => Self::MaxSeconds,
        }
    }
}

/// What may have made a run fail, found at its last good state.
#[derive(Debug, Default)]
pub(super) struct Suspects {
    /// Coordinate with the largest last correction or error.
    changed: Option<String>,
    /// Forces on its body, the stiffest first.
    forces: Vec<String>,
    /// Drivers and forces that have a kink at this time.
    kinks: Vec<String>,
    /// A coordinate that has left the range in which squares are numbers, with its size.
    runaway: Option<(String, f64)>,
    /// A spring whose ends have met, where its force has no direction.
    pub(super) met: Option<String>,
    /// A rotational spring or rotation driver whose axes have become opposite, where its twist has no value.
    pub(super) opposite: Option<String>,
    /// Joint and coordinate that are nearest to losing their hold.
    weakest: (Option<String>, Option<String>),
}

impl Suspects {
    /// Reads the last attempt of a stepper from `state`, the last good one.
    pub(super) fn find(form: &mut dyn EquationForm, stepper: &dyn Stepper, state: &State) -> Self {
        let system = form.point().manifold.system().clone();
        let n = system.structure().sizes.coordinates;
        let parametrization = form.point().manifold.chart().parametrization();
        // w holds positions, then their rates.
        let count = parametrization.ndof;
        let change = stepper.last_change();
        let changed = [change.get(..count), change.get(count..2 * count)]
            .into_iter()
            .flatten()
            .find(|part| part.iter().any(|x| *x != 0.0))
            .map(|part| {
                let scale = |k: usize| match parametrization.measure(system.as_ref(), k) {
                    Measure::Length => system.characteristic_length(),
                    Measure::Angle => 1.0,
                };
                let size = |k: usize| {
                    if part[k].is_finite() { part[k].abs() / scale(k) } else { f64::INFINITY }
                };
                let most =
                    (0..count).fold(0, |best, k| if size(k) > size(best) { k } else { best });
                (
                    parametrization.coordinate(system.as_ref(), most),
                    parametrization.name(system.as_ref(), most),
                )
            });
        let forces = changed.as_ref().map_or(Vec::new(), |c| system.forces_on(c.0, state));
        // Factors are to belong to the last good state.
        form.begin_step(state);
        let mut w = vec![0.0; form.dimension()];
        form.pack(state, &mut w);
        let mut weakest = (None, None);
        let _ = form.evaluate(state.t, &w, false); // a failure leaves factors of a nearby point
        if n > 0 {
            let (row, coordinate) = form.point_mut().manifold.chart_mut().weakest();
            weakest.0 = row.map(|row| system.row_item(row).0.to_owned());
            weakest.1 = Some(system.coordinate_name(coordinate));
        }
        let size = |k: usize| state.q[k].abs().max(state.v[k].abs()).max(state.a[k].abs());
        let runaway =
            (0..n).find(|&k| size(k) > RUNAWAY).map(|k| (system.coordinate_name(k), size(k)));
        let owned = |names: Vec<&str>| names.into_iter().map(str::to_owned).collect();
        Self {
            forces: owned(forces),
            changed: changed.map(|c| c.1),
            runaway,
            kinks: owned(system.kinks_at(state.t)),
            met: None,
            opposite: None,
            weakest,
        }
    }

    /// What changed most, the forces on its body and what has a kink, as the end of a message.
    fn told(&self, what: &str) -> String {
        let listed =
            |names: &[String]| format!("`{}`", names[..names.len().min(SHOWN)].join("`, `"));
        let changed = self.changed.as_ref().map(|c| format!("; {what} is of `{c}`"));
        let forces = (!self.forces.is_empty())
            .then(|| format!("; forces on its body, the stiffest first: {}", listed(&self.forces)));
        let kinks = (!self.kinks.is_empty())
            .then(|| format!("; kinks at this time: {}", listed(&self.kinks)));
        [changed, forces, kinks].into_iter().flatten().collect()
    }

    /// The item to look at first.
    fn item(&self) -> Option<String> {
        self.kinks.first().or(self.forces.first()).cloned()
    }
}

/// Status and reason of a run that ended at `time`.
pub(super) fn diagnose(
    stop: Result<(), Stop>,
    time: f64,
    options: &Options,
    suspects: &Suspects,
    system: &dyn System,
) -> (Status, StopReason) {
    let slowed = matches!(stop, Err(Stop::MaxSteps | Stop::MaxSeconds));
    // What runs away does so whatever has met.
    let failed = matches!(stop, Err(Stop::Failed { .. })) && suspects.runaway.is_none();
    let (status, mut reason) = ended(stop, time, options, suspects, system);
    if slowed || failed {
        if let Some(item) = &suspects.met {
            let met = format!("the ends of `{item}` have met, where its force has no direction");
            say_singular(item, &met, APART, slowed, &mut reason);
        } else if let Some(item) = &suspects.opposite {
            let opposite =
                format!("the axes of `{item}` have become opposite, where its twist has no value");
            say_singular(item, &opposite, ASIDE, slowed, &mut reason);
        }
    }
    (status, reason)
}

/// Says what has come to where it is not defined, which is the reason of a failure and likely that of a run that is `slowed`.
fn say_singular(item: &str, what: &str, help: &'static str, slowed: bool, reason: &mut StopReason) {
    reason.message = if slowed {
        format!("{}; {what}", reason.message)
    } else {
        format!("{what}: {}", reason.message)
    };
    (reason.item, reason.help) = (Some(item.to_owned()), help);
}

fn ended(
    stop: Result<(), Stop>,
    time: f64,
    options: &Options,
    suspects: &Suspects,
    system: &dyn System,
) -> (Status, StopReason) {
    let reason = |code, message: String, step_size, help| StopReason {
        code,
        message,
        time,
        step_size,
        item: None,
        coordinate: None,
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
            let help = if options.fixed_step.is_some() {
                "raise `max_steps`, or take a longer `fixed_step`"
            } else if options.code.is_explicit() {
                "raise `max_steps`, loosen the tolerance, or use an implicit code"
            } else {
                "raise `max_steps`, loosen the tolerance, or look for what makes steps short near this time"
            };
            (Status::Limit, reason("simulation/max-steps", message, 0.0, help))
        }
        Err(Stop::MaxSeconds) => {
            let limit = options.max_seconds;
            let message = format!("`max_seconds` = {limit} reached at t = {time:.6} s");
            let help = if options.fixed_step.is_some() {
                "raise `max_seconds`, or take a longer `fixed_step`"
            } else {
                "raise `max_seconds`, or loosen the tolerance"
            };
            (Status::Limit, reason("simulation/max-seconds", message, 0.0, help))
        }
        Err(Stop::Sink(message)) => {
            let help = "the trajectory could not be stored; check space and access";
            (Status::Failed, reason("simulation/sink", message, 0.0, help))
        }
        Err(Stop::Failed { cause, step_size }) => {
            let mut reason = failure(cause, time, step_size, options, suspects, system);
            if options.fixed_step.is_some() {
                reason.help = match reason.code {
                    "simulation/branch" | "simulation/singular-configuration" => {
                        SHORTER_OR_DEAD_POINT
                    }
                    "simulation/singular-mass" => reason.help,
                    _ => SHORTER,
                };
            }
            (Status::Failed, reason)
        }
    }
}

fn failure(
    cause: Option<Rejection>,
    time: f64,
    step_size: f64,
    options: &Options,
    suspects: &Suspects,
    system: &dyn System,
) -> StopReason {
    let fixed = options.fixed_step.is_some();
    let (weak_item, weak_coordinate) = suspects.weakest.clone();
    if let Some((coordinate, size)) = &suspects.runaway {
        return StopReason {
            code: "simulation/not-finite",
            message: format!(
                "the motion runs away: at t = {time:.6} s `{coordinate}` or its rates reach {size:.1e}"
            ),
            time,
            step_size,
            item: suspects.item(),
            coordinate: Some(coordinate.clone()),
            help: "look at the forces on this body: one of them feeds energy into the motion",
        };
    }
    let (code, message, help, item, coordinate) = match cause {
        Some(Rejection::Evaluation(f) | Rejection::SingularMatrix(f)) => {
            let help = match f.code {
                "simulation/branch" | "simulation/singular-configuration" => {
                    "the mechanism comes to a singular configuration (a dead point); change \
                     its lengths or its start, or stop before it"
                }
                "simulation/contradiction" => {
                    "what said the same contradicts itself from here on: make the motions of these drivers agree, or leave one \
                     of them or the joint that holds it out"
                }
                "simulation/position-recovery" => {
                    "the joints cannot be closed any more: look at the mechanism near this \
                     time, and at the forces that drive it there"
                }
                _ => "look at the forces near this time; plot the last states",
            };
            // A failed evaluation knows what it met; the rest was found beside it.
            let of_row = f.row.map(|row| system.row_item(row).0);
            let of_group = f.group.map(|group| system.relative_groups()[group].name.as_str());
            let item = of_row.or(of_group).map(str::to_owned).or(weak_item);
            let coordinate = f.coordinate.map(|k| system.coordinate_name(k)).or(weak_coordinate);
            (f.code, f.message, help, item, coordinate)
        }
        Some(Rejection::NewtonDivergence | Rejection::NewtonSlow) => (
            "simulation/newton-divergence",
            format!(
                "the iteration diverged at t = {time:.6} s with {} {step_size:.1e} s{}",
                if fixed { "the fixed step of" } else { "steps down to" },
                suspects.told("the largest correction")
            ),
            "look for a stop, contact or kink in these forces there",
            suspects.item(),
            suspects.changed.clone(),
        ),
        _ => (
            "simulation/step-size-underflow",
            format!(
                "{} {step_size:.1e} s at t = {time:.6} s{}",
                if fixed {
                    "no step is possible of the fixed size"
                } else {
                    "the step size fell to"
                },
                suspects.told("the largest error")
            ),
            "look for a jump in a force law or motion there, or loosen the tolerance",
            suspects.item(),
            suspects.changed.clone(),
        ),
    };
    StopReason { code, message, time, step_size, item, coordinate, help }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spring_whose_ends_have_met_is_named_and_not_a_joint() {
        let mut reason = StopReason {
            code: "simulation/branch",
            message: "`pin` would leave the branch".into(),
            time: 0.5,
            step_size: 1e-12,
            item: Some("pin".into()),
            coordinate: None,
            help: "change lengths",
        };
        let mut limited = StopReason { message: "`max_steps` reached".into(), ..reason.clone() };
        let met = "the ends of `spring` have met";
        say_singular("spring", met, APART, false, &mut reason);
        assert!(reason.message.starts_with("the ends of `spring` have met"), "{}", reason.message);
        assert_eq!((reason.item.as_deref(), reason.help), (Some("spring"), APART));
        say_singular("spring", met, APART, true, &mut limited);
        assert!(limited.message.starts_with("`max_steps` reached; the ends of `spring`"));
    }
}
