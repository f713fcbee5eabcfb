//! A second run that tells how far a suspicious one is off.

use super::carried_error::{CarriedError, Milestones, VELOCITIES};
use super::checks::{RunError, SMALLEST_TOLERANCE, smallest_tolerance};
use super::options::{Options, OutputTimes};
use super::problem::Problem;
use super::run::{Start, Summary, Task, once};
use super::statistics::{RunWarning, Status};
use super::trajectory::{Chunk, Flow, Sink};
use crate::method::{Code, DEFAULT_CODE, Weights};
use crate::model::Tolerance;
use crate::system::{State, System};
use std::time::Duration;

/// Tolerances by which places may differ from those of the second run; velocities by more of them.
const FAR: f64 = 50.0;
/// Tolerances within which a run may be called right.
const MET: f64 = 20.0;
/// Tolerances by which places may differ from those of one that is suspicious itself.
const UNCERTAIN: f64 = 40.0;
/// Tolerance of the second run as a part of that of the first.
const PART: f64 = 0.1;
/// Longest steps of the second run as a part of those that the first may take, where these are limited: errors of order 5 and more
/// fall as by its tolerance.
const SHORTER: f64 = 0.6;
/// Part of the run for which the velocity of a body must be off, beside the first time that it is found so: something sudden
/// comes a little early or late, and what is over within one of the rows that a run stores unless told otherwise shows in no more.
const LASTING: f64 = 1.0 / 200.0;
/// Steps up to which it is computed whether something grows that longer ones do not show.
const MOST_STEPS: f64 = 200_000.0;

/// What a second run tells.
#[derive(Debug)]
pub(super) struct Found {
    /// That the motion is not right, or that it could not be told.
    pub(super) warning: Option<RunWarning>,
    /// Whether stiff elements hold other energies, though the motion is right: the missing energy is missing.
    pub(super) potentials_differ: bool,
    /// Whether it was to end before it could tell.
    pub(super) interrupted: bool,
}

/// What is found of a run by `options` that is suspicious: a warning where it is far from a run by the default code, of explicit codes by the
/// one of the highest order, at a tenth of its tolerance with steps of `max_step` at most, or where such a run does not come to its end within
/// what is `left` of the time; and whether potentials differ, where energy is missing.
pub(super) fn compare(
    problem: &Problem,
    options: &Options,
    CarriedError { milestones, speeds, missing, .. }: &CarriedError,
    max_step: f64,
    left: Option<Duration>,
    sink: &mut dyn Sink,
) -> Found {
    let system = problem.system().as_ref();
    // Steps of its own length did not show what may grow.
    let shows = max_step < options.max_step;
    if shows && options.end_time - milestones.start.t > MOST_STEPS * max_step {
        return Found::told(format!(
            "whatever disturbs this motion grows in it, or a vibration is built up, which steps of this length do not show: set `max_step` to \
             {max_step:.1e} s at most to see what becomes of it, and end the run earlier"
        ));
    }
    let (stated, least) = (options.tolerance, smallest_tolerance(system.characteristic_length()));
    // What is not stiff is told best by a code that none of its kind surpasses.
    let explicit = options.code.is_explicit();
    let tighter = Options {
        code: if explicit { Code::Dop853 } else { DEFAULT_CODE },
        tolerance: Tolerance {
            // What is smaller is refused, and as good as none.
            relative: (PART * stated.relative).max(least.relative),
            translation: (PART * stated.translation).max(least.translation),
            rotation: (PART * stated.rotation).max(least.rotation),
        },
        output: OutputTimes::Listed(milestones.times.clone()),
        // Steps of the same lengths would repeat their errors.
        max_step: (SHORTER * options.max_step).min(max_step),
        max_steps: options.max_steps,
        max_seconds: left.map_or(f64::INFINITY, |left| left.as_secs_f64()),
        threads: options.threads.clone(),
        dense_output: Some(false),
        ..Options::new(options.end_time)
    };
    let mut comparison = Comparison {
        sink,
        system,
        milestones,
        speeds,
        weights: Weights::new(options.tolerance, system, &milestones.start),
        place: milestones.start.clone(),
        first_place: milestones.start.clone(),
        allowed_potential: missing.as_ref().map_or(f64::INFINITY, |(_, joules)| *joules),
        potentials_differ: false,
        differences: [(); 2].map(|()| vec![0.0; milestones.start.q.len()]),
        compared: 0,
        off: vec![None; speeds.len()],
        largest: Vec::with_capacity(milestones.times.len()),
        worst: None,
    };
    let task = Task { name: "checking", followed: FAR / PART, turn_part: SHORTER };
    let start = Start::At(&milestones.start);
    let outcome = once(problem, &tighter, start, task, &mut comparison);
    let far = comparison.is_far();
    // What is not certain of itself vouches for less.
    let allowed = match outcome {
        _ if far => FAR,
        Ok((Summary { status: Status::Completed, .. }, second)) => match second {
            Some(second) if second.is_beyond() || second.is_hidden() => MET,
            Some(second) if second.is_suspicious() => UNCERTAIN,
            _ => FAR,
        },
        outcome => {
            let interrupted = match &outcome {
                Ok((summary, _)) => summary.status == Status::Interrupted,
                Err(error) => *error == RunError::Interrupted,
            };
            return Found { interrupted, ..Found::told(unfinished(outcome)) };
        }
    };
    let doubtful = allowed < FAR;
    let potentials_differ = comparison.potentials_differ;
    let Some(far) = comparison.worst.filter(|worst| worst.counted > allowed) else {
        return Found { warning: None, potentials_differ, interrupted: false };
    };
    let doubt = if doubtful { ", which may be off itself" } else { "" };
    let shorter = if shows {
        format!(", or set `max_step` to {max_step:.1e} s, as longer steps do not show what grows")
    } else {
        String::new()
    };
    let advice = far.advice(options, &milestones.start, system.characteristic_length(), &shorter);
    let Far { item, share, of_velocity, by, t, .. } = far;
    let away = if of_velocity {
        let tolerances = VELOCITIES * share;
        format!("the velocity of `{item}` is {tolerances:.0} tolerances ({by}) away from what")
    } else {
        format!(
            "`{item}` is {share:.0} tolerances of its position and orientation ({by}) away from where"
        )
    };
    Found::told(format!(
        "small errors add up or grow in this motion: {away} a second run, at a tenth of the tolerance{doubt}, has it \
         at t = {t:.4} s, and what comes later may be further off; {advice}"
    ))
}

