//! What the linearized equations answer to a small vibration of what drives them.

use super::first_order::FirstOrder;
use super::ode::{Complex64, EvaluationFailure, LinearizedOde, Ode};
use crate::system::State;
use std::f64::consts::FRAC_PI_2;

impl FirstOrder {
    /// Size, in weights, of the vibration that what changes in the equations with the angular frequency Ω, rad/s, builds up within
    /// `time`, s, or of the steady one, if that is less, by the equations linearized at `state`. Eigenvalues have been asked for there.
    ///
    /// ```text
    /// X = (sI − J)⁻¹ b,   s = 1/time + iΩ
    /// 4b = g₀ − 2g₂ + g₄ − i (g₁ − 2g₃ + g₅),   gₖ = g(t + k π/(2Ω)) at the same w
    /// ```
    ///
    /// b does not see what changes like a line. Source: `docs/theory/simulation.md` (14a).
    ///
    /// # Errors
    /// As [`Ode::derivative`], and when s is an eigenvalue.
    pub fn response(
        &mut self,
        state: &State,
        frequency: f64,
        time: f64,
    ) -> Result<f64, EvaluationFailure> {
        let n = self.dimension();
        let room = || vec![0.0; n];
        let (mut w, mut slope, mut force) = (room(), room(), [room(), room()]);
        self.pack(state, &mut w);
        for quarter in 0..6u8 {
            let t = state.t + f64::from(quarter) * FRAC_PI_2 / frequency;
            self.derivative(t, &w, &mut slope)?;
            let weight = if [2, 3].contains(&quarter) { -0.5 } else { 0.25 };
            let part = &mut force[usize::from(quarter) % 2];
            let weight = if quarter % 2 == 0 { weight } else { -weight };
            part.iter_mut().zip(&slope).for_each(|(b, g)| *b += weight * g);
        }
        // (I − J/s) X = b/s
        let inverse = Complex64::new(1.0 / time, frequency).inv();
        let [re, im] = &mut force;
        for (re, im) in re.iter_mut().zip(im.iter_mut()) {
            let x = Complex64::new(*re, *im) * inverse;
            (*re, *im) = (x.re, x.im);
        }
        self.linearize(state.t, &w)?;
        self.factor_complex(inverse)?;
        self.solve_complex(re, im);
        Ok(self.error_norm(re, &w).hypot(self.error_norm(im, &w)))
    }
}
