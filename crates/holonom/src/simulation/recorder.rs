//! States inside accepted steps, for output rows and the energy ledger.

use super::ledger::StepPowers;
use crate::error::EvaluationFailure;
use crate::reduction::{Chart, Point};
use crate::system::{Ledger, State};

/// Pieces of a step in which a state inside it is approached when it cannot be recovered at once.
const PIECES: u32 = 16;

/// What a state inside an accepted step is made of, beside the chart at its start.
pub(super) struct Inside<'a> {
    /// Start of the step, s.
    pub(super) t: f64,
    /// Its length, s.
    pub(super) step: f64,
    /// Dense output w(θ).
    pub(super) interpolate: &'a mut dyn FnMut(f64, &mut [f64]),
    /// Ledger at the start.
    pub(super) ledger: Ledger,
    /// Powers along the step, where w does not end with their integrals.
    pub(super) powers: StepPowers,
}

/// Evaluates states inside an accepted step at a point of its own: what is written out cannot touch
/// the factors that steps are computed with.
#[derive(Debug, Clone)]
pub(super) struct Recorder {
    point: Point,
    w: Vec<f64>,
    /// Whether w ends with the energy ledger.
    integrates_powers: bool,
}

impl Recorder {
    /// A recorder beside the point of the steps.
    pub(super) fn new(point: &Point, dimension: usize, integrates_powers: bool) -> Self {
        Self { point: point.beside(), w: vec![0.0; dimension], integrates_powers }
    }

    /// The next step starts at `state`, in the parametrization and with the references of `point`.
    pub(super) fn begin_step(&mut self, point: &Point, state: &State) {
        self.point.manifold.follow(&point.manifold);
        self.point.begin_step(state);
    }

    /// The same step once more.
    pub(super) fn begin_again(&mut self, state: &State) {
        self.point.begin_step(state);
    }

    /// Makes what is made at a first evaluation: none of the steps is the place for it.
    pub(super) fn prepare(&mut self, w: &[f64], state: &State) {
        // Where this fails the run does, too.
        let _ = self.evaluate_at(w, state);
    }

    fn evaluate_at(&mut self, w: &[f64], state: &State) -> Result<(), EvaluationFailure> {
        let ndof = self.point.manifold.chart().ndof();
        let (p, rest) = w.split_at(ndof);
        let (rates, z) = rest.split_at(ndof);
        self.point.evaluate(state.t, p, rates, &z[..state.z.len()], true)
    }

    /// The steps have got another parametrization.
    pub(super) fn set_chart(&mut self, chart: Chart) {
        self.point.manifold.set_chart(chart);
    }

    /// The next step is a stored one: it starts at time t and the configuration q with its windings and
    /// independent variables `p`; references of directions and rotations stand there if `turning`, those
    /// of directions with these normals.
    ///
    /// # Errors
    /// Where the parametrization does not serve.
    pub(super) fn stand_at(
        &mut self,
        t: f64,
        q: &[f64],
        p: &[f64],
        winding: &[f64],
        turning: bool,
        normals: impl Iterator<Item = (usize, [f64; 3])>,
    ) -> Result<(), EvaluationFailure> {
        self.point.anchor.copy_from_slice(q);
        self.point.state.q.copy_from_slice(q);
        self.point.state.winding.copy_from_slice(winding);
        self.point.manifold.stand_at(t, q, p, winding, turning, normals)
    }

    /// Gives the state that the next step starts from, whose w is `w`, its multipliers; as they are where this
    /// cannot be evaluated.
    pub(super) fn complete(&mut self, w: &[f64], state: &mut State) {
        if self.evaluate_at(w, state).is_ok() {
            self.point.complete();
            state.lambda.copy_from_slice(&self.point.state.lambda);
            self.point.manifold.minimum_norm_multipliers(&mut state.lambda);
        }
    }

    /// The row of a time inside a step: state with accelerations, multipliers, windings and ledger.
    ///
    /// # Errors
    /// Where dependent coordinates are not found.
    pub(super) fn row(
        &mut self,
        inside: &mut Inside<'_>,
        time: f64,
        row: &mut State,
    ) -> Result<(), EvaluationFailure> {
        let Inside { t, step, ledger, powers, .. } = *inside;
        let theta = ((time - t) / step).clamp(0.0, 1.0);
        row.copy_from(self.state(inside.interpolate, t, step, theta, true)?);
        row.t = time;
        self.point.manifold.minimum_norm_multipliers(&mut row.lambda);
        self.point.manifold.system().update_windings(time, &row.q, &mut row.winding);
        row.ledger.initial = ledger.initial;
        if !self.integrates_powers {
            row.ledger = powers.advance(&ledger, step, theta);
        }
        Ok(())
    }

