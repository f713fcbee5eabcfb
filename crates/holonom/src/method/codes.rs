//! Named pairs of method and formula.

use super::adams::AdamsStepper;
use super::explicit_rk::ExplicitRungeKuttaStepper;
use super::radau::RadauStepper;
use super::rosenbrock::RosenbrockStepper;
use super::sdirk::SdirkStepper;
use super::stepper::{Stepper, StepperOptions};
use super::{FirstOrder, FullOrder, StateSpace, Weights};
use crate::formula::{DOPRI5, RADAU_IIA_5, ROSENBROCK_NYSTROM_4, SDIRK4_15};
use crate::reduction::Manifold;
use crate::system::State;

/// A code: a method with a formula.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Code {
    /// First-order reduction with SDIRK4/15; the default.
    ForSdirk,
    /// First-order reduction with Rosenbrock-Nyström 4.
    ForRosen,
    /// First-order reduction with Radau IIA of order 5.
    ForRadau,
    /// Explicit variable-order Adams PECE.
    Deabm,
    /// Explicit Dormand-Prince 5(4).
    Dopri5,
}

/// What a user reads and types about a code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CodeInfo {
    /// The code.
    pub code: Code,
    /// Name as typed.
    pub name: &'static str,
    /// Family: `first_order`, `explicit`.
    pub family: &'static str,
    /// Formula within the family.
    pub formula: &'static str,
    /// One line about it.
    pub title: &'static str,
}

/// All codes; the first of a family is the family's default.
pub const CODES: &[CodeInfo] = &[
    CodeInfo {
        code: Code::ForSdirk,
        name: "ForSDIRK",
        family: "first_order",
        formula: "sdirk4_15",
        title: "first-order reduction, SDIRK4/15: implicit, order 4, for stiff models",
    },
    CodeInfo {
        code: Code::ForRosen,
        name: "ForRosen",
        family: "first_order",
        formula: "rosenbrock4",
        title: "first-order reduction, Rosenbrock-Nyström 4: linearly implicit, order 4",
    },
    CodeInfo {
        code: Code::ForRadau,
        name: "ForRadau",
        family: "first_order",
        formula: "radau5",
        title: "first-order reduction, Radau IIA: implicit, order 5, for the stiffest models",
    },
    CodeInfo {
        code: Code::Deabm,
        name: "DEABM",
        family: "explicit",
        formula: "adams",
        title: "explicit Adams PECE of variable order 1 to 12, for models that are not stiff",
    },
    CodeInfo {
        code: Code::Dopri5,
        name: "DOPRI5",
        family: "explicit",
        formula: "dopri5",
        title: "explicit Dormand-Prince 5(4), a plain cross-check",
    },
];

/// No such method.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown method `{asked}`; known are {known}")]
pub struct UnknownMethod {
    /// What was asked for.
    pub asked: String,
    /// The list of known codes and pairs.
    pub known: String,
}

impl Code {
    /// Name, family, formula and title.
    pub fn info(self) -> &'static CodeInfo {
        CODES.iter().find(|i| i.code == self).expect("every code is listed")
    }

    /// A code by its name, or by family with an optional formula.
    ///
    /// # Errors
    /// [`UnknownMethod`] with the list of known pairs.
    pub fn find(method: &str, formula: Option<&str>) -> Result<Self, UnknownMethod> {
        let same = |a: &str, b: &str| a.eq_ignore_ascii_case(b);
        CODES
            .iter()
            .find(|i| {
                let named = same(i.name, method) || same(i.family, method);
                named && formula.is_none_or(|f| same(i.formula, f))
            })
            .map(|i| i.code)
            .ok_or_else(|| UnknownMethod {
                asked: formula.map_or(method.into(), |f| format!("{method} with {f}")),
                known: CODES
                    .iter()
                    .map(|i| format!("{} ({} with {})", i.name, i.family, i.formula))
                    .collect::<Vec<_>>()
                    .join(", "),
            })
    }
}

/// The form of the equations that a code integrates.
pub fn build_state_space(
    code: Code,
    manifold: Manifold,
    weights: Weights,
    state: &State,
) -> Box<dyn StateSpace> {
    match code {
        Code::ForSdirk | Code::ForRosen | Code::ForRadau => {
            Box::new(FirstOrder::new(manifold, weights, state))
        }
        Code::Deabm | Code::Dopri5 => Box::new(FullOrder::new(manifold, weights, state)),
    }
}

/// The stepper of a code for a form of `dimension` unknowns.
pub fn build_stepper(
    code: Code,
    dimension: usize,
    fixed_step: bool,
    max_step: f64,
) -> Box<dyn Stepper> {
    let options = StepperOptions { fixed_step, max_step, ..StepperOptions::improved() };
    match code {
        Code::ForSdirk => Box::new(SdirkStepper::new(&SDIRK4_15, dimension, options)),
        Code::ForRosen => {
            Box::new(RosenbrockStepper::new(&ROSENBROCK_NYSTROM_4, dimension, options))
        }
        Code::ForRadau => Box::new(RadauStepper::new(&RADAU_IIA_5, dimension, options)),
        Code::Deabm => Box::new(AdamsStepper::new(dimension, 0, options)),
        Code::Dopri5 => Box::new(ExplicitRungeKuttaStepper::new(&DOPRI5, dimension, options)),
    }
}
