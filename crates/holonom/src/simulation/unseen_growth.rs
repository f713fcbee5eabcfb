//! Growth that long steps do not see. Equations: `docs/theory/simulation.md` (14).

use super::options::Options;
use super::problem::Problem;
use crate::method::FirstOrder;
use crate::model::Tolerance;
use crate::reduction::Manifold;
use crate::system::{State, System};
use serde::{Deserialize, Serialize};

/// More unknowns than this are not looked at: eigenvalues of so many take a tenth of a second.
const MOST_UNKNOWNS: usize = 200;
/// Where no step takes this part of a run, it is not looked at: steps that show nothing are few.
const LONG: f64 = 0.01;
/// Lengths of steps are told apart by this factor, down to about 1e-12 of a run.
const APART: f64 = 1.2;
const LENGTHS: usize = 152;
/// Steps show growth and vibrations of less than so many radians.
const SHOWN: f64 = 0.5;
/// Growth of what a step may leave, which is a tolerance, from which it is suspicious.
const GROWTH: f64 = 10.0;
/// Relative difference of an eigenvalue at both ends of a step in which it stays the same.
const SAME: f64 = 0.1;
/// Eigenvalues are known to about this part of the largest one, as round-off splits multiple ones.
const KNOWN: f64 = 1e-6;

/// The longest step of a run, if it is a large part of it.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct LongestStep {
    length: f64,
    ends: [State; 2],
    /// The end of the last step, s, that was shorter than the span of the run divided by a power of [`APART`], by that power; the start where
    /// there was none.
    #[serde(default)]
    shorter_until: Vec<f64>,
    /// The end of the run, where the motion is the same as at the end of this step: equations that stand there need not be
    /// set up.
    #[serde(skip)]
    last: Option<Box<(Manifold, State)>>,
}

impl LongestStep {
    /// Of a run with so many unknowns that starts at `state`; none where there are too many of them.
    pub(super) fn new(unknowns: usize, state: &State) -> Option<Self> {
        (unknowns <= MOST_UNKNOWNS).then(|| Self {
            length: 0.0,
            ends: [state.clone(), state.clone()],
            shorter_until: vec![state.t; LENGTHS],
            last: None,
        })
    }

    /// Whether its ends can be states of a run that is at `state`.
    pub(super) fn fits(&self, state: &State) -> bool {
        let sizes = |s: &State| [&s.q, &s.v, &s.a, &s.lambda, &s.z, &s.winding].map(Vec::len);
        self.ends.iter().all(|end| sizes(end) == sizes(state))
            && [0, LENGTHS].contains(&self.shorter_until.len())
    }

    /// Takes a step of a run of `span`, s.
    pub(super) fn take(&mut self, span: f64, start: &State, end: &State) {
        let length = end.t - start.t;
        let place = Self::place(span, length);
        if let Some(until) = self.shorter_until.get_mut(place) {
            *until = end.t;
        }
        if length >= LONG * span && length > self.length {
            self.length = length;
            self.ends[0].copy_from(start);
            self.ends[1].copy_from(end);
        }
    }

    /// The place of a length among those that are told apart, the longest first.
    fn place(span: f64, length: f64) -> usize {
        ((span / length).ln() / APART.ln()) as usize
    }

    /// The time, s, from which on no step of a run of `span`, s, up to the longest one was as short as `length`.
    fn shown_until(&self, span: f64, length: f64) -> f64 {
        let shorter = self.shorter_until.iter().skip(Self::place(span, length));
        let until = shorter.fold(f64::NEG_INFINITY, |latest, until| latest.max(*until));
        // A checkpoint of before does not say.
        if until.is_finite() { until.min(self.ends[0].t) } else { self.ends[0].t }
    }

    /// The run has ended at `state`, which the manifold stands at.
    pub(super) fn end(&mut self, manifold: &Manifold, state: &State, tolerance: &Tolerance) {
        let system = manifold.system().as_ref();
        let same = self.length > 0.0
            && self.is_steady([&self.ends[0], &self.ends[1]], system, tolerance)
            && self.is_steady([&self.ends[1], state], system, tolerance);
        self.last = same.then(|| Box::new((manifold.clone(), state.clone())));
    }

    /// The longest step, s, that shows what grows up to the end of a run by `options` from `started`, s, while the
    /// motion goes on as in this step, which does not show it.
    pub(super) fn hides_growth(
        &self,
        problem: &Problem,
        options: &Options,
        started: f64,
    ) -> Option<f64> {
        // What was taken up may have another end.
        let span = options.end_time - started;
        let long = LONG * span;
        let [start, end] = &self.ends;
        let steady = || self.is_steady([start, end], problem.system().as_ref(), &options.tolerance);
        if self.length == 0.0 || self.length < long || !steady() {
            return None;
        }
        let eigenvalues_at = |state: &State| {
            let (manifold, state) = problem.start_from(state).ok()?;
            FirstOrder::eigenvalues(manifold, &state).ok()
        };
        let finish = match self.last.as_deref() {
            Some((manifold, state)) => FirstOrder::eigenvalues(manifold.clone(), state).ok()?,
            None => eigenvalues_at(end)?,
        };
        let fastest = finish.iter().map(|z| z.0.hypot(z.1)).fold(0.0, f64::max);
        let hidden = |&(re, im): &(f64, f64)| {
            let rate = re.hypot(im);
            let left = options.end_time - self.shown_until(span, SHOWN / rate);
            re * left > GROWTH.ln() && self.length * rate > SHOWN && rate > KNOWN * fastest
        };
        let growing: Vec<_> = finish.into_iter().filter(hidden).collect();
        if growing.is_empty() {
            return None;
        }
        let before = eigenvalues_at(start)?;
        let stays = |&&(re, im): &&(f64, f64)| {
            let rate = re.hypot(im);
            before
                .iter()
                .any(|z| (z.0 - re).abs() < SAME * re && (z.0 - re).hypot(z.1 - im) < SAME * rate)
        };
        let rate = growing.iter().filter(stays).map(|z| z.0.hypot(z.1)).fold(0.0, f64::max);
        (rate > 0.0).then(|| SHOWN / rate)
    }

    /// Whether every body is as fast at two of its times, but for what a tolerance makes of it: the equations of another
    /// motion do not stay the same, and to see that costs nothing.
    fn is_steady(&self, ends: [&State; 2], system: &dyn System, tolerance: &Tolerance) -> bool {
        let sizes = system.structure().sizes;
        let [start, end] = ends.map(|state| {
            state.v.chunks_exact(sizes.per_body).map(|v| {
                <[&[f64]; 2]>::from(v.split_at(sizes.translations))
                    .map(|v| v.iter().map(|v| v * v).sum::<f64>().sqrt())
            })
        });
        let (mut fastest, mut change) = ([0.0f64; 2], [0.0f64; 2]);
        for (start, end) in start.zip(end) {
            for k in 0..2 {
                fastest[k] = fastest[k].max(start[k]).max(end[k]);
                change[k] = change[k].max((end[k] - start[k]).abs());
            }
        }
        let allowed = [tolerance.translation, tolerance.rotation].map(|a| a / self.length);
        (0..2).all(|k| change[k] <= SAME * fastest[k] + allowed[k])
    }
}
