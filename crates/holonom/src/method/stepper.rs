//! One step of ẇ = g(t, w): the contract between the run loop and the integration formulas.

use crate::control::{Contractions, NewtonControl, starting_step, trial_step};
use crate::method::ode::{EvaluationFailure, LinearizedOde, Ode};
use crate::model::Profile;
use serde::{Deserialize, Serialize};

/// g(t, w) into its last argument.
pub type Slope<'a> = dyn FnMut(f64, &[f64], &mut [f64]) -> Result<(), EvaluationFailure> + 'a;

/// Norm of a change of w, in tolerances.
pub type Norm<'a> = dyn FnMut(&[f64]) -> f64 + 'a;

/// Why an attempt was rejected.
#[derive(Debug, Clone, PartialEq)]
pub enum Rejection {
    /// The estimated error exceeds the tolerance.
    ErrorTooLarge,
    /// Corrections of the iteration do not fall.
    NewtonDivergence,
    /// The iteration would need more corrections than allowed.
    NewtonSlow,
    /// The system could not be evaluated or linearized.
    Evaluation(EvaluationFailure),
    /// I − γh J could not be factored.
    SingularMatrix(EvaluationFailure),
}

/// Outcome of one attempt.
#[derive(Debug, Clone, PartialEq)]
pub struct StepReport {
    /// Whether [`Stepper::end`] holds the state at t + h.
    pub accepted: bool,
    /// Scaled error estimate, 1 = on tolerance; infinite if the attempt did not come that far.
    pub error: f64,
    /// Proposed length of the next step (accepted) or of the next attempt (rejected). The caller
    /// may take a shorter one.
    pub next_step: f64,
    /// Why the attempt was rejected.
    pub cause: Option<Rejection>,
    /// Newton iterations of all stages; 0 for formulas without iteration.
    pub iterations: u32,
    /// Largest contraction θ seen in the iterations; 0 if none was seen.
    pub contraction: f64,
    /// Of all iterations that converged.
    pub contractions: Contractions,
}

impl StepReport {
    /// A rejected attempt, to be tried again with `retry`; the cause is filled in by the stepper.
    pub(crate) fn rejected(retry: f64) -> Self {
        Self {
            accepted: false,
            error: f64::INFINITY,
            next_step: retry,
            cause: None,
            iterations: 0,
            contraction: 0.0,
            contractions: Contractions::default(),
        }
    }

    /// Turns the report into that of an accepted step.
    pub(crate) fn accept(&mut self, error: f64, next_step: f64) {
        (self.accepted, self.error, self.next_step) = (true, error, next_step);
    }
}

/// State and slope at the end of an accepted step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepEnd<'a> {
    /// w₁.
    pub w: &'a [f64],
    /// Slope at the end: g there, or what follows from the formula, which agrees with g to the accuracy
    /// of the step.
    pub slope: &'a [f64],
}

/// Work counters since construction.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct StepperStatistics {
    /// Calls of [`Ode::derivative`].
    pub derivatives: u64,
    /// Calls of [`LinearizedOde::linearize`].
    pub linearizations: u64,
    /// Calls of [`LinearizedOde::factor`].
    pub factorizations: u64,
    /// Those of a simplified matrix.
    pub simplified_factorizations: u64,
    /// Changes from it to the full one.
    pub changes_to_full: u64,
    /// Calls of [`LinearizedOde::solve`].
    pub solves: u64,
    /// Newton iterations.
    pub iterations: u64,
    /// How they contracted.
    pub contractions: Contractions,
    /// Steps after which stiffness was suspected (explicit codes only).
    pub stiff_steps: u64,
}

impl StepperStatistics {
    /// With the work of another stepper added.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            derivatives: self.derivatives + other.derivatives,
            linearizations: self.linearizations + other.linearizations,
            factorizations: self.factorizations + other.factorizations,
            simplified_factorizations: self.simplified_factorizations
                + other.simplified_factorizations,
            changes_to_full: self.changes_to_full + other.changes_to_full,
            solves: self.solves + other.solves,
            iterations: self.iterations + other.iterations,
            contractions: self.contractions.plus(&other.contractions),
            stiff_steps: self.stiff_steps + other.stiff_steps,
        }
    }
}

