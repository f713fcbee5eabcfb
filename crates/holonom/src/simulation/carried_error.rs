//! The errors of steps, carried along with the motion. Equations: `docs/theory/simulation.md` (11), (12).

use crate::method::StateSpace;
use crate::method::stepper::Stepper;
use crate::model::Tolerance;
use crate::system::State;
use serde::{Deserialize, Serialize};

/// Tolerances from which a second run is asked: a fifth of what is warned of, since the carried error is up to a few times
/// too small.
const SUSPICIOUS: f64 = 10.0;
/// Tolerances below which the turn of a reference within a step makes no difference worth its cost.
const NEGLIGIBLE: f64 = 0.1;
/// Places on its way that a run keeps for the comparison with a second one.
const MILESTONES: usize = 8;

/// Most steps of explicit formulas, one-step and multistep, that a matrix serves: it costs as much as some evaluations.
const MOST_STEPS: [u64; 2] = [3, 10];
/// Growth of the error over these steps that a matrix is good for.
const GROWTH: f64 = 2.0;

/// What a run knows of its error: that of its present state, as far as it is estimated, and how large it has been.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct CarriedError {
    /// In w.
    pub(super) error: Vec<f64>,
    /// On coordinates and velocities, at the end of the last step.
    pub(super) spread: [Vec<f64>; 2],
    serving: Serving,
    /// Of the place of a body, in its tolerances: there, and the largest of all.
    present: f64,
    largest: f64,
    pub(super) milestones: Milestones,
}

impl CarriedError {
    /// Of a run with `dimension` unknowns that begins at `start`, without an error.
    pub(super) fn new(dimension: usize, start: &State) -> Self {
        let n = start.q.len();
        Self {
            error: vec![0.0; dimension],
            spread: [vec![0.0; n], vec![0.0; n]],
            serving: Serving { most: 1, ..Serving::default() },
            present: 0.0,
            largest: 0.0,
            milestones: Milestones::new(start),
        }
    }

    /// Whether it can be one of a run with `dimension` unknowns whose states have as many numbers as `state`.
    pub(super) fn fits(&self, dimension: usize, state: &State) -> bool {
        let Self { error, spread: [dq, dv], milestones, .. } = self;
        let Milestones { start, times, places, .. } = milestones;
        let n = state.q.len();
        let lengths = [start.q.len(), start.v.len(), dq.len(), dv.len()];
        error.len() == dimension
            && start.z.len() == state.z.len()
            && start.winding.len() == state.winding.len()
            && lengths == [n; 4]
            && places.len() == n * times.len()
            && times.len() <= MILESTONES
            && milestones.every > 0
    }

    /// The largest error so far, in tolerances of places; it is not followed any further once it is suspicious.
    pub(super) fn largest(&self) -> f64 {
        self.largest
    }

    /// Whether it may be several tolerances.
    pub(super) fn is_suspicious(&self) -> bool {
        self.largest > SUSPICIOUS
    }

    /// Whether it is worth the trouble to turn it along with small turns of references.
    pub(super) fn counts(&self) -> bool {
        self.present > NEGLIGIBLE
    }

