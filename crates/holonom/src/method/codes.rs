//! Named pairs of method and formula.

use super::adams::AdamsStepper;
use super::explicit_rk::ExplicitRungeKuttaStepper;
use super::nystrom::NystromStepper;
use super::radau::RadauStepper;
use super::rosenbrock::RosenbrockStepper;
use super::sdirk::SdirkStepper;
use super::stepper::{Stepper, StepperOptions};
use super::{Descriptor, EquationForm, ExplicitForm, FirstOrder, Iterate, Weights};
use crate::control::NewtonControl;
use crate::error::printable;
use crate::formula::{
    DOP853, DOPRI5, Nystrom, RADAU_IIA_5, ROSENBROCK_NYSTROM_4, SDIRK4_15, SDIRK4_16,
};
use crate::model::{Profile, Tolerance};
use crate::newton::{Chosen, ReducedMatrix};
use crate::reduction::{Manifold, ParametrizationKind};
use crate::system::State;

/// A code: a method with a formula.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Code {
    /// First-order reduction with SDIRK4/15.
    ForSdirk,
    /// First-order reduction with SDIRK4/16.
    ForSdirk16,
    /// First-order reduction with Rosenbrock-Nyström 4.
    ForRosen,
    /// First-order reduction with Radau IIA of order 5; the default.
    ForRadau,
    /// State-space method with the trapezoidal rule.
    SspTrap,
    /// State-space method with SDIRK4/16.
    SspSdirk16,
    /// State-space method with SDIRK4/15.
    SspSdirk15,
    /// Descriptor form with SDIRK4/16.
    InflSdirk,
    /// Descriptor form with SDIRK4/15.
    InflSdirk15,
    /// Descriptor form with the trapezoidal rule.
    InflTrap,
    /// Explicit variable-order Adams PECE.
    Deabm,
    /// Explicit Dormand-Prince 5(4).
    Dopri5,
    /// Explicit Dormand-Prince 8(5,3).
    Dop853,
}

/// What a user reads and types about a code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CodeInfo {
    /// The code.
    pub code: Code,
    /// Name as typed.
    pub name: &'static str,
    /// Family: `first_order`, `state_space`, `descriptor`, `explicit`.
    pub family: &'static str,
    /// Formula within the family.
    pub formula: &'static str,
    /// One line about it.
    pub title: &'static str,
}

const fn info(
    code: Code,
    name: &'static str,
    family: &'static str,
    formula: &'static str,
    title: &'static str,
) -> CodeInfo {
    CodeInfo { code, name, family, formula, title }
}

/// All codes; the first of a family is the family's default.
#[rustfmt::skip] // a table
pub const CODES: &[CodeInfo] = &[
    info(Code::ForSdirk, "ForSDIRK", "first_order", "sdirk4_15",
        "first-order reduction, SDIRK4/15: implicit, order 4, for stiff models"),
    info(Code::ForSdirk16, "ForSDIRK16", "first_order", "sdirk4_16",
        "first-order reduction, SDIRK4/16: implicit, order 4"),
    info(Code::ForRosen, "ForRosen", "first_order", "rosenbrock4",
        "first-order reduction, Rosenbrock-Nyström 4: linearly implicit, order 4"),
    info(Code::ForRadau, "ForRadau", "first_order", "radau5",
        "first-order reduction, Radau IIA: implicit, order 5, for the stiffest models"),
    info(Code::SspTrap, "SspTrap", "state_space", "trapezoidal",
        "state-space method, trapezoidal rule: implicit, order 2, for loose tolerances"),
    info(Code::SspSdirk15, "SspSDIRK15", "state_space", "sdirk4_15",
        "state-space method, SDIRK4/15: implicit, order 4"),
    info(Code::SspSdirk16, "SspSDIRK16", "state_space", "sdirk4_16",
        "state-space method, SDIRK4/16: implicit, order 4"),
    info(Code::InflSdirk, "InflSDIRK", "descriptor", "sdirk4_16",
        "descriptor form, SDIRK4/16: implicit, order 4, sparse matrix of accelerations and multipliers"),
    info(Code::InflSdirk15, "InflSDIRK15", "descriptor", "sdirk4_15",
        "descriptor form, SDIRK4/15: implicit, order 4, sparse matrix of accelerations and multipliers"),
    info(Code::InflTrap, "InflTrap", "descriptor", "trapezoidal",
        "descriptor form, trapezoidal rule: implicit, order 2, for loose tolerances"),
    info(Code::Deabm, "DEABM", "explicit", "adams",
        "explicit Adams PECE of variable order 1 to 12, for models that are not stiff"),
    info(Code::Dopri5, "DOPRI5", "explicit", "dopri5",
        "explicit Dormand-Prince 5(4), a plain cross-check"),
    info(Code::Dop853, "DOP853", "explicit", "dop853",
        "explicit Dormand-Prince 8(5,3): order 8, for smooth models that are not stiff and tight tolerances"),
];