/// Choices for a stepper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepperOptions {
    /// Every step that can be computed is accepted and the step is never changed; iterations go to
    /// round-off. For order studies and real-time use.
    pub fixed_step: bool,
    /// Largest step.
    pub max_step: f64,
    /// Iteration test; not used with a fixed step.
    pub newton: NewtonControl,
    /// A linearization serves the next step too while the contraction θ stays at or below this; 0
    /// linearizes at every accepted step. Rosenbrock formulas always linearize.
    pub reuse_contraction: f64,
    /// Ratio of steps up to which the step, and with it the factorization, is kept; 1 never. Only
    /// where a linearization is reused.
    pub dead_band: f64,
    /// What `Improved` means for implicit formulas. New linearizations are made in the predicted middle of the step, not at its
    /// start: stages are half as far from it, and iterations that much faster (Rosenbrock formulas always linearize at the
    /// start). Residuals of stages may be accelerations where iterations by forces fail. Steps are selected by Gustafsson's
    /// predictive law. Iterations of formulas in second-order form start from accelerations continued from the step
    /// before, not from those at the start of the step.
    pub profile: Profile,
    /// Estimates count this many times. Errors of formulas that damp nothing add up to a drift of the
    /// phase of what swings or turns, and explicit ones take so long steps that their estimates say less.
    pub caution: f64,
    /// Error estimates are multiplied by (I − γh J)⁻¹, which bounds them on stiff components (by a
    /// tenth of their size at least where the formula is not stiffly accurate).
    pub filter_error: bool,
    /// Steps are also judged by the error of the formula itself, where it can tell: on stiff components it may be as
    /// large as the estimate, which is of lower order. By how much that should exceed it follows from this tolerance.
    pub own_error: Option<f64>,
}

impl StepperOptions {
    /// Fresh linearization at every accepted step, standard step selection. ForRosen of the thesis
    /// has `filter_error = false` as well.
    pub fn thesis() -> Self {
        Self {
            fixed_step: false,
            max_step: f64::INFINITY,
            newton: NewtonControl::default(),
            reuse_contraction: 0.0,
            dead_band: 1.0,
            profile: Profile::Thesis,
            caution: 1.0,
            filter_error: true,
            own_error: None,
        }
    }

    /// Reuse of linearizations and factorizations while the iteration is fast. The constants gave
    /// the least work on stiff mechanical chains and on van der Pol's equation, with a
    /// linearization at four evaluations.
    ///
    /// What the iterations leave adds up over the steps, of which there are more at a tighter
    /// `tolerance`: the share of it that each may leave falls with it. It is the relative part,
    /// because that has no unit. It does so with the same sign at every turn of what turns: a share ten
    /// times as large saves a tenth of the iterations and makes a cardan shaft ten times as wrong.
    pub fn improved(tolerance: f64) -> Self {
        let kappa = Self::share(tolerance).max(1e-4);
        Self {
            newton: NewtonControl { kappa, ..NewtonControl::default() },
            reuse_contraction: 0.02,
            dead_band: 1.2,
            profile: Profile::Improved,
            own_error: Some(tolerance),
            ..Self::thesis()
        }
    }

    /// Share of the tolerance that an iteration may leave where steps grow in number like tolerance^(−1/2).
    pub(crate) fn share(tolerance: f64) -> f64 {
        (0.01 * tolerance.sqrt()).min(1e-3)
    }

    /// Whether the profile is `Improved`.
    pub(crate) fn improves(&self) -> bool {
        self.profile == Profile::Improved
    }

    /// Iteration constants in force.
    pub(crate) fn iteration(&self) -> NewtonControl {
        if self.fixed_step { NewtonControl::to_round_off() } else { self.newton }
    }
}