impl Found {
    fn told(message: String) -> Self {
        let warning = RunWarning { code: "simulation/amplified-error", message };
        Self { warning: Some(warning), potentials_differ: false, interrupted: false }
    }
}

/// Of a second run that did not come to its end.
fn unfinished(outcome: Result<(Summary, Option<CarriedError>), RunError>) -> String {
    let why = match outcome {
        Ok((summary, _)) => summary.stop.message,
        Err(error) => error.to_string(),
    };
    format!(
        "small errors may add up or grow in this motion, beyond what is tolerated, and the second run that was to \
         tell, at a tenth of the tolerance, did not reach its end: {why}"
    )
}

/// Where a run is far from the second one.
struct Far {
    item: String,
    /// In tolerances of a place, velocities in their wider ones.
    share: f64,
    /// The same as it counts: nothing of velocities that are off for moments only.
    counted: f64,
    of_velocity: bool,
    /// The same in m and rad, m/s and rad/s.
    by: String,
    /// s
    t: f64,
    /// Time, s, of a comparison after half the time at most, and the largest share until then.
    before: Option<(f64, f64)>,
}

/// What may be had where errors grow beyond any tolerance.
const BEYOND: &str =
    "what can be had is a shorter run, or statistics over runs from slightly different starts";

impl Far {
    /// What to do about it; `shorter` is said beside a tighter tolerance.
    fn advice(&self, options: &Options, start: &State, length: f64, shorter: &str) -> String {
        let most = largest_fold(options.tolerance, length);
        let fold = 10f64.powf((self.share / MET).log10().ceil());
        let least = SMALLEST_TOLERANCE;
        if fold > most {
            return format!(
                "the motion amplifies errors too strongly to be predicted so far: no tolerance that the arithmetic can \
                 keep, {least:.0e} relative at least, is tight enough; {BEYOND}"
            );
        }
        let tighten = format!(
            "tighten the tolerance, {fold:.0}-fold at least if it is to be met until then{shorter}, and compare with \
             another code"
        );
        if fold * self.growth_to(options.end_time, start.t) <= most {
            return tighten;
        }
        format!(
            "{tighten}; where errors go on growing as they did before, no tolerance that the arithmetic can keep, \
             {least:.0e} relative at least, is tight enough for the whole run: {BEYOND}"
        )
    }

    /// Growth until `end`, s, of what began at `start`, s, and grows by the power of time that it grew by since half the
    /// time: what grows exponentially grows more. One where nothing is known of it.
    fn growth_to(&self, end: f64, start: f64) -> f64 {
        let Some((before, difference)) = self.before else { return 1.0 };
        let grown = self.share / difference.max(1.0); // less than one is no growth to go by
        let power = grown.ln() / ((self.t - start) / (before - start)).ln();
        let growth = ((end - start) / (self.t - start)).powf(power.max(0.0));
        if growth.is_nan() { 1.0 } else { growth }
    }
}

