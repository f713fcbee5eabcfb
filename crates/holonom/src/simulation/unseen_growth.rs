//! Growth and resonance that long steps do not see. Equations: `docs/theory/simulation.md` (14), (14a).

use super::options::Options;
use super::problem::Problem;
use crate::method::{FirstOrder, Weights};
use crate::model::{Tolerance, frequencies};
use crate::reduction::Manifold;
use crate::system::{State, System};
use serde::{Deserialize, Serialize};

/// More unknowns than this are not looked at: eigenvalues of so many take a tenth of a second.
const MOST_UNKNOWNS: usize = 200;
/// Where there are more of them, only what is steady is looked at: eigenvalues cost as much as many steps.
const FEW_UNKNOWNS: usize = 50;
/// Where no step takes this part of a run, it is not looked at: steps that show nothing are few.
const LONG: f64 = 0.01;
/// Of so many parts of a run the longest step is looked at, but of no more than are paid for by its steps: looks at both its ends cost as
/// many as there are unknowns, divided by this.
const PARTS: usize = 4;
const UNKNOWNS_PER_STEP: usize = 3;
/// Steps that become so many times longer at once are those of a start, which show nothing.
const STARTS: f64 = 2.0;
/// Lengths of steps are told apart by this factor, down to about 1e-12 of a run.
const APART: f64 = 1.2;
const LENGTHS: usize = 152;
/// Steps show growth and vibrations of less than so many radians.
const SHOWN: f64 = 0.5;
/// Growth of what a step may leave, which is a tolerance, from which it is suspicious.
const GROWTH: f64 = 10.0;
/// An eigenvalue and what it resonates with differ by less than this part.
const RESONANT: f64 = 0.1;
/// Relative difference of an eigenvalue at both ends of a step in which it stays the same, and in which it is the same one.
const SAME: f64 = 0.1;
const ALIKE: f64 = 0.5;
/// Eigenvalues are known to about this part of the largest one, as round-off splits multiple ones.
const KNOWN: f64 = 1e-6;

/// A long step of a run.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct LongStep {
    length: f64,
    ends: [State; 2],
    /// Independent variables at both ends.
    independent: [Vec<f64>; 2],
}

impl LongStep {
    fn take(&mut self, length: f64, ends: [&State; 2], independent: [&[f64]; 2]) {
        self.length = length;
        for k in 0..2 {
            self.ends[k].copy_from(ends[k]);
            self.independent[k].copy_from_slice(independent[k]);
        }
    }
}

/// The longest step of a run, if it is a large part of it, and those of its parts.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct LongestStep {
    length: f64,
    ends: [State; 2],
    /// Of parts of the run, where unknowns are few.
    #[serde(default)]
    parts: Vec<LongStep>,
    /// Steps so far; length and end of the last one, s.
    #[serde(default)]
    steps: usize,
    #[serde(default)]
    before: [f64; 2],
    /// The end of the last step, s, that was shorter than the span of the run divided by a power of [`APART`], by that power; the start where
    /// there was none.
    #[serde(default)]
    shorter_until: Vec<f64>,
    /// The end of the run: equations that stand there need not be set up.
    #[serde(skip)]
    last: Option<Box<(Manifold, State)>>,
}

impl LongestStep {
    /// Of a run with `ndof` independent variables and so many unknowns that starts at `state`; none where there are too many.
    pub(super) fn new([ndof, unknowns]: [usize; 2], state: &State) -> Option<Self> {
        let part = || LongStep {
            length: 0.0,
            ends: [state.clone(), state.clone()],
            independent: [vec![0.0; ndof], vec![0.0; ndof]],
        };
        let parts = if unknowns <= FEW_UNKNOWNS { PARTS } else { 0 };
        (unknowns <= MOST_UNKNOWNS).then(|| Self {
            length: 0.0,
            ends: [state.clone(), state.clone()],
            parts: (0..parts).map(|_| part()).collect(),
            steps: 0,
            before: [0.0, state.t],
            shorter_until: vec![state.t; LENGTHS],
            last: None,
        })
    }

    /// Whether its ends can be states of a run that is at `state` with `ndof` independent variables.
    pub(super) fn fits(&self, ndof: usize, state: &State) -> bool {
        let sizes = |s: &State| [&s.q, &s.v, &s.a, &s.lambda, &s.z, &s.winding].map(Vec::len);
        let alike = |ends: &[State; 2]| ends.iter().all(|end| sizes(end) == sizes(state));
        alike(&self.ends)
            && self.parts.len() <= PARTS
            && self
                .parts
                .iter()
                .all(|part| alike(&part.ends) && part.independent.iter().all(|p| p.len() == ndof))
            && [0, LENGTHS].contains(&self.shorter_until.len())
    }