impl Default for StepperOptions {
    fn default() -> Self {
        Self::improved(1e-3)
    }
}

/// Advances ẇ = g(t, w) by one step of one formula.
///
/// The caller owns time: it starts each attempt, clips steps to breakpoints and the end, and keeps
/// the accepted state. A stepper allocates at construction only. Steps are positive.
///
/// Before each attempt from a new state the caller sets the weights of [`Ode::norm`].
pub trait Stepper: Send {
    /// Order of the formula (for a variable order that of the last step).
    fn order(&self) -> u32;

    /// Order that sets the length of a first step, see [`initial_step`].
    fn starting_order(&self) -> u32 {
        self.order()
    }

    /// Orders of what a step leaves, and of the formula whose error its estimate is: the first one is higher.
    fn orders_of_error(&self) -> [u32; 2] {
        [self.order(), self.starting_order()]
    }

    /// Error against estimate where a law passes a knot within the step, at least 1.
    fn error_at_kinks(&self) -> f64 {
        1.0
    }

    /// Whether the formula never linearizes.
    fn explicit(&self) -> bool;

    /// Evaluations that a step of an explicit formula takes.
    fn evaluations(&self) -> u64 {
        2
    }

    /// Whether the formula keeps slopes of earlier steps, which belong to the independent variables of
    /// their time.
    fn multistep(&self) -> bool {
        false
    }

    /// Forgets history: at the start, after a discontinuity, after a breakpoint.
    fn restart(&mut self);

    /// The meaning of w has changed (re-parametrization): linearization, predictors and multistep histories no longer hold. Step
    /// control goes on.
    fn invalidate(&mut self);

    /// Takes back the accepted step: the next attempt starts where it started (event location,
    /// refusal of the end state by the caller).
    fn discard(&mut self);

    /// One attempt from (t, w) with slope g = g(t, w) over the step h. What was kept from the last
    /// accepted step is used, `w` and `g` as passed are authoritative. After a rejection the caller
    /// tries again from the same (t, w, g) with [`StepReport::next_step`].
    fn attempt(
        &mut self,
        ode: &mut dyn LinearizedOde,
        t: f64,
        h: f64,
        w: &[f64],
        g: &[f64],
    ) -> StepReport;

    /// End of the last attempt, if it was accepted.
    fn end(&self) -> StepEnd<'_>;

    /// Evaluates by `slope`, g(t, w), what [`Stepper::interpolate`] and [`Stepper::polynomial`] need of the last accepted step beyond its
    /// stages: to be called before them, and before the next attempt. What is off is judged by `norm`.
    ///
    /// # Errors
    /// As [`Ode::derivative`].
    fn complete_step(
        &mut self,
        _slope: &mut Slope<'_>,
        _norm: &mut Norm<'_>,
    ) -> Result<(), EvaluationFailure> {
        Ok(())
    }

    /// State at t₀ + θh of the last accepted step, 0 ≤ θ ≤ 1.
    fn interpolate(&mut self, theta: f64, w: &mut [f64]);

    /// Largest degree of [`Stepper::polynomial`].
    fn largest_degree(&self) -> usize;

    /// [`Stepper::interpolate`] of the last accepted step as a polynomial in θ: coefficients from θ⁰ on, one
    /// after the other, into `coefficients`, which has room for the largest degree. Returns the degree.
    fn polynomial(&self, coefficients: &mut [f64]) -> usize;

