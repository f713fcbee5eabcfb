//! What the linearized equations answer to a small vibration.

use super::first_order::FirstOrder;
use super::ode::{Complex64, EvaluationFailure, LinearizedOde, Ode};
use crate::system::State;
use std::f64::consts::FRAC_PI_2;

impl FirstOrder {
    /// Size, in weights, of the steady vibration with which the equations answer, linearized at `state`, to what changes in them with
    /// the angular frequency Ω, rad/s. Eigenvalues have been asked for there.
    ///
    /// ```text
    /// X = (iΩ − J)⁻¹ b,   2b = g(t) − g(t + π/Ω) − i (g(t + π/(2Ω)) − g(t + 3π/(2Ω)))   at the same w
    /// ```
    ///
    /// Source: `docs/theory/simulation.md` (14a).
    ///
    /// # Errors
    /// As [`Ode::derivative`], and when iΩ is an eigenvalue.
    pub fn response(&mut self, state: &State, frequency: f64) -> Result<f64, EvaluationFailure> {
        let n = self.dimension();
        let room = || vec![0.0; n];
        let (mut w, mut slope, mut force) = (room(), room(), [room(), room()]);
        self.pack(state, &mut w);
        for quarter in 0..4 {
            let t = state.t + f64::from(quarter) * FRAC_PI_2 / frequency;
            self.derivative(t, &w, &mut slope)?;
            let sign = [0.5, -0.5, -0.5, 0.5][quarter as usize];
            let part = &mut force[quarter as usize % 2];
            part.iter_mut().zip(&slope).for_each(|(b, g)| *b += sign * g);
        }
        // (I − J/(iΩ)) X = b/(iΩ)
        let [re, im] = &mut force;
        for (re, im) in re.iter_mut().zip(im.iter_mut()) {
            (*re, *im) = (*im / frequency, -*re / frequency);
        }
        self.linearize(state.t, &w)?;
        self.factor_complex(Complex64::new(0.0, -1.0 / frequency))?;
        self.solve_complex(re, im);
        Ok(self.error_norm(re, &w).hypot(self.error_norm(im, &w)))
    }
}