    /// Takes a step of a run from `started` to `finish`, s, with the independent variables at its ends.
    pub(super) fn take(
        &mut self,
        [started, finish]: [f64; 2],
        ends: [&State; 2],
        independent: [&[f64]; 2],
    ) {
        let [start, end] = ends;
        let (length, span) = (end.t - start.t, finish - started);
        self.steps += 1;
        let [before, until] = std::mem::replace(&mut self.before, [length, end.t]);
        let place = Self::place(span, before);
        if length < STARTS * before
            && let Some(latest) = self.shorter_until.get_mut(place)
        {
            *latest = until;
        }
        if length < LONG * span {
            return;
        }
        if length > self.length {
            self.length = length;
            self.ends[0].copy_from(start);
            self.ends[1].copy_from(end);
        }
        let part = (PARTS as f64 * (start.t - started) / span) as usize;
        if let Some(part) = self.parts.get_mut(part)
            && length > part.length
        {
            part.take(length, ends, independent);
        }
    }

    /// Independent variables have got another meaning: what is kept of them says nothing any more.
    pub(super) fn forget_variables(&mut self) {
        self.parts.iter_mut().for_each(|part| part.length = 0.0);
    }

    /// The place of a length among those that are told apart, the longest first.
    fn place(span: f64, length: f64) -> usize {
        ((span / length).ln() / APART.ln()) as usize
    }

    /// The end of the last step of a run of `span`, s, that was as short as `length`; a checkpoint of before does not say.
    fn shown_until(&self, span: f64, length: f64) -> Option<f64> {
        let shorter = self.shorter_until.iter().skip(Self::place(span, length));
        let until = shorter.fold(f64::NEG_INFINITY, |latest, until| latest.max(*until));
        until.is_finite().then_some(until)
    }

    /// The run has ended at `state`, which the manifold stands at.
    pub(super) fn end(&mut self, manifold: &Manifold, state: &State, tolerance: &Tolerance) {
        let system = manifold.system().as_ref();
        // Elsewhere than on the tree eigenvalues of what moves are those of its coordinates, too.
        let tree = manifold.chart().parametrization().relatives().is_some();
        let long = tree && self.parts.iter().any(|part| part.length > 0.0);
        let is_steady = |ends| Self::is_steady(ends, self.length, system, tolerance);
        let same = || {
            self.length > 0.0
                && is_steady([&self.ends[0], &self.ends[1]])
                && is_steady([&self.ends[1], state])
        };
        self.last = (long || same()).then(|| Box::new((manifold.clone(), state.clone())));
    }

    /// The longest step, s, that shows what grows up to the end of a run by `options` from `started`, s, while a long step does
    /// not show it.
    pub(super) fn hides_growth(
        &self,
        problem: &Problem,
        options: &Options,
        started: f64,
    ) -> Option<f64> {
        let steady = self.hides_steadily(problem, options, started);
        let long = LONG * (options.end_time - started);
        let parts = self.parts.iter().rev().filter(|part| part.length > 0.0 && part.length >= long);
        let unknowns = parts.clone().map(|part| 2 * part.independent[0].len()).max().unwrap_or(1);
        let parts = parts.take(UNKNOWNS_PER_STEP * self.steps / unknowns);
        let mut form: Option<FirstOrder> = None;
        let frequencies = frequencies(problem.model());
        let hidden = |part: &LongStep| {
            let (manifold, state) = self.last.as_deref()?;
            let form = form.get_or_insert_with(|| {
                let system = manifold.system().as_ref();
                let weights = Weights::new(options.tolerance, system, state);
                FirstOrder::new(manifold.clone(), weights, state)
            });
            self.hidden_in(part, form, &frequencies, options, started)
        };
        let rates = parts.filter_map(hidden).chain(steady);
        let fastest = rates.fold(0.0, f64::max);
        (fastest > 0.0).then(|| SHOWN / fastest)
    }