    /// Places θ at which [`Stepper::interpolate`] satisfies the equations, the last one the end of the step; none where it need
    /// not.
    fn collocation_places(&self) -> Option<&'static [f64; 3]> {
        None
    }

    /// γ of [`Stepper::filter`], the part of the step over which it lets changes decay; 0 for explicit formulas.
    fn filter_part(&self) -> f64 {
        0.0
    }

    /// Multiplies a change of w at the end of the last accepted step by (I − γh J)⁻¹, as the formula does with its
    /// estimate of the error; explicit formulas leave it as it is.
    fn filter(&mut self, _ode: &mut dyn LinearizedOde, _change: &mut [f64]) {}

    /// Makes J of [`Stepper::filter`] that of `t_end`, the end of the last accepted step, of length h, until the next attempt;
    /// false where there is no J.
    ///
    /// # Errors
    /// When the system cannot be linearized there, or its matrix is singular; then the step cannot be accepted any more.
    fn linearize_at_end(
        &mut self,
        _ode: &mut dyn LinearizedOde,
        _t_end: f64,
        _h: f64,
    ) -> Result<bool, EvaluationFailure> {
        Ok(false)
    }

    /// Whether inside the last accepted step, of length h to `t_end`, accelerations answer to what [`Stepper::filter`] makes of their
    /// defect at θ as J says: whether it tells what becomes of that. Source: `docs/theory/method.md` (11c).
    ///
    /// # Errors
    /// Where the system cannot be evaluated.
    fn answers_inside(
        &mut self,
        _ode: &mut dyn LinearizedOde,
        _t_end: f64,
        _h: f64,
        _theta: f64,
    ) -> Result<bool, EvaluationFailure> {
        Ok(true)
    }

    /// What a formula that keeps slopes of earlier steps has kept, as numbers; empty for others.
    fn history(&self) -> Vec<f64> {
        Vec::new()
    }

    /// Goes on with the history of a stepper for as many unknowns; false if it is none.
    fn recall(&mut self, history: &[f64]) -> bool {
        history.is_empty()
    }

    /// What the last attempt was rejected for, in w: the last correction of an iteration that failed,
    /// or the estimated error; empty where neither is kept.
    fn last_change(&self) -> &[f64] {
        &[]
    }

    /// The error that the formula itself left in the last attempt, in w, where it was found.
    fn own_error(&self) -> Option<&[f64]> {
        None
    }

    /// The next step, of length h, is chosen by something else than errors: how these changed up to it says nothing of it.
    fn begin_trend(&mut self, _h: f64) {}

    /// Multiplies error estimates by `by`^(p̂ + 1), p̂ their order, so that steps become shorter by this factor, at least 1; 1 until
    /// this is called.
    fn shorten(&mut self, by: f64);

    /// Lowers the contraction up to which a linearization serves the next step, where the options allow more; explicit formulas have
    /// no linearization.
    fn reuse_below(&mut self, _contraction: f64) {}

    /// Work since construction.
    fn statistics(&self) -> &StepperStatistics;
}

/// Length of the first step of a formula of order `order` from (t, w) with slope g.
///
/// `scratch` holds two vectors of the dimension; the cost is one evaluation.
///
/// # Errors
/// When the system cannot be evaluated at the end of the explicit Euler trial, however short.
pub fn initial_step(
    ode: &mut dyn Ode,
    order: u32,
    t: f64,
    w: &[f64],
    g: &[f64],
    max_step: f64,
    scratch: &mut [Vec<f64>; 2],
) -> Result<f64, EvaluationFailure> {
    let slope = ode.norm(g);
    let mut h = trial_step(slope, max_step);
    let [end, rate] = scratch;
    let mut attempts = 0;
    loop {
        for ((end, &w), &g) in end.iter_mut().zip(w).zip(g) {
            *end = w + h * g;
        }
        match ode.derivative(t + h, end, rate) {
            Ok(()) => break,
            Err(failure) if attempts == 10 => return Err(failure),
            Err(_) => h *= 0.1,
        }
        attempts += 1;
    }
    for (rate, &g) in rate.iter_mut().zip(g) {
        *rate = (*rate - g) / h;
    }
    Ok(starting_step(order, slope, ode.norm(rate), max_step))
}

/// y ← y + a x.
pub(crate) fn add_scaled(y: &mut [f64], a: f64, x: &[f64]) {
    if a != 0.0 {
        for (y, &x) in y.iter_mut().zip(x) {
            *y += a * x;
        }
    }
}
