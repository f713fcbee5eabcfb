//! The part of the carried error that lies along the motion: being ahead of it or behind. Equations:
//! `docs/theory/simulation.md` (12c).

use super::carried_error::{Carried, CarriedError, Stepped, add};
use crate::method::EquationForm;
use crate::system::Measure;

/// Square of the part of the fastest motion so far below which what moves has come to rest: the direction of the little that
/// is left is noise.
const AT_REST: f64 = 1e-4;

impl<'a> Stepped<'a> {
    /// The slope, where errors along the motion stay errors along it.
    pub(super) fn along(&self, slope: &'a [f64]) -> Option<&'a [f64]> {
        self.autonomous.then_some(slope)
    }
}

impl CarriedError {
    /// Takes slopes for the fastest motion so far.
    pub(super) fn take_slopes(&mut self, form: &dyn EquationForm, slopes: [&[f64]; 2]) {
        let (manifold, ndof) = (&form.point().manifold, self.rates.len());
        if self.arms.len() != ndof {
            let (system, chart) = (manifold.system().as_ref(), manifold.chart().parametrization());
            let length = system.characteristic_length();
            let arm = |k| if chart.measure(system, k) == Measure::Angle { length } else { 1.0 };
            self.arms.clear();
            self.arms.extend((0..ndof).map(arm));
        }
        for slope in slopes {
            for (fastest, slopes) in self.fastest.iter_mut().zip(slope.chunks_exact(ndof)) {
                let lengths = slopes.iter().zip(&self.arms).map(|(g, arm)| arm * g.abs());
                *fastest = lengths.fold(*fastest, f64::max);
            }
        }
    }

    /// Leaves out of both errors what they have along the motion at the start of a step, or had when the first of the steps began
    /// that wait for a matrix, and returns it, s. The run began `since` seconds before the end of the step.
    pub(super) fn begin_along(&mut self, slope: Option<&[f64]>, since: f64) -> [f64; 2] {
        if self.serving.steps == 0 || slope.is_none() {
            self.serving.ahead = self.leave_out(slope, since);
        } else {
            self.add_along(self.serving.ahead.map(|ahead| -ahead), slope);
        }
        self.serving.ahead
    }

    /// Leaves out of both errors their parts along the motion, whose slope this is, and returns them, s.
    pub(super) fn leave_out(&mut self, slope: Option<&[f64]>, since: f64) -> [f64; 2] {
        let Some(slope) = slope else { return [0.0; 2] };
        let [speed, acceleration] = self.fastest;
        // What moves steadily has accelerations that are noise.
        let weights = [speed, acceleration.max(speed / since)].map(|x| 1.0 / (x * x));
        if !weights.iter().all(|weight| weight.is_finite()) {
            return [0.0; 2];
        }
        let (arms, ndof) = (&self.arms, self.arms.len());
        let product = |x: &[f64]| -> f64 {
            let levels = x.chunks_exact(ndof).zip(slope.chunks_exact(ndof)).zip(weights);
            let of_level = |((x, g), weight): ((&[f64], &[f64]), f64)| {
                let terms = arms.iter().zip(x.iter().zip(g));
                weight * terms.map(|(arm, (x, g))| arm * arm * x * g).sum::<f64>()
            };
            levels.map(of_level).sum()
        };
        let size = product(slope);
        let mut ahead = [0.0; 2];
        if size > AT_REST {
            for (ahead, Carried { error, .. }) in ahead.iter_mut().zip(&mut self.sums) {
                let along = product(error) / size;
                // Nothing is ahead of a motion by more than that has lasted: an error beside what hardly moves has no part along it.
                if along.abs() <= since {
                    *ahead = along;
                    add(error, -along, slope);
                }
            }
        }
        ahead
    }

    /// Adds them again, where the slope of the motion is this.
    pub(super) fn add_along(&mut self, ahead: [f64; 2], slope: Option<&[f64]>) {
        let Some(slope) = slope else { return };
        for (ahead, Carried { error, .. }) in ahead.into_iter().zip(&mut self.sums) {
            add(error, ahead, slope);
        }
    }
}
