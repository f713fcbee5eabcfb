//! Dense output: accepted steps with all that the states inside them are made of, and its evaluation.

use super::ledger::StepPowers;
use super::output::CHUNK_STEPS;
use super::problem::Problem;
use super::recorder::{Inside, Recorder};
use crate::error::EvaluationFailure;
use crate::method::interpolate;
use crate::method::stepper::Stepper;
use crate::reduction::assembly::manifold_of;
use crate::reduction::{Chart, Parametrization, Point, Projection};
use crate::system::{Ledger, RelativeKind, State, System};
use crate::topology::Forest;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Numbers of [`StepPowers`].
pub(super) const STEP_POWERS: usize = 10;
/// Those of results stored before drivers had powers at quarters: at start, middle and end of a step.
const STEP_POWERS_BEFORE: usize = 6;
/// Numbers of the ledger.
const LEDGER: usize = 3;
/// Numbers of a normal.
const NORMAL: usize = 3;
/// Numbers that a chunk has room for.
const ROOM: usize = 1 << 19;

/// A chart as the steps of a run use it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChartRecord {
    /// First time at which it serves, s.
    pub t: f64,
    /// Configuration there.
    pub q: Vec<f64>,
    /// Forest of the system, which numbers edges and groups.
    pub forest: Forest,
    /// Independent variables, with references and anchors as they stand there.
    pub parametrization: Parametrization,
    /// Whether references of directions and rotations move to the start of every step; else they stay.
    pub follows: bool,
    /// Whether rotations of bushings are along their own axes, as they are now.
    #[serde(default)]
    pub own_axes: bool,
    /// Bushings whose deformations are measured along axes of their second body; none in records of before.
    #[serde(default)]
    pub in_second_axes: Vec<usize>,
}

impl ChartRecord {
    /// Whether sizes and places are those of the system.
    pub(super) fn fits(&self, system: &dyn System) -> bool {
        let sizes = system.structure().sizes;
        let p = &self.parametrization;
        let projected = match &p.projection {
            Projection::Selection(independent) => {
                independent.len() == p.ndof && independent.iter().all(|&i| i < sizes.coordinates)
            }
            Projection::Basis(rows) => rows.len() == p.ndof * sizes.coordinates,
            Projection::Relative(relatives) => {
                relatives.fits(p.ndof, sizes.rows, system.tree(), system.relative_groups())
            }
        };
        projected
            && self.has_axes_of(system)
            && self.q.len() == sizes.coordinates
            && p.kept.len() + p.ndof == sizes.coordinates
            && p.kept.iter().chain(&p.dropped).all(|&row| row < sizes.rows)
    }

    /// Whether deformations of bushings, where they are variables, are along the axes that the system measures them along.
    pub(super) fn has_axes_of(&self, system: &dyn System) -> bool {
        let own = || system.relative_groups().iter().any(|group| group.has_own_axes);
        self.parametrization.relatives().is_none()
            || (self.in_second_axes == system.tree().in_second_axes && (self.own_axes || !own()))
    }

    /// Groups of directions whose normals stand in the segments.
    fn carried(&self, system: &dyn System) -> Vec<usize> {
        match self.parametrization.relatives() {
            Some(relatives) if self.follows => relatives.carried(system),
            _ => Vec::new(),
        }
    }
}

/// Accepted steps, in rows: start, length, chart, and what the state at any time inside is made of.
///
/// w(θ) = Σⱼ cⱼ θʲ with θ = (time − t)/h and w = (v, v̇, z), for explicit codes also the energy dissipated and
/// supplied. Positions, velocities, accelerations and multipliers follow from w in the chart, starting
/// from q.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Segments {
    /// Charts that are new here.
    pub charts: Vec<ChartRecord>,
    /// Number of charts before those.
    pub charts_before: usize,
    /// Starts, s.
    pub t: Vec<f64>,
    /// Lengths, s.
    pub h: Vec<f64>,
    /// End of the last step, s.
    pub end: f64,
    /// Charts by their number in the run, from 0.
    pub chart: Vec<usize>,
    /// Degrees of w(θ).
    pub degree: Vec<usize>,
    /// Rows of generalized coordinates at the start.
    pub q: Vec<f64>,
    /// Rows of windings there.
    pub winding: Vec<f64>,
    /// Per step, a normal of each direction in space that edges or independent variables are measured from, if
    /// references follow the steps; ground axes.
    pub normals: Vec<f64>,
    /// Rows of the energy ledger there: initial, dissipated, supplied, J.
    pub ledger: Vec<f64>,
    /// Rows of powers, W: dissipated and supplied at θ = 0, ¼, ½, ¾, 1; empty where w has their integrals.
    pub powers: Vec<f64>,
    /// Per step, the coefficients c₀, c₁, … of w(θ).
    pub w: Vec<f64>,
    /// Length of w.
    pub dimension: usize,
    largest_degree: usize,
    /// Groups of the normals.
    carried: Vec<usize>,
    room: usize,
}

