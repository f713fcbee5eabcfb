//! Positions that satisfy all joints, on the branch that is followed.

use super::Manifold;
use crate::error::EvaluationFailure;
use crate::math::vector::same_bits;
use crate::reduction::parametrization::largest_index;
use crate::reduction::recovery::{
    CONTRACTION_LIMIT, FARTHEST, MAX_CORRECTIONS, MAX_FACTORIZATIONS, NOISY_CORRECTION, Unclosed,
    another_branch, round_off, turned_too_far,
};
use std::f64::consts::PI;

/// The old factor is replaced when it would need more corrections than a new one costs.
const WORTH_REFACTORING: f64 = 4.0;
/// A correction of this size changes nothing.
const UNNOTICED: f64 = 0.1 * f64::EPSILON;

impl Manifold {
    /// Largest entry of a vector over the coordinates, lengths divided by the characteristic length.
    fn size_of(&self, x: &[f64]) -> f64 {
        let sizes = &self.system.structure().sizes;
        let inverse = 1.0 / self.system.characteristic_length();
        // On bits, so that NaN is larger than every number.
        let bits = |x: f64| x.to_bits() & !(1 << 63);
        let mut largest = 0;
        for [lengths, angles] in sizes.by_body(x) {
            for x in lengths {
                largest = largest.max(bits(x * inverse));
            }
            for x in angles {
                largest = largest.max(bits(*x));
            }
        }
        let largest = f64::from_bits(largest);
        if largest.is_finite() { largest } else { f64::INFINITY }
    }

    /// Largest angle of a change of coordinates, rad.
    fn turned_by(&self, x: &[f64]) -> f64 {
        let sizes = &self.system.structure().sizes;
        let angles = sizes.by_body(x).flat_map(|[_, angles]| angles);
        let largest = angles.fold(0.0f64, |most, x| most.max(x.abs()));
        sizes.angle_factor() * largest
    }

    /// Solves Φ(q, t) = 0, v(q) = p from the guess in `q`, which must be a point of the branch that is
    /// followed (the last accepted or evaluated one).
    ///
    /// The first correction is the tangent predictor. The result is accepted only if corrections
    /// contract, it ends within half the predicted movement of the predictor (or noise), and the
    /// sign of det [G; P] has not changed.
    ///
    /// # Errors
    /// `simulation/position-recovery` naming the constraint with the largest residual; `q` is then
    /// meaningless.
    pub fn recover_position(
        &mut self,
        t: f64,
        p: &[f64],
        q: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        self.counters.recoveries += 1;
        if let Some(joint) = &mut self.joint {
            let parametrization = self.chart.parametrization();
            if std::mem::take(&mut self.returned) {
                // Where references stand, the coordinates are theirs.
                if !same_bits(&self.anchored, q) {
                    joint.read(parametrization, q, &mut self.edges);
                }
                // What is predicted along the closures belongs to where they were factored last.
                if self.at != *q && joint.largest_closure() > 0 {
                    self.at.copy_from_slice(q);
                    self.stale = true;
                    self.counters.factorizations += 1;
                    joint.factor(parametrization, &self.edges, q)?;
                    self.orientation = joint.determinant_sign();
                }
            }
            let corrections = joint.recover_position(parametrization, t, p, &mut self.edges, q)?;
            self.counters.corrections += corrections;
            return Ok(());
        }
        let chart = &mut self.chart;
        self.recent.go_near(t, |factors| chart.exchange(factors), q, &mut self.edges);
        let noise = 8.0 * f64::EPSILON * self.size_of(q).max(1.0);
        let mut predicted = 0.0;
        let placed = self.chart.parametrization().relatives().map(|relatives| relatives.exact);
        if let Some(exact) = placed {
            predicted = self.place(t, p, q, exact)?;
            if exact {
                return Ok(());
            }
            if predicted <= noise {
                self.system.position_constraints(t, q, &mut self.phi);
                if self.residual_is_noise(q) {
                    // Closed where it stands. Next to a dead point a correction would be noise.
                    return Ok(());
                }
            }
        }
        let mut before = f64::INFINITY;
        let mut factored = 0;
        // Corrections by the present factors: a first one tells nothing of how they contract.
        let mut served = 0;
        for k in 0..MAX_CORRECTIONS {
            self.counters.corrections += 1;
            let size = self.correct(t, p, q);
            if k == 0 {
                predicted += size;
                self.predictor.copy_from_slice(q);
            }
            let rate = size / before;
            // Or the next one would be lost in the last place, even of a stiff element's length.
            if size <= noise || (k > 0 && 4.0 * rate * size <= UNNOTICED) {
                return self.check_branch(q, predicted, noise);
            }
            if served > 0 && rate > CONTRACTION_LIMIT {
                // Corrections that no longer fall have reached round-off, if they are that small.
                if before <= 1e3 * noise || (size <= NOISY_CORRECTION && self.residual_is_noise(q))
                {
                    return self.check_branch(q, predicted, noise.max(size));
                }
                if factored == MAX_FACTORIZATIONS {
                    break;
                }
            }
            let remaining = if k > 0 { (noise / size).ln() / rate.ln() } else { 0.0 };
            let stalls = rate > CONTRACTION_LIMIT && (served > 0 || factored == 0);
            served += 1;
            let slow = factored == 0 && remaining > WORTH_REFACTORING;
            if k > 0 && (slow || (stalls && factored < MAX_FACTORIZATIONS)) {
                if !size.is_finite() {
                    break;
                }
                self.factor_at(q)?;
                (factored, served) = (factored + 1, 0);
            }
            before = size;
        }
        Err(self.position_failure(t, q))
    }

