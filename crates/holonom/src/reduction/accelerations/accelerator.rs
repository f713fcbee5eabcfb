//! The solver that a manifold's accelerations come from, and the augmented system behind it.

use super::articulated::Articulated;
use super::choice::{BLOCK, plan_reduced, small};
use super::{AccelerationCosts, Accelerations, IndexOneEquations, ReducedEnvelope, Refusal};
use crate::error::EvaluationFailure;
use crate::reduction::chart::Chart;
use crate::reduction::null_space::NullSpace;
use crate::reduction::saddle::Saddle;
use crate::system::System;
use holonom_linalg::BlockMatrix;

/// What stands in the equations beside M.
#[derive(Debug, Clone, Copy)]
pub(in crate::reduction) struct Known<'a> {
    pub(in crate::reduction) q: &'a [f64],
    /// G.
    pub(in crate::reduction) jacobian: &'a BlockMatrix,
    pub(in crate::reduction) force: &'a [f64],
    pub(in crate::reduction) tau: &'a [f64],
}

/// Solutions whose next correction would be larger than this are left to the augmented system.
const ACCURACY: f64 = 1e-13;

/// M̂ and B need symmetry, a mass everywhere and a condition that may be squared; the augmented system takes
/// every system and state, and serves where they fail.
#[derive(Debug, Clone)]
pub struct Accelerator {
    stated: Accelerations,
    saddle: Saddle,
    null_space: Option<NullSpace>,
    reduced: Option<ReducedEnvelope>,
    recursive: Option<Articulated>,
    costs: AccelerationCosts,
    /// D belongs to the chart's factors.
    null_space_current: bool,
    /// Accelerations are known, their multipliers not yet.
    multipliers_due: bool,
    fallbacks: u64,
}

impl Accelerator {
    /// Nothing is chosen yet: the augmented system serves.
    pub(in crate::reduction) fn new(saddle: Saddle) -> Self {
        Self {
            stated: Accelerations::Auto,
            saddle,
            null_space: None,
            reduced: None,
            recursive: None,
            costs: AccelerationCosts {
                recursive: f64::INFINITY,
                null_space: f64::NAN,
                reduced: f64::NAN,
                refusal: None,
                augmented: f64::NAN,
            },
            null_space_current: false,
            multipliers_due: false,
            fallbacks: 0,
        }
    }

    /// A copy with these patterns, pivots and plans for other numbers of the same structure.
    pub(in crate::reduction) fn with_values(&self, system: &dyn System) -> Self {
        let reduced = self.reduced.as_ref().and_then(|known| known.with_values(system).ok());
        Self { reduced, costs: self.costs, ..Self::new(self.saddle.with_values()) }
    }

    /// The way that is taken.
    pub fn way(&self) -> Accelerations {
        match (&self.recursive, &self.null_space, &self.reduced) {
            (Some(_), ..) => Accelerations::Recursive,
            (None, _, Some(_)) => Accelerations::Reduced,
            (None, Some(_), None) => Accelerations::NullSpace,
            (None, None, None) => Accelerations::Augmented,
        }
    }

    /// What the ways were predicted to cost.
    pub fn costs(&self) -> &AccelerationCosts {
        &self.costs
    }

    /// Solves that the chosen way has left to the augmented system.
    pub fn fallbacks(&self) -> u64 {
        self.fallbacks
    }

    /// The augmented matrix.
    pub(in crate::reduction) fn saddle(&self) -> &Saddle {
        &self.saddle
    }

    /// Evaluates M at q.
    pub(in crate::reduction) fn evaluate_mass(
        &mut self,
        system: &dyn System,
        q: &[f64],
    ) -> &BlockMatrix {
        self.saddle.evaluate_mass(system, q)
    }

    /// The chart has got other factors.
    pub(in crate::reduction) fn forget(&mut self) {
        (self.null_space_current, self.multipliers_due) = (false, false);
    }

    /// Gives up the numbers that the next accelerations make anew.
    pub(in crate::reduction) fn release(&mut self) {
        if let Some(reduced) = &mut self.reduced {
            reduced.release();
        }
    }

    /// Gives up M until it is evaluated.
    pub(in crate::reduction) fn release_mass(&mut self) {
        self.saddle.release_mass();
    }

    /// λ belongs to other accelerations.
    pub(in crate::reduction) fn forget_multipliers(&mut self) {
        self.multipliers_due = false;
    }