impl Segments {
    /// No steps, with room for a chunk of those that start at states like `state`.
    pub(super) fn with_room(
        system: &dyn System,
        state: &State,
        dimension: usize,
        largest_degree: usize,
        powers: usize,
    ) -> Self {
        let (n, windings) = (state.q.len(), state.winding.len());
        let coefficients = dimension * (largest_degree + 1);
        let directions =
            system.relative_groups().iter().filter(|g| g.kind == RelativeKind::Direction);
        let normals = NORMAL * directions.count();
        let room = (ROOM / (n + windings + normals + LEDGER + powers + coefficients))
            .clamp(1, CHUNK_STEPS);
        Self {
            charts: Vec::new(),
            charts_before: 0,
            t: Vec::with_capacity(room),
            h: Vec::with_capacity(room),
            end: f64::NAN,
            chart: Vec::with_capacity(room),
            degree: Vec::with_capacity(room),
            q: Vec::with_capacity(room * n),
            winding: Vec::with_capacity(room * windings),
            normals: Vec::with_capacity(room * normals),
            ledger: Vec::with_capacity(room * LEDGER),
            powers: Vec::with_capacity(room * powers),
            w: Vec::with_capacity(room * coefficients),
            dimension,
            largest_degree,
            carried: Vec::new(),
            room,
        }
    }

    /// Number of steps.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    pub(super) fn is_full(&self) -> bool {
        self.room > 0 && self.len() >= self.room
    }

    /// The chart of the steps that follow.
    pub(super) fn push_chart(&mut self, system: &dyn System, chart: ChartRecord) {
        self.carried = chart.carried(system);
        self.charts.push(chart);
    }

    /// The step that `stepper` has accepted: from `start` over `step` to the time `end`, in the chart that
    /// still stands at the start.
    pub(super) fn push(
        &mut self,
        start: &State,
        chart: &Chart,
        step: f64,
        end: f64,
        powers: Option<&StepPowers>,
        stepper: &dyn Stepper,
    ) {
        self.t.push(start.t);
        self.h.push(step);
        self.end = end;
        self.chart.push(self.charts_before + self.charts.len() - 1);
        self.q.extend_from_slice(&start.q);
        self.winding.extend_from_slice(&start.winding);
        if let Some(relatives) = chart.parametrization().relatives() {
            for &group in &self.carried {
                self.normals.extend_from_slice(&relatives.references[group][3..]);
            }
        }
        let Ledger { initial, dissipated, supplied } = start.ledger;
        self.ledger.extend([initial, dissipated, supplied]);
        if let Some(powers) = powers {
            self.powers.extend_from_slice(powers.at.as_flattened());
        }
        let at = self.w.len();
        self.w.resize(at + self.dimension * (self.largest_degree + 1), 0.0);
        let degree = stepper.polynomial(&mut self.w[at..]);
        self.w.truncate(at + self.dimension * (degree + 1));
        self.degree.push(degree);
    }

    /// Forgets steps and charts that have been handed out, but for their number.
    pub(super) fn clear(&mut self) {
        self.charts_before += self.charts.len();
        self.charts.clear();
        for rows in [&mut self.t, &mut self.h, &mut self.q, &mut self.winding] {
            rows.clear();
        }
        for rows in [&mut self.normals, &mut self.ledger, &mut self.powers, &mut self.w] {
            rows.clear();
        }
        self.chart.clear();
        self.degree.clear();
    }

    /// Adds the steps that come next.
    pub fn extend(&mut self, next: &Self) {
        self.charts.extend_from_slice(&next.charts);
        self.chart.extend_from_slice(&next.chart);
        self.degree.extend_from_slice(&next.degree);
        self.t.extend_from_slice(&next.t);
        self.h.extend_from_slice(&next.h);
        self.q.extend_from_slice(&next.q);
        self.winding.extend_from_slice(&next.winding);
        self.normals.extend_from_slice(&next.normals);
        self.ledger.extend_from_slice(&next.ledger);
        self.powers.extend_from_slice(&next.powers);
        self.w.extend_from_slice(&next.w);
        (self.end, self.dimension) = (next.end, next.dimension);
    }
}