    /// Rate, 1/s, of the fastest that grows in a long step and is not shown by it: while it stays one that grows, from its start to
    /// the end of the run, or of the step where shorter ones show it later on.
    fn hidden_in(
        &self,
        part: &LongStep,
        form: &mut FirstOrder,
        frequencies: &[f64],
        options: &Options,
        started: f64,
    ) -> Option<f64> {
        let LongStep { length, ends, independent } = part;
        let mut eigenvalues_at = |k: usize| {
            form.stand_at(&ends[k], &independent[k]).ok()?;
            form.eigenvalues_at(&ends[k]).ok()
        };
        let span = options.end_time - started;
        let left = |rate: f64| {
            let later = self.shown_until(span, SHOWN / rate).is_some_and(|t| t > ends[0].t);
            if later { *length } else { options.end_time - ends[0].t }
        };
        let [start, finish] = [eigenvalues_at(0)?, eigenvalues_at(1)?];
        let resonates = |&frequency: &f64| {
            let near = |z: &(f64, f64)| z.0.hypot(z.1 - frequency) < RESONANT * frequency;
            length * frequency > SHOWN
                && finish.iter().any(near)
                && form
                    .response(&ends[1], frequency, left(frequency))
                    .is_ok_and(|size| size > GROWTH)
        };
        let resonance = frequencies.iter().copied().filter(resonates).reduce(f64::max);
        // What grows at one end alone has half of the step for it.
        let half = |all: &[(f64, f64)]| {
            let fastest = all.iter().map(|z| z.0.hypot(z.1)).fold(0.0, f64::max);
            let grown = all.iter().filter(|z| z.0 * 0.5 * length > GROWTH.ln());
            let rates = grown.map(|z| z.0.hypot(z.1)).filter(|rate| *rate > KNOWN * fastest);
            rates.reduce(f64::max)
        };
        let halves = [half(&start), half(&finish)];
        let whole = growing(finish, *length, left, ALIKE, || Some(start));
        halves.into_iter().chain([resonance, whole]).flatten().reduce(f64::max)
    }

    /// The same in the longest step of the run, where the motion is steady in it: then it goes on since steps showed it.
    fn hides_steadily(&self, problem: &Problem, options: &Options, started: f64) -> Option<f64> {
        // What was taken up may have another end.
        let span = options.end_time - started;
        let [start, end] = &self.ends;
        let system = problem.system().as_ref();
        if self.length == 0.0
            || self.length < LONG * span
            || !Self::is_steady([start, end], self.length, system, &options.tolerance)
        {
            return None;
        }
        let eigenvalues_at = |state: &State| {
            let (manifold, state) = problem.start_from(state).ok()?;
            FirstOrder::eigenvalues(manifold, &state).ok()
        };
        let is_same =
            |last: &State| Self::is_steady([end, last], self.length, system, &options.tolerance);
        let finish = match self.last.as_deref() {
            Some((manifold, state)) if is_same(state) => {
                FirstOrder::eigenvalues(manifold.clone(), state).ok()?
            }
            _ => eigenvalues_at(end)?,
        };
        let left = |rate: f64| {
            let until = self.shown_until(span, SHOWN / rate).unwrap_or(start.t);
            options.end_time - until.min(start.t)
        };
        growing(finish, self.length, left, SAME, || eigenvalues_at(start))
    }

    /// Whether every body is as fast at two of its times, but for what a tolerance makes of it: the equations of another
    /// motion do not stay the same, and to see that costs nothing.
    fn is_steady(
        ends: [&State; 2],
        length: f64,
        system: &dyn System,
        tolerance: &Tolerance,
    ) -> bool {
        let sizes = system.structure().sizes;
        let [start, end] = ends.map(|state| {
            let length = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
            sizes.by_body(&state.v).map(move |parts| parts.map(length))
        });
        let (mut fastest, mut change) = ([0.0f64; 2], [0.0f64; 2]);
        for (start, end) in start.zip(end) {
            for k in 0..2 {
                fastest[k] = fastest[k].max(start[k]).max(end[k]);
                change[k] = change[k].max((end[k] - start[k]).abs());
            }
        }
        let allowed = [tolerance.translation, tolerance.rotation].map(|a| a / length);
        (0..2).all(|k| change[k] <= SAME * fastest[k] + allowed[k])
    }
}

/// Rate, 1/s, of the fastest among the eigenvalues at the end of a step of `length`, s, that grows by much in the time that is
/// `left` for one of its rate, is not shown by the step, and was there at its start but for a `change`.
fn growing(
    finish: Vec<(f64, f64)>,
    length: f64,
    left: impl Fn(f64) -> f64,
    change: f64,
    start: impl FnOnce() -> Option<Vec<(f64, f64)>>,
) -> Option<f64> {
    let fastest = finish.iter().map(|z| z.0.hypot(z.1)).fold(0.0, f64::max);
    let hidden = |&(re, im): &(f64, f64)| {
        let rate = re.hypot(im);
        re * left(rate) > GROWTH.ln() && length * rate > SHOWN && rate > KNOWN * fastest
    };
    let growing: Vec<_> = finish.into_iter().filter(hidden).collect();
    if growing.is_empty() {
        return None;
    }
    let before = start()?;
    let stays = |&&(re, im): &&(f64, f64)| {
        let rate = re.hypot(im);
        let is_it = |z: &(f64, f64)| {
            (z.0 - re).abs() < change * re && (z.0 - re).hypot(z.1 - im) < change * rate
        };
        before.iter().any(is_it)
    };
    growing.iter().filter(stays).map(|z| z.0.hypot(z.1)).reduce(f64::max)
}