/// How many times tighter a tolerance may be for a model of characteristic length `length`, m.
fn largest_fold(tolerance: Tolerance, length: f64) -> f64 {
    let least = smallest_tolerance(length);
    (tolerance.relative / least.relative)
        .min(tolerance.translation / least.translation)
        .min(tolerance.rotation / least.rotation)
}

/// Compares the places and velocities of the second run with those of the first as they come.
struct Comparison<'a> {
    sink: &'a mut dyn Sink,
    system: &'a dyn System,
    milestones: &'a Milestones,
    speeds: &'a [[f64; 2]],
    weights: Weights,
    place: State,
    first_place: State,
    /// J; infinite where potentials do not matter.
    allowed_potential: f64,
    potentials_differ: bool,
    /// Of coordinates and velocities.
    differences: [Vec<f64>; 2],
    compared: usize,
    /// For how long, s, the velocity of each body is off by more than [`FAR`]; no time at the first one.
    off: Vec<Option<f64>>,
    /// Time, s, of each comparison, and the largest share until then.
    largest: Vec<(f64, f64)>,
    /// The largest difference, up to the first that is far.
    worst: Option<Far>,
}

impl Comparison<'_> {
    /// Whether there is something to warn of. What comes until the run heeds that does not count: when it does is a
    /// matter of time.
    fn is_far(&self) -> bool {
        self.worst.as_ref().is_some_and(|worst| worst.counted > FAR)
    }

    /// Compares one row.
    fn take(&mut self, t: f64, [q, v]: [&[f64]; 2]) {
        if self.is_far() {
            return;
        }
        let n = q.len();
        let at = self.compared * n;
        let first = [&self.milestones.places, &self.milestones.velocities].map(|x| &x[at..][..n]);
        self.compared += 1;
        self.place.q.copy_from_slice(q);
        self.place.v.copy_from_slice(v);
        if self.allowed_potential.is_finite() {
            self.first_place.q.copy_from_slice(first[0]);
            self.first_place.v.copy_from_slice(first[1]);
            self.first_place.t = t;
            self.place.t = t;
            let [a, b] = [&self.first_place, &self.place].map(|s| self.system.energy(s).potential);
            self.potentials_differ |= (a - b).abs() > self.allowed_potential;
        }
        self.weights.set(&self.place);
        let sizes = self.system.structure().sizes;
        for (own, turns) in (0..sizes.bodies).map(|b| (sizes.of_body(b), sizes.rotations_of(b))) {
            // Both signs of Euler parameters are one orientation.
            let dot: f64 = turns.clone().map(|k| q[k] * first[0][k]).sum();
            let sign = if !sizes.is_planar() && dot < 0.0 { -1.0 } else { 1.0 };
            for ((out, x), first) in self.differences.iter_mut().zip([q, v]).zip(first) {
                for k in own.clone() {
                    let sign = if turns.contains(&k) { sign } else { 1.0 };
                    out[k] = sign * x[k] - first[k];
                }
            }
        }
        let [dq, dv] = &self.differences;
        let displacements = self.weights.displacements(dq).map(|share| (share, share, false));
        let [lasts, lasting] = [self.lasts(), LASTING * self.span()];
        let ends = self.compared == self.milestones.times.len();
        let changes = self.weights.velocity_changes(dv, self.speeds).map(|size| size / VELOCITIES);
        let changes = changes.zip(&mut self.off).map(|(share, off)| {
            if share > FAR {
                *off = Some(off.map_or(0.0, |time| time + lasts));
            }
            // How long it goes on after the end nothing tells.
            let counts = share > FAR && (ends || off.is_some_and(|time| time > lasting));
            let counted = if counts { share } else { 0.0 };
            (counted, share, true)
        });
        let shares = displacements.enumerate().chain(changes.enumerate());
        let largest = shares.reduce(|a, b| if b.1.0 > a.1.0 { b } else { a });
        let (body, (counted, share, of_velocity)) = largest.unwrap_or_default();
        if self.worst.as_ref().is_none_or(|worst| counted > worst.counted) {
            let [translations, rotations] = [sizes.translations_of(body), sizes.rotations_of(body)];
            let item = self.system.coordinate_item(translations.start).to_owned();
            let change = &self.differences[usize::from(of_velocity)];
            let [moved, turned] = [translations, rotations]
                .map(|own| change[own].iter().map(|x| x * x).sum::<f64>().sqrt());
            let turned = sizes.angle_factor() * turned;
            let per = if of_velocity { "/s" } else { "" };
            let by = format!("{moved:.1e} m{per}, {turned:.1e} rad{per}");
            let before = self.half_before(t);
            self.worst = Some(Far { item, share, counted, of_velocity, by, t, before });
        }
        let before = self.largest.last().map_or(0.0, |(_, largest)| *largest);
        self.largest.push((t, before.max(share)));
    }

    /// How long what is found at the row just taken lasts, s: where a step is long, what is at its end was not there before.
    fn lasts(&self) -> f64 {
        let Milestones { start, times, .. } = self.milestones;
        let time = |k: usize| times.get(k).copied();
        let Some(now) = time(self.compared - 1) else { return 0.0 };
        let before = self.compared.checked_sub(2).and_then(time).unwrap_or(start.t);
        time(self.compared).map_or(now - before, |next| (next - now).min(now - before))
    }

    /// Of all that is compared, s.
    fn span(&self) -> f64 {
        let Milestones { start, times, .. } = self.milestones;
        times.last().map_or(0.0, |end| end - start.t)
    }

    /// The last comparison after half the time until `t`, s, at most.
    fn half_before(&self, t: f64) -> Option<(f64, f64)> {
        let start = self.milestones.start.t;
        let half = self.largest.partition_point(|(time, _)| 2.0 * (time - start) <= t - start);
        half.checked_sub(1).map(|k| self.largest[k])
    }
}