/// The code of a run that names none: the fastest at equal error over the model library
/// (docs/methods.md).
pub const DEFAULT_CODE: Code = Code::ForRadau;

impl Profile {
    /// What the independent variables are unless stated: the thesis partitions coordinates.
    pub fn parametrization(self) -> ParametrizationKind {
        match self {
            Self::Thesis => ParametrizationKind::Partitioning,
            Self::Improved => ParametrizationKind::Tree,
        }
    }
}

/// Parameters of Newmark's formula; γ = ½, β = ¼ is the trapezoidal rule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Newmark {
    /// γ: ½ gives order 2; more damps high frequencies, at order 1.
    pub gamma: f64,
    /// β; A-stable for 2β ≥ γ ≥ ½.
    pub beta: f64,
}

impl Newmark {
    /// γ with the β that damps high frequencies most, (γ + ½)²/4.
    pub fn damping(gamma: f64) -> Self {
        Self { gamma, beta: 0.25 * (gamma + 0.5).powi(2) }
    }
}

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
    /// Whether its formula is an explicit one.
    pub fn is_explicit(self) -> bool {
        self.info().family == "explicit"
    }

    /// Whether its formula is the trapezoidal rule, of order 2 and with stages at both ends of a step alone.
    pub fn is_trapezoidal(self) -> bool {
        self.info().formula == "trapezoidal"
    }

    /// Name, family, formula and title.
    pub fn info(self) -> &'static CodeInfo {
        CODES.iter().find(|i| i.code == self).expect("every code is listed")
    }

    /// Whether the simplified Jacobian does not serve: its results depend on the Jacobian (Rosenbrock), or its form has no simplified
    /// one (descriptor).
    pub fn needs_full_jacobian(self) -> bool {
        self == Self::ForRosen || !matches!(self.info().family, "first_order" | "state_space")
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
                // The trapezoidal rule is a member of Newmark's family.
                let alias = |f| same(f, "newmark") && i.formula == "trapezoidal";
                named && formula.is_none_or(|f| same(i.formula, f) || alias(f))
            })
            .map(|i| i.code)
            .ok_or_else(|| UnknownMethod {
                asked: printable(&formula.map_or(method.into(), |f| format!("{method} with {f}"))),
                known: CODES
                    .iter()
                    .map(|i| format!("{} ({} with {})", i.name, i.family, i.formula))
                    .collect::<Vec<_>>()
                    .join(", "),
            })
    }
}

/// The form of the equations that a code integrates, from `state` in a run that began with the coordinates `origin`.
pub fn build_form(
    code: Code,
    profile: Profile,
    manifold: Manifold,
    tolerance: Tolerance,
    state: &State,
    origin: &[f64],
) -> Box<dyn EquationForm> {
    let start = State { q: origin.to_vec(), ..state.clone() };
    let mut weights = Weights::new(tolerance, manifold.system().as_ref(), &start);
    weights.set(state);
    if profile == Profile::Thesis {
        weights = weights.of_independent_coordinates();
    }
    match code {
        Code::Deabm | Code::Dopri5 | Code::Dop853 => {
            Box::new(ExplicitForm::new(manifold, weights, state))
        }
        Code::InflSdirk | Code::InflSdirk15 | Code::InflTrap => {
            let iterate = match profile {
                Profile::Thesis => Iterate::Plain,
                Profile::Improved => Iterate::Consistent,
            };
            Box::new(Descriptor::new(manifold, weights, state, iterate))
        }
        Code::ForSdirk
        | Code::ForSdirk16
        | Code::ForRosen
        | Code::ForRadau
        | Code::SspTrap
        | Code::SspSdirk15
        | Code::SspSdirk16 => {
            type Form = FirstOrder<Chosen<ReducedMatrix>>;
            Box::new(Form::with_matrix(manifold, weights, state))
        }
    }
}

