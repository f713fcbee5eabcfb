//! The matrices that an attempt iterates with: how old they are, and when they are made anew.

use super::counted::Counted;
use super::iteration::Failure;
use super::stages::{Stages, Step};

/// Age of the linearization.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Linearization {
    /// There is none.
    None,
    /// Of the start of an earlier step.
    Old,
    /// Of the start of this step.
    Current,
}

/// Linearization and factors that a stepper has.
#[derive(Debug, Clone, Copy)]
pub(super) struct Matrices {
    linearization: Linearization,
    /// Step of the last factorization.
    factored: Option<f64>,
}

impl Matrices {
    /// None yet, or none that hold any longer.
    pub(super) const NONE: Self = Self { linearization: Linearization::None, factored: None };

    /// The start of the step that they belong to is past.
    pub(super) fn grow_old(&mut self) {
        if self.linearization == Linearization::Current {
            self.linearization = Linearization::Old;
        }
    }

    /// Whether a fresh linearization would be another one.
    pub(super) fn are_old(&self) -> bool {
        self.linearization == Linearization::Old
    }

    /// Makes what is missing for a step; with `reuse` an old linearization serves.
    pub(super) fn prepare<S: Stages>(
        &mut self,
        stages: &mut S,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
        reuse: bool,
    ) -> Result<(), Failure> {
        let fresh = match self.linearization {
            Linearization::Current => true,
            Linearization::Old => reuse,
            Linearization::None => false,
        };
        if !fresh {
            *self = Self::NONE;
            stages.linearize(ode, step)?;
            self.linearization = Linearization::Current;
        }
        if self.factored != Some(step.h) {
            self.factored = None;
            stages.factor(ode, step.h).map_err(Failure::singular)?;
            self.factored = Some(step.h);
        }
        Ok(())
    }
}