impl Sink for Comparison<'_> {
    fn chunk(&mut self, chunk: &Chunk) -> Result<(), String> {
        let n = self.milestones.start.q.len().max(1);
        let rows = chunk.q.chunks_exact(n).zip(chunk.v.chunks_exact(n));
        for (&t, (q, v)) in chunk.time.iter().zip(rows) {
            // A run that is given up hands out its last state, too.
            if self.milestones.times.get(self.compared) == Some(&t) {
                self.take(t, [q, v]);
            }
        }
        Ok(())
    }

    /// The first run is at its end.
    fn progress(&mut self, _: f64, step_size: f64, steps: u64) -> Flow {
        if self.is_far() {
            return Flow::Interrupt;
        }
        let end = self.milestones.times.last().copied().unwrap_or(self.milestones.start.t);
        self.sink.progress(end, step_size, steps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn far(share: f64, t: f64, before: Option<(f64, f64)>) -> Far {
        let counted = share;
        Far { item: "bob".into(), share, counted, of_velocity: false, by: String::new(), t, before }
    }

    #[test] // independent truth: tolerances down to 1e-13 can be kept, as docs/conventions.md says
    fn a_tighter_tolerance_is_advised_where_there_is_one() {
        let advice = |far: &Far, tolerance: f64| {
            let options =
                Options { tolerance: Tolerance::uniform(tolerance), ..Options::new(100.0) };
            far.advice(&options, &State::default(), 1.0, "")
        };
        let alone = far(60.0, 10.0, None);
        assert!(advice(&alone, 1e-4).starts_with("tighten the tolerance, 10-fold at least"));
        assert!(!advice(&alone, 1e-4).contains("whole run"));
        // 6e9 tolerances of 1e-5 ask for 1e-14.
        let lost = far(6e9, 10.0, Some((5.0, 1.0)));
        assert!(advice(&lost, 1e-5).contains("too strongly to be predicted"));
        assert!(!advice(&lost, 1e-5).contains("tighten"));
        // What adds up evenly is ten times larger in the end, what grows 1e4-fold in a twelfth of the run is not met.
        let even = far(60.0, 10.0, Some((5.0, 30.0)));
        assert!(!advice(&even, 1e-4).contains("whole run"));
        let chaotic = far(1e4, 10.0, Some((5.0, 1.0)));
        let said = advice(&chaotic, 1e-4);
        assert!(said.contains("1000-fold at least") && said.contains("whole run"), "{said}");
    }

    #[test] // independent truth: powers by hand
    fn growth_goes_on_by_its_power() {
        for (t, before, end, start, growth) in [
            (4.0, Some((2.0, 20.0)), 8.0, 0.0, 4.0),
            (5.0, Some((3.0, 20.0)), 9.0, 1.0, 4.0),
            (4.0, Some((2.0, 160.0)), 8.0, 0.0, 1.0),
            (4.0, Some((0.0, 20.0)), 8.0, 0.0, 1.0),
            (4.0, None, 8.0, 0.0, 1.0),
        ] {
            let found = far(80.0, t, before).growth_to(end, start);
            assert!((found - growth).abs() < 1e-12, "{before:?}: {found}");
        }
    }
}