/// The stepper of a code for its form of the equations; `newmark` is for the trapezoidal codes.
pub fn build_stepper(
    code: Code,
    profile: Profile,
    form: &mut dyn EquationForm,
    tolerance: Tolerance,
    newmark: Option<Newmark>,
    fixed_step: bool,
    max_step: f64,
) -> Box<dyn Stepper> {
    let dimension = form.dimension();
    let unknowns = form.second_order().map_or(0, |system| system.unknowns());
    let mut options = match profile {
        Profile::Thesis => {
            let filter_error = matches!(code, Code::ForSdirk | Code::ForSdirk16);
            let newton = StepperOptions::improved(tolerance.relative).newton;
            // Not a code of the thesis: its estimates are of order 3 on partitions that change often.
            let caution = if code == Code::ForRadau { 4.0 } else { 1.0 };
            StepperOptions { newton, caution, filter_error, ..StepperOptions::thesis() }
        }
        Profile::Improved => {
            let caution = match code {
                Code::ForRosen | Code::SspSdirk15 | Code::InflSdirk15 => 2.0,
                Code::SspTrap | Code::InflTrap => 1.5,
                Code::Deabm => 4.0,
                Code::Dopri5 | Code::Dop853 => 32.0,
                _ => 1.0,
            };
            // Source: `docs/theory/method.md` (11b).
            let own_error = Some(tolerance.relative.max(tolerance.rotation));
            StepperOptions { caution, own_error, ..StepperOptions::improved(tolerance.relative) }
        }
    };
    if matches!(code, Code::SspTrap | Code::InflTrap) {
        // So many steps are taken by order 2 that what each leaves must fall with their number.
        options.newton.kappa = StepperOptions::share(tolerance.relative);
    }
    (options.fixed_step, options.max_step) = (fixed_step, max_step);
    let manifold = &form.point().manifold;
    if manifold.chart().parametrization().relatives().is_none()
        && !manifold.system().structure().sizes.is_planar()
    {
        // Matrices in coordinates of the ground do not turn along with bodies: an old one is large about the axis
        // that a slender body has now, corrections of its spin are too small, and iterations seem to have converged.
        options.reuse_contraction = 0.0;
    }
    // A dense matrix of order ndof costs less to factor than a step that is shorter than it need be.
    if !matches!(code, Code::InflSdirk | Code::InflSdirk15 | Code::InflTrap) {
        options.dead_band = 1.0;
    }
    let nystrom = |formula: Nystrom| -> Box<dyn Stepper> {
        let newton = NewtonControl { max_iterations: 10, ..options.newton };
        let options = StepperOptions { newton, ..options };
        Box::new(NystromStepper::new(formula, dimension, unknowns, options))
    };
    match code {
        Code::ForSdirk => Box::new(SdirkStepper::new(&SDIRK4_15, dimension, options)),
        Code::ForSdirk16 => Box::new(SdirkStepper::new(&SDIRK4_16, dimension, options)),
        Code::ForRosen => {
            Box::new(RosenbrockStepper::new(&ROSENBROCK_NYSTROM_4, dimension, options))
        }
        Code::ForRadau => Box::new(RadauStepper::new(&RADAU_IIA_5, dimension, options)),
        Code::SspTrap | Code::InflTrap => nystrom(
            newmark.map_or_else(Nystrom::trapezoidal, |n| Nystrom::newmark(n.gamma, n.beta)),
        ),
        Code::SspSdirk15 | Code::InflSdirk15 => nystrom(Nystrom::sdirk(&SDIRK4_15)),
        Code::SspSdirk16 | Code::InflSdirk => nystrom(Nystrom::sdirk(&SDIRK4_16)),
        Code::Deabm => Box::new(AdamsStepper::new(dimension, options)),
        Code::Dopri5 => Box::new(ExplicitRungeKuttaStepper::new(&DOPRI5, dimension, options)),
        Code::Dop853 => Box::new(ExplicitRungeKuttaStepper::new(&DOP853, dimension, options)),
    }
}