    /// State at t + θ step of an accepted step of length `step` from t with dense output `interpolate`, with
    /// accelerations and multipliers if `full`. Where it cannot be recovered at once, the motion is followed in small pieces.
    ///
    /// # Errors
    /// Where dependent coordinates are not found.
    pub(super) fn state(
        &mut self,
        interpolate: &mut dyn FnMut(f64, &mut [f64]),
        t: f64,
        step: f64,
        theta: f64,
        full: bool,
    ) -> Result<&State, EvaluationFailure> {
        self.recover(interpolate, t, step, theta, full)?;
        if full {
            self.point.complete();
        }
        Ok(&self.point.state)
    }

    /// The same without multipliers, into the point.
    fn recover(
        &mut self,
        interpolate: &mut dyn FnMut(f64, &mut [f64]),
        t: f64,
        step: f64,
        theta: f64,
        full: bool,
    ) -> Result<(), EvaluationFailure> {
        if self.evaluate(interpolate, t, step, theta, full).is_err() {
            for k in 1..PIECES {
                let part = theta * f64::from(k) / f64::from(PIECES);
                self.evaluate(interpolate, t, step, part, false)?;
            }
            self.evaluate(interpolate, t, step, theta, full)?;
        }
        Ok(())
    }

    /// Slope that the equations give at such a state, in the velocity entries of `slope`.
    ///
    /// # Errors
    /// As [`Recorder::state`].
    pub(super) fn slope(
        &mut self,
        interpolate: &mut dyn FnMut(f64, &mut [f64]),
        t: f64,
        step: f64,
        theta: f64,
        slope: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        self.recover(interpolate, t, step, theta, true)?;
        let Point { manifold, state, .. } = &mut self.point;
        let ndof = manifold.chart().ndof();
        manifold.independent_acceleration_anew(state, &mut slope[ndof..2 * ndof]);
        Ok(())
    }

    /// The state at w, without accelerations.
    ///
    /// # Errors
    /// Where dependent coordinates are not found.
    pub(super) fn state_at(&mut self, t: f64, w: &[f64]) -> Result<&State, EvaluationFailure> {
        self.evaluate(&mut |_, to: &mut [f64]| to.copy_from_slice(w), t, 0.0, 0.0, false)?;
        Ok(&self.point.state)
    }

    /// Slope of an explicit formula at w, beside the run.
    ///
    /// # Errors
    /// As [`Recorder::state`].
    pub(super) fn slope_at(
        &mut self,
        t: f64,
        w: &[f64],
        slope: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        self.evaluate(&mut |_, to: &mut [f64]| to.copy_from_slice(w), t, 0.0, 0.0, true)?;
        let Point { manifold, state, z_rate, .. } = &mut self.point;
        let ndof = manifold.chart().ndof();
        slope[..ndof].copy_from_slice(&w[ndof..2 * ndof]);
        manifold.independent_acceleration_anew(state, &mut slope[ndof..2 * ndof]);
        let end = 2 * ndof + z_rate.len();
        slope[2 * ndof..end].copy_from_slice(z_rate);
        slope[end..].fill(0.0);
        if self.integrates_powers {
            let energy = manifold.system().energy(state);
            slope[end..].copy_from_slice(&[energy.dissipated, energy.supplied]);
        }
        Ok(())
    }

    fn evaluate(
        &mut self,
        interpolate: &mut dyn FnMut(f64, &mut [f64]),
        t: f64,
        step: f64,
        theta: f64,
        full: bool,
    ) -> Result<(), EvaluationFailure> {
        interpolate(theta, &mut self.w);
        let ndof = self.point.manifold.chart().ndof();
        let (p, rest) = self.w.split_at(ndof);
        let (rates, rest) = rest.split_at(ndof);
        let (z, powers) = rest.split_at(self.point.z_rate.len());
        self.point.evaluate(t + theta * step, p, rates, z, full)?;
        if self.integrates_powers {
            let ledger = &mut self.point.state.ledger;
            (ledger.dissipated, ledger.supplied) = (powers[0], powers[1]);
        }
        Ok(())
    }
}