/// States at any time of stored steps, on the constraint manifold: what output rows at these times would
/// have been, to round-off.
#[derive(Debug)]
pub struct DenseOutput {
    system: Arc<dyn System>,
    segments: Segments,
    /// Where the coefficients and the normals of each step begin.
    first: Vec<[usize; 2]>,
    /// Per chart, the groups of its normals.
    carried: Vec<Vec<usize>>,
    /// Number of the chart of the last evaluation, with a recorder that is copied for each: pivots that one
    /// evaluation has chosen do not show in the next.
    current: Option<(usize, Recorder)>,
}

impl DenseOutput {
    /// A reader of steps of a run of `problem`, or of one that differs from it in nothing.
    ///
    /// # Errors
    /// `simulation/dense-output` where they are not steps of this model.
    pub fn new(problem: &Problem, mut segments: Segments) -> Result<Self, EvaluationFailure> {
        let problem = match segments.charts.first() {
            Some(chart) => problem.along(&chart.forest),
            None => Some(problem.clone()),
        };
        let system = problem.ok_or_else(|| foreign(FOREIGN.to_owned()))?.system().clone();
        if segments.powers.len() == STEP_POWERS_BEFORE * segments.len() {
            segments.powers = of_five_moments(&segments.powers);
        }
        check(system.as_ref(), &segments)?;
        let carried: Vec<_> = segments.charts.iter().map(|c| c.carried(system.as_ref())).collect();
        let mut first = Vec::with_capacity(segments.len());
        let mut at = [0, 0];
        for (degree, chart) in segments.degree.iter().zip(&segments.chart) {
            first.push(at);
            at[0] += segments.dimension * (degree + 1);
            at[1] += NORMAL * carried[chart - segments.charts_before].len();
        }
        if at != [segments.w.len(), segments.normals.len()] {
            return Err(foreign(FOREIGN.to_owned()));
        }
        Ok(Self { system, segments, first, carried, current: None })
    }

    /// First and last time, s; none without steps.
    pub fn span(&self) -> Option<(f64, f64)> {
        self.segments.t.first().map(|&t| (t, self.segments.end))
    }

    /// The state at a time within the span, with accelerations, multipliers, windings and ledger. It does
    /// not depend on what was asked before.
    ///
    /// # Errors
    /// `simulation/dense-output` outside of the span; where dependent coordinates are not found.
    pub fn state(&mut self, time: f64) -> Result<State, EvaluationFailure> {
        let inside = self.span().is_some_and(|(first, last)| first <= time && time <= last);
        if !inside {
            return Err(foreign(format!("no step is stored at {time} s")));
        }
        let k = self.segments.t.partition_point(|&t| t <= time) - 1;
        let mut state = State::zeros(&self.system.structure().sizes);
        let number = self.segments.chart[k];
        let known = self.current.take().filter(|(known, _)| *known == number);
        let recorder = match known {
            Some((_, recorder)) => recorder,
            None => self.recorder(number, &mut state)?,
        };
        let mut copy = recorder.clone();
        self.current = Some((number, recorder));
        self.evaluate(&mut copy, k, time, &mut state)?;
        Ok(state)
    }

    /// A recorder in a chart, whose pivots are those of its first step.
    fn recorder(&self, number: usize, row: &mut State) -> Result<Recorder, EvaluationFailure> {
        let segments = &self.segments;
        let record = &segments.charts[number - segments.charts_before];
        let manifold = manifold_of(&self.system, &record.parametrization, &record.q)?;
        let point = Point::new(manifold, row);
        let integrates = segments.powers.is_empty();
        let mut recorder = Recorder::new(&point, segments.dimension, integrates);
        if let Some(k) = segments.chart.iter().position(|chart| *chart == number) {
            self.evaluate(&mut recorder, k, segments.t[k], row)?;
            recorder.set_chart(point.manifold.chart().clone());
        }
        Ok(recorder)
    }