    /// Takes the error over the step just accepted, whose own error was estimated as `estimate`, 1 = on tolerance; with
    /// the length of the step and the slope of the equations at its end also what its iterations have left.
    pub(super) fn follow(
        &mut self,
        stepper: &mut dyn Stepper,
        form: &mut dyn StateSpace,
        estimate: f64,
        tolerance: &Tolerance,
        power: &mut [f64],
        iterated: Option<(f64, &[f64])>,
        (t, step, w): (f64, f64, &[f64]),
    ) {
        if self.is_suspicious() {
            return;
        }
        if !stepper.explicit() && self.error.iter().any(|&e| e != 0.0) {
            power.copy_from_slice(&self.error);
            self.error.fill(0.0);
            for c in transfer(stepper.filter_part()) {
                stepper.filter(form, power);
                add(&mut self.error, c, power);
            }
        }
        let part = true_part(
            stepper.orders_of_error(),
            estimate * tolerance.relative.max(tolerance.rotation),
        );
        add(&mut self.error, part, stepper.last_change());
        if let Some((step, slope)) = iterated {
            let part = stepper.filter_part() * step;
            for (x, (g, s)) in power.iter_mut().zip(slope.iter().zip(stepper.end().slope)) {
                *x = part * (g - s);
            }
            stepper.filter(form, power);
            add(&mut self.error, 1.0, power);
        }
        if stepper.explicit()
            && !self.carry_explicitly(stepper.multistep(), form, power, (t, step, w))
        {
            self.present = f64::MAX;
            self.largest = f64::MAX;
            return;
        }
        let [dq, dv] = form.spread(&self.error);
        self.spread[0].copy_from_slice(dq);
        self.spread[1].copy_from_slice(dv);
        self.present = form.displacement(&self.spread[0]);
        if self.present.is_finite() && self.error.iter().sum::<f64>().is_finite() {
            self.largest = self.largest.max(self.present);
        } else {
            self.present = f64::MAX;
            self.largest = f64::MAX;
            self.error.fill(0.0);
        }
    }
}

impl CarriedError {
    /// Carries it over the steps of an explicit formula that there is no matrix for yet, if they are many enough; false
    /// where that cannot be done. Source: `docs/theory/simulation.md` (13).
    fn carry_explicitly(
        &mut self,
        multistep: bool,
        form: &mut dyn StateSpace,
        power: &mut [f64],
        (t, step, w): (f64, f64, &[f64]),
    ) -> bool {
        let Serving { steps, span, most } = &mut self.serving;
        (*steps, *span) = (*steps + 1, *span + step);
        if steps < most {
            return true;
        }
        let (parts, span, most) = (steps.div_ceil(2), *span, *most);
        let part = span / parts as f64;
        if form.linearize(t, w).and_then(|()| form.factor(0.5 * part)).is_err() {
            return false;
        }
        let before = size(form, &self.error, span, power, &mut self.spread[0]);
        for _ in 0..parts {
            power.copy_from_slice(&self.error);
            form.solve(power);
            for (e, s) in self.error.iter_mut().zip(&*power) {
                *e = 2.0 * s - *e;
            }
        }
        let after = size(form, &self.error, span, power, &mut self.spread[0]);
        let grows = after > GROWTH * before;
        let next = if grows { most / 2 } else { 2 * most };
        let most = next.clamp(1, MOST_STEPS[usize::from(multistep)]);
        self.serving = Serving { most, ..Serving::default() };
        true
    }
}

/// Of the places that an error in w makes, in tolerances, with those that its rates make within `span`, s.
/// `room` and `places` are for changes of w and of coordinates.
fn size(
    form: &mut dyn StateSpace,
    error: &[f64],
    span: f64,
    room: &mut [f64],
    places: &mut [f64],
) -> f64 {
    let ndof = form.second_order_split();
    let mut of = |part: &[f64]| {
        room.fill(0.0);
        room[..ndof].copy_from_slice(part);
        places.copy_from_slice(form.spread(room)[0]);
        form.displacement(places)
    };
    of(&error[..ndof]) + span * of(&error[ndof..2 * ndof])
}

/// The steps of an explicit formula since the last matrix.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct Serving {
    steps: u64,
    /// s
    span: f64,
    /// Steps after which the next matrix is due.
    most: u64,
}

fn add(y: &mut [f64], a: f64, x: &[f64]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y += a * x);
}

/// Coefficients of (1 − γz)⁻¹, (1 − γz)⁻², (1 − γz)⁻³ in an approximation of eᶻ of second order that vanishes at
/// infinity. Source: `docs/theory/simulation.md` (12).
fn transfer(gamma: f64) -> [f64; 3] {
    let m = 1.0 / gamma;
    let third = 0.5 * m * m - 2.0 * m + 1.0;
    let second = m - 1.0 - 2.0 * third;
    [1.0 - second - third, second, third]
}