    /// Chooses the way for a chart: the stated one, or the cheapest. Where the stated one cannot be, the
    /// cheapest is taken.
    ///
    /// # Errors
    /// [`Refusal`] of the stated way.
    pub(in crate::reduction) fn choose(
        &mut self,
        system: &dyn System,
        chart: &mut Chart,
        stated: Accelerations,
    ) -> Result<(), Refusal> {
        self.forget();
        let before = self.way();
        self.stated = stated;
        let kept = &chart.parametrization().kept;
        if *self.saddle.rows() != **kept {
            self.saddle.set_rows(kept);
            self.reduced = None;
        }
        let structure = system.structure();
        let (of_m, of_g) = (&structure.mass_pattern, &structure.constraint_pattern);
        let costs = &mut self.costs;
        costs.null_space = NullSpace::cost(chart, of_m);
        costs.augmented = Saddle::cost(of_m, of_g);
        let recursive = Articulated::new(chart, of_m);
        costs.recursive =
            recursive.as_ref().map_or(f64::INFINITY, |r| BLOCK * r.multiplications() as f64);
        let others = costs.null_space.min(costs.augmented).min(costs.recursive);
        let most = if stated == Accelerations::Reduced { f64::INFINITY } else { others };
        let planned = match self.reduced.take() {
            Some(known) => Ok((Some(known), costs.reduced)),
            None => plan_reduced(system, kept, most),
        };
        let (reduced, refusal) = match planned {
            Ok((reduced, cost)) => {
                costs.reduced = cost;
                (reduced, None)
            }
            Err(refusal) => {
                costs.reduced = f64::NAN;
                (None, Some(refusal))
            }
        };
        costs.refusal = refusal;
        let (n, ndof) = (structure.sizes.coordinates, chart.ndof());
        let (way, outcome) = match (stated, refusal) {
            (Accelerations::Auto, _) => (costs.cheapest(), Ok(())),
            (Accelerations::Reduced, Some(refusal)) => (costs.cheapest(), Err(refusal)),
            (Accelerations::NullSpace, _) => match small(2.0 * n as f64 * ndof as f64) {
                Ok(()) => (stated, Ok(())),
                Err(refusal) => (costs.cheapest(), Err(refusal)),
            },
            (Accelerations::Recursive, _) => match recursive {
                Ok(_) => (stated, Ok(())),
                Err(refusal) => (costs.cheapest(), Err(refusal)),
            },
            _ => (stated, Ok(())),
        };
        self.recursive = recursive.ok().filter(|_| way == Accelerations::Recursive);
        self.reduced = reduced.filter(|_| way == Accelerations::Reduced);
        self.null_space = (way == Accelerations::NullSpace).then(|| {
            chart.reserve_lanes();
            NullSpace::new(n, ndof)
        });
        if self.way() != before {
            self.fallbacks = 0;
        }
        outcome
    }

    /// The choice that was stated.
    pub fn stated(&self) -> Accelerations {
        self.stated
    }

    /// D p into v, where D is at hand after the chart was factored.
    pub(in crate::reduction) fn null_space(&mut self, chart: &mut Chart) -> Option<&NullSpace> {
        let form = self.null_space.as_mut()?;
        if !std::mem::replace(&mut self.null_space_current, true) {
            form.update(chart);
        }
        Some(form)
    }

    /// Accelerations at the configuration of the chart's factors; λ is due where the null space serves, see
    /// [`Accelerator::multipliers`]. M has been evaluated.
    ///
    /// # Errors
    /// `simulation/singular-mass` when no acceleration is determined.
    pub(in crate::reduction) fn accelerate(
        &mut self,
        system: &dyn System,
        chart: &mut Chart,
        at: &Known,
        a: &mut [f64],
        lambda: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        self.multipliers_due = false;
        if let Some(recursive) = &mut self.recursive {
            self.multipliers_due = recursive.accelerate(chart, self.saddle.mass(), at, a).is_ok();
            if self.multipliers_due {
                return Ok(());
            }
            self.fallbacks += 1;
        }
        if self.null_space(chart).is_some() {
            let (form, mass) = (self.null_space.as_mut().expect("just made"), self.saddle.mass());
            let outcome = form.accelerate(chart, mass, at.force, at.tau, a);
            self.multipliers_due = outcome.is_ok_and(|left| left <= ACCURACY);
            if self.multipliers_due {
                return Ok(());
            }
            self.fallbacks += 1;
        }
        self.solve(system, at, a, lambda)
    }

    /// Accelerations at the configuration of the chart's factors for forces of any kind; those of the state
    /// keep their multipliers.
    ///
    /// # Errors
    /// `simulation/singular-mass`.
    pub(in crate::reduction) fn respond(
        &mut self,
        system: &dyn System,
        chart: &Chart,
        at: &Known,
        a: &mut [f64],
        lambda: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        if let Some(recursive) = &mut self.recursive
            && !self.multipliers_due
            && recursive.accelerate(chart, self.saddle.mass(), at, a).is_ok()
        {
            return Ok(());
        }
        self.solve(system, at, a, lambda)
    }

    /// Accelerations and multipliers by the reduced or the augmented matrix.
    ///
    /// # Errors
    /// `simulation/singular-mass` naming the coordinate that no mass and no joint determines.
    fn solve(
        &mut self,
        system: &dyn System,
        at: &Known,
        a: &mut [f64],
        lambda: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        let &Known { q, jacobian, force, tau } = at;
        if let Some(reduced) = &mut self.reduced {
            let equations = IndexOneEquations { q, mass: self.saddle.mass(), jacobian, force, tau };
            let outcome = reduced.accelerate(&equations, a, lambda);
            if outcome.is_ok_and(|left| left <= ACCURACY) {
                return Ok(());
            }
            self.fallbacks += 1;
        }
        self.saddle.solve(system, jacobian, force, tau, a, lambda)
    }

    /// Multipliers of the accelerations `a` computed last, for the same forces.
    pub(in crate::reduction) fn multipliers(
        &mut self,
        chart: &mut Chart,
        force: &[f64],
        a: &[f64],
        lambda: &mut [f64],
    ) {
        if let (true, Some(recursive)) = (self.multipliers_due, &self.recursive) {
            recursive.multipliers(chart, lambda);
        } else if let (true, Some(form)) = (self.multipliers_due, &mut self.null_space) {
            form.multipliers(chart, self.saddle.mass(), force, a, lambda);
        }
        self.multipliers_due = false;
    }
}
