//! States inside accepted steps, for output rows and the energy ledger.

use crate::error::EvaluationFailure;
use crate::method::stepper::Stepper;
use crate::reduction::{Chart, Point};
use crate::system::State;

/// Pieces of a step in which a state inside it is approached when it cannot be recovered at once.
const PIECES: u32 = 16;

/// Evaluates states inside the last accepted step at a point of its own: what is written out cannot touch
/// the factors that steps are computed with.
pub(super) struct Recorder {
    point: Point,
    w: Vec<f64>,
    /// Whether w ends with the energy ledger.
    integrates_powers: bool,
}

impl Recorder {
    /// A recorder beside the point of the steps.
    pub(super) fn new(point: &Point, dimension: usize, integrates_powers: bool) -> Self {
        Self { point: point.clone(), w: vec![0.0; dimension], integrates_powers }
    }

    /// The next step starts at `state`, in the parametrization and with the references of `point`.
    pub(super) fn begin_step(&mut self, point: &Point, state: &State) {
        self.point.manifold.follow(&point.manifold);
        self.point.begin_step(state);
    }

    /// The steps have got another parametrization.
    pub(super) fn set_chart(&mut self, chart: Chart) {
        self.point.manifold.set_chart(chart);
    }

    /// State at t + θ step of the last accepted step of length `step` from t, with accelerations and
    /// multipliers if `full`. Where it cannot be recovered at once, the motion is followed in small pieces.
    ///
    /// # Errors
    /// Where dependent coordinates are not found.
    pub(super) fn state(
        &mut self,
        stepper: &mut dyn Stepper,
        t: f64,
        step: f64,
        theta: f64,
        full: bool,
    ) -> Result<&State, EvaluationFailure> {
        if self.evaluate(stepper, t, step, theta, full).is_err() {
            for k in 1..PIECES {
                let part = theta * f64::from(k) / f64::from(PIECES);
                self.evaluate(stepper, t, step, part, false)?;
            }
            self.evaluate(stepper, t, step, theta, full)?;
        }
        if full {
            self.point.complete();
        }
        Ok(&self.point.state)
    }

    /// Replaces multipliers of redundant rows by those of minimum norm, at the state last evaluated.
    pub(super) fn distribute(&mut self, lambda: &mut [f64]) {
        self.point.manifold.minimum_norm_multipliers(lambda);
    }

    fn evaluate(
        &mut self,
        stepper: &mut dyn Stepper,
        t: f64,
        step: f64,
        theta: f64,
        full: bool,
    ) -> Result<(), EvaluationFailure> {
        stepper.interpolate(theta, &mut self.w);
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