/// Part of an estimate that is the error of a formula of order p whose estimate is that of order p̂, where the estimate
/// is `share` of the scale that tolerances are relative to. Source: `docs/theory/simulation.md` (11).
fn true_part([order, estimated]: [u32; 2], share: f64) -> f64 {
    let exponent = f64::from(order.saturating_sub(estimated)) / f64::from(estimated + 1);
    if share < 1.0 { share.powf(exponent) } else { 1.0 }
}

/// Where a run began and has been, at most [`MILESTONES`] times.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Milestones {
    pub(super) start: State,
    pub(super) times: Vec<f64>,
    /// Rows of coordinates.
    pub(super) places: Vec<f64>,
    /// Steps from one to the next.
    every: u64,
}

impl Milestones {
    fn new(start: &State) -> Self {
        Self {
            start: start.clone(),
            times: Vec::with_capacity(MILESTONES + 1),
            places: Vec::with_capacity((MILESTONES + 1) * start.q.len()),
            every: 1,
        }
    }

    /// Takes the end of a run's step of this number, counted from 1. Where there is no more room, every other one is
    /// left out.
    pub(super) fn pass(&mut self, step: u64, state: &State) {
        if !step.is_multiple_of(self.every) {
            return;
        }
        if self.times.len() == MILESTONES {
            self.every *= 2;
            let n = state.q.len();
            for kept in 0..MILESTONES / 2 {
                let from = 2 * kept + 1;
                self.times[kept] = self.times[from];
                self.places.copy_within(from * n..(from + 1) * n, kept * n);
            }
            self.times.truncate(MILESTONES / 2);
            self.places.truncate(MILESTONES / 2 * n);
            if !step.is_multiple_of(self.every) {
                return;
            }
        }
        self.push(state);
    }

    /// Takes the end of the run.
    pub(super) fn end(&mut self, state: &State) {
        if self.times.last() != Some(&state.t) {
            self.push(state);
        }
    }

    fn push(&mut self, state: &State) {
        self.times.push(state.t);
        self.places.extend_from_slice(&state.q);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::newton::Complex64;

    #[test] // independent truth: the exponential function
    fn errors_are_carried_to_second_order_and_no_vibration_grows() {
        for gamma in [0.25, 4.0 / 15.0, 0.274_888_829_595_68, 0.5, 0.572_816_062_482_134_9] {
            let growth = |z: Complex64| -> Complex64 {
                let s = (Complex64::new(1.0, 0.0) - gamma * z).inv();
                let [a, b, c] = transfer(gamma);
                s * (a + s * (b + s * c))
            };
            for direction in [Complex64::new(-1.0, 0.0), Complex64::new(0.0, 1.0)] {
                let off = |h: f64| (growth(h * direction) - (h * direction).exp()).norm();
                let order = (off(2e-2) / off(1e-2)).log2();
                assert!(order > 2.9, "γ = {gamma}: {order}");
            }
            let vibrations =
                (0..100).map(|k| growth(Complex64::new(0.0, 1.1f64.powi(k - 40))).norm());
            assert!(vibrations.fold(0.0, f64::max) < 1.0 + 1e-12, "γ = {gamma}");
            assert!(growth(Complex64::new(-1e9, 0.0)).norm() < 1e-8);
        }
    }

    #[test] // independent truth: the definition
    fn milestones_spread_over_the_run() {
        let state = |t: u64| State { t: t as f64, q: vec![t as f64, -1.0], ..State::default() };
        let mut milestones = Milestones::new(&state(0));
        for step in 1..=1000 {
            milestones.pass(step, &state(step));
            assert!(milestones.times.len() <= MILESTONES);
        }
        milestones.end(&state(1000));
        let known = [128.0, 256.0, 384.0, 512.0, 640.0, 768.0, 896.0, 1000.0];
        assert_eq!(milestones.times, known);
        assert_eq!(milestones.places, known.map(|t| [t, -1.0]).concat());
    }
}