    fn evaluate(
        &self,
        recorder: &mut Recorder,
        k: usize,
        time: f64,
        row: &mut State,
    ) -> Result<(), EvaluationFailure> {
        let Self { system, segments, first, carried, .. } = self;
        let sizes = &system.structure().sizes;
        let number = segments.chart[k];
        let record = &segments.charts[number - segments.charts_before];
        let (n, windings) = (sizes.coordinates, sizes.windings);
        let ndof = record.parametrization.ndof;
        let w = &segments.w[first[k][0]..][..segments.dimension * (segments.degree[k] + 1)];
        let (t, step) = (segments.t[k], segments.h[k]);
        let q = &segments.q[k * n..(k + 1) * n];
        let winding = &segments.winding[k * windings..(k + 1) * windings];
        let normals = segments.normals[first[k][1]..].chunks_exact(NORMAL);
        let normals = carried[number - segments.charts_before]
            .iter()
            .zip(normals)
            .map(|(&group, normal)| (group, [normal[0], normal[1], normal[2]]));
        recorder.stand_at(t, q, &w[..ndof], winding, record.follows, normals)?;
        let ledger = &segments.ledger[k * LEDGER..];
        let ledger = Ledger { initial: ledger[0], dissipated: ledger[1], supplied: ledger[2] };
        let mut powers = StepPowers::default();
        if !segments.powers.is_empty() {
            let stored = &segments.powers[k * STEP_POWERS..(k + 1) * STEP_POWERS];
            powers.at.as_flattened_mut().copy_from_slice(stored);
        }
        let interpolate = &mut |theta: f64, out: &mut [f64]| interpolate(w, theta, out);
        recorder.row(&mut Inside { t, step, interpolate, ledger, powers }, time, row)
    }
}

const FOREIGN: &str = "the stored steps are not those of this model, or an earlier version measured it by other coordinates";

fn foreign(message: String) -> EvaluationFailure {
    EvaluationFailure::new("simulation/dense-output", message)
}

/// Powers of steps that were stored with those at start, middle and end alone.
fn of_five_moments(powers: &[f64]) -> Vec<f64> {
    let steps = powers.chunks_exact(STEP_POWERS_BEFORE);
    let through = |at: &[f64]| {
        let [start, middle, end] = [0, 2, 4].map(|k| [at[k], at[k + 1]]);
        StepPowers::through(start, &[middle], end).at
    };
    steps.flat_map(|at| through(at).as_flattened().to_vec()).collect()
}

/// Whether steps and charts have the sizes of the system.
fn check(system: &dyn System, segments: &Segments) -> Result<(), EvaluationFailure> {
    let sizes = system.structure().sizes;
    let count = segments.len();
    let charts = segments.charts_before..segments.charts_before + segments.charts.len();
    let rows = [
        (segments.h.len(), count),
        (segments.chart.len(), count),
        (segments.degree.len(), count),
        (segments.q.len(), count * sizes.coordinates),
        (segments.winding.len(), count * sizes.windings),
        (segments.ledger.len(), count * LEDGER),
    ];
    let powers = segments.powers.len();
    let fits = |record: &ChartRecord| {
        let ndof = record.parametrization.ndof;
        record.fits(system) && 2 * ndof + sizes.extra_states <= segments.dimension
    };
    if rows.iter().all(|(found, expected)| found == expected)
        && (powers == 0 || powers == count * STEP_POWERS)
        && segments.chart.iter().all(|number| charts.contains(number))
        && segments.charts.iter().all(fits)
    {
        return Ok(());
    }
    Err(foreign(FOREIGN.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test] // independent truth: the integral of the parabola that older results were evaluated by, in closed form
    fn powers_of_older_results_are_those_of_their_parabola() {
        let dissipated = |s: f64| 3.0 - s + 4.0 * s * s;
        let stored = |from: f64| {
            [0.0, 0.5, 1.0].map(|theta| [dissipated(from + theta), -2.0]).as_flattened().to_vec()
        };
        let powers = of_five_moments(&[stored(0.0), stored(1.0)].concat());
        assert_eq!(powers.len(), 2 * STEP_POWERS);
        for (row, from) in powers.chunks_exact(STEP_POWERS).zip([0.0, 1.0]) {
            let mut step = StepPowers::default();
            step.at.as_flattened_mut().copy_from_slice(row);
            let ledger = step.advance(&Ledger::default(), 1.0, 0.3);
            let integral = |s: f64| 3.0 * s - s * s / 2.0 + 4.0 * s.powi(3) / 3.0;
            assert!((ledger.dissipated - (integral(from + 0.3) - integral(from))).abs() < 1e-14);
            assert!((ledger.supplied + 0.6).abs() < 1e-15);
        }
    }
}