    /// Places the bodies along the forest, dependent coordinates by the tangent; returns how far they
    /// moved.
    fn place(
        &mut self,
        t: f64,
        p: &[f64],
        q: &mut [f64],
        exact: bool,
    ) -> Result<f64, EvaluationFailure> {
        let system = self.system.clone();
        let system = system.as_ref();
        if !exact {
            system.position_constraints(t, q, &mut self.phi);
            let parametrization = self.chart.parametrization();
            parametrization.positions(system, q, &mut self.independent);
            for (out, target) in self.independent.iter_mut().zip(p) {
                *out -= target;
            }
            if let Some(relatives) = parametrization.relatives() {
                relatives.count_turns(system, &self.edges, p, &mut self.independent);
            }
            if self.residual_is_noise(q) {
                // Next to a dead point it would move the mechanism by far more than round-off.
                self.phi.fill(0.0);
            }
            self.chart.solve(&self.phi, &self.independent, &mut self.correction);
        }
        let Some(relatives) = self.chart.parametrization().relatives() else { return Ok(0.0) };
        if !exact {
            let turned = relatives.predict_dependent(system, q, &self.correction, &mut self.edges);
            if turned > PI {
                return Err(turned_too_far(turned));
            }
            self.predictor.copy_from_slice(q);
        }
        relatives.coordinates(system, t, p, &mut self.edges)?;
        relatives.place(system, &self.edges, q);
        if exact {
            return Ok(0.0);
        }
        for (out, (x, y)) in self.correction.iter_mut().zip(q.iter().zip(&self.predictor)) {
            *out = x - y;
        }
        Ok(self.size_of(&self.correction))
    }

    /// Whether Φ, as the last correction found it, is rounding of the coordinates: an ill-conditioned
    /// [G; P] then turns it into corrections that do not fall.
    fn residual_is_noise(&self, q: &[f64]) -> bool {
        let allowed = round_off(q);
        self.phi.iter().all(|x| x.abs() <= allowed)
    }

    /// One correction of the quasi-Newton iteration; returns its size.
    fn correct(&mut self, t: f64, p: &[f64], q: &mut [f64]) -> f64 {
        self.system.position_constraints(t, q, &mut self.phi);
        let system = self.system.as_ref();
        self.chart.parametrization().positions(system, q, &mut self.independent);
        for (out, target) in self.independent.iter_mut().zip(p) {
            *out -= target;
        }
        if let Some(relatives) = self.chart.parametrization().relatives() {
            relatives.reduce_turns(system, &mut self.independent);
        }
        self.chart.solve(&self.phi, &self.independent, &mut self.correction);
        for (x, d) in q.iter_mut().zip(&self.correction) {
            *x -= d;
        }
        self.size_of(&self.correction)
    }

    fn check_branch(
        &mut self,
        q: &[f64],
        predicted: f64,
        noise: f64,
    ) -> Result<(), EvaluationFailure> {
        for (out, (x, y)) in self.correction.iter_mut().zip(q.iter().zip(&self.predictor)) {
            *out = x - y;
        }
        let near = 0.5 * predicted + 1e3 * noise;
        if self.size_of(&self.correction) <= near && self.turned_by(&self.correction) <= FARTHEST {
            return Ok(());
        }
        let moved = largest_index(&self.correction);
        Err(another_branch((&self.system.coordinate_name(moved), moved)))
    }

    fn position_failure(&mut self, t: f64, q: &[f64]) -> EvaluationFailure {
        self.system.position_constraints(t, q, &mut self.phi);
        let (worst, moved) = (largest_index(&self.phi), largest_index(&self.correction));
        let unclosed = Unclosed {
            t,
            worst: self.phi.get(worst).map(|&size| (worst, size)),
            correction: self.correction.get(moved).map_or(0.0, |x| x.abs()),
            moved: (&self.system.coordinate_name(moved), moved),
        };
        if self.residual_is_noise(q) {
            unclosed.undetermined()
        } else {
            unclosed.open(self.system.as_ref())
        }
    }
}
