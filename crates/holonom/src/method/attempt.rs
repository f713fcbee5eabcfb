//! One attempt of an implicit formula, as far as it is the same for all of them: the age of the
//! linearization, what is tried when an iteration fails, the judgement of the error, and what attempts
//! leave behind.

use super::balance::Balance;
use super::counted::Counted;
use super::iteration::{Failure, Iteration, MAX_SYSTEMS};
use super::matrices::{Ahead, Matrices, Place};
use super::memory::Memory;
use super::ode::{EvaluationFailure, LinearizedOde};
use super::segment::Segment;
use super::stages::{Stages, Step};
use super::stepper::{Rejection, StepEnd, StepReport, Stepper, StepperOptions, StepperStatistics};
use crate::control::{StepControl, StepLaw, StepVerdict, noise};
use crate::math::vector::larger;

/// An estimate is to be at least 0.3 τ^(−1/4) times the error of a formula itself. With estimates of order 3 a motion of a
/// few turns takes about 10 τ^(−1/4) steps, whose errors then add up to 30 tolerances, if they persist.
const OWN_ERROR: f64 = 0.3;
/// Part of what a filter leaves by which accelerations may answer otherwise than its matrix says.
const ANSWERS: f64 = 0.5;
/// Part of those steps that a linearization serves at most, and the least of that, however small corrections are: carried
/// errors grow as it says, and what makes them grow may turn and vibrate while iterations hardly see it.
const SERVICE: f64 = 0.02;
const LEAST_SERVICE: f64 = 5.0;

/// What the end of a step is asked for by (11c) of `docs/theory/method.md`, its inside by (13) to (15), and room for both.
#[derive(Debug, Clone)]
pub(super) struct AtEnd {
    /// d.
    pub(super) defect: Vec<f64>,
    /// δ, then r.
    pub(super) change: Vec<f64>,
    /// w₁ + δ, and the slopes there and at w₁.
    pub(super) state: Vec<f64>,
    pub(super) answer: Vec<f64>,
    pub(super) slope: Vec<f64>,
}

impl AtEnd {
    fn new(dimension: usize) -> Self {
        let [defect, change, state, answer, slope] = std::array::from_fn(|_| vec![0.0; dimension]);
        Self { defect, change, state, answer, slope }
    }
}

/// What is left of errors inside a step.
pub(super) struct Inside {
    /// How far off what tells of rows is, scaled: at most 1 in a step that counts.
    pub(super) off: f64,
    /// What follows from it for the next length, over the present one.
    pub(super) ratio: f64,
}

impl Inside {
    /// Nothing.
    pub(super) const RIGHT: Self = Self { off: 0.0, ratio: f64::INFINITY };
}

/// Stepper of an implicit formula with the stages `S`.
#[derive(Debug, Clone)]
pub struct ImplicitStepper<S> {
    pub(super) stages: S,
    pub(super) options: StepperOptions,
    control: StepControl,
    pub(super) memory: Memory,
    /// The memory before the last attempt, for [`Stepper::discard`].
    before: Memory,
    /// The last attempt was accepted and nothing has been built on it yet.
    pending: bool,
    matrices: Matrices,
    /// They are of the end of the last attempt.
    are_of_end: bool,
    /// Steps that a linearization serves at most.
    most_served: f64,
    /// The step before may predict this one.
    pub(super) predicts: bool,
    /// Weighted norm of round-off in w₀.
    floor: f64,
    error_at_kinks: f64,
    ahead: Ahead,
    /// The last correction of an iteration, or the estimated error.
    change: Vec<f64>,
    /// Length of the attempt before from the same state, and what of its estimate a filter may not take away, where there is such.
    rough: Option<[f64; 2]>,
    pub(super) at_end: AtEnd,
    pub(super) balance: Option<Balance>,
    /// Error of the formula itself, and how many times as large their orders promise an estimate to be.
    own: Vec<f64>,
    promised: Option<f64>,
    /// Whether that error was found in the last attempt.
    pub(super) knows_own: bool,
    /// How many times errors count.
    strictness: f64,
    /// The contraction up to which linearizations may serve on by the options.
    reuse_contraction: f64,
    pub(super) current: Segment,
    pub(super) previous: Segment,
    statistics: StepperStatistics,
}

impl<S: Stages> ImplicitStepper<S> {
    /// A stepper for systems of `dimension` unknowns.
    pub(super) fn of(stages: S, dimension: usize, options: StepperOptions) -> Self {
        let (p, below) = (stages.order(), stages.embedded_order());
        let exponent = f64::from(p - below) / f64::from(below + 1);
        let law = if options.improves() { StepLaw::Predictive } else { StepLaw::Standard };
        Self {
            options,
            control: StepControl { law, ..StepControl::implicit(stages.embedded_order()) },
            memory: Memory::default(),
            before: Memory::default(),
            pending: false,
            matrices: Matrices::NONE,
            are_of_end: false,
            most_served: options.own_error.map_or(f64::INFINITY, |tolerance| {
                let of_turns = 10.0 * tolerance.powf(-1.0 / f64::from(below + 1));
                (SERVICE * of_turns).max(LEAST_SERVICE)
            }),
            predicts: false,
            floor: 0.0,
            error_at_kinks: stages.error_at_kinks().max(1.0),
            ahead: Ahead::new(dimension),
            change: vec![0.0; dimension],
            own: vec![0.0; dimension],
            rough: None,
            at_end: AtEnd::new(dimension),
            balance: Balance::new(stages.balanced_places()),
            knows_own: false,
            strictness: 1.0,
            reuse_contraction: options.reuse_contraction,
            promised: options.own_error.map(|tolerance| tolerance.powf(-exponent)),
            current: Segment::new(dimension, S::DEGREE),
            previous: Segment::new(dimension, S::DEGREE),
            statistics: StepperStatistics::default(),
            stages,
        }
    }

    /// Makes the accepted step the past.
    fn commit(&mut self) {
        if std::mem::take(&mut self.pending) {
            std::mem::swap(&mut self.current, &mut self.previous);
            self.predicts = true;
            self.stages.commit();
            self.matrices.grow_old();
            self.rough = None;
        }
        self.are_of_end = false;
    }

    /// One try of all stages with the matrices at hand.
    fn iterate(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
        report: &mut StepReport,
    ) -> Result<u32, Failure> {
        let mut iteration = Iteration {
            before: self.predicts.then_some(&self.previous),
            control: self.options.iteration(),
            floor: self.floor,
            eta: &mut self.memory.eta,
            change: &mut self.change,
            report,
        };
        self.stages.iterate(ode, step, &mut iteration)
    }

    /// Linearization, factorization and stages. An iteration that fails is repeated with a fresh
    /// linearization, with a full one, and by other residuals, before the step is made shorter.
    fn solve(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
        report: &mut StepReport,
    ) -> Result<u32, Failure> {
        let reuse =
            self.memory.reuses(&self.options) && f64::from(self.matrices.served) < self.most_served;
        let ahead = S::ITERATES && self.options.improves() && self.predicts;
        let ahead = ahead.then_some((&mut self.ahead, &self.previous));
        self.matrices.begin(ode);
        self.matrices.prepare(&mut self.stages, ode, step, reuse, ahead)?;
        let evaluations = S::REPEATS_EVALUATIONS || self.options.fixed_step;
        let repeats = |failure: &Failure| evaluations || failure.is_of_newton();
        let mut outcome = self.iterate(ode, step, report);
        while S::ITERATES && outcome.as_ref().is_err_and(repeats) {
            // A fixed step has no shorter one to try.
            let last_resort = self.options.fixed_step && self.predicts;
            let others =
                self.options.improves() && outcome.as_ref().is_err_and(Failure::is_of_newton);
            let remedy = self.matrices.remedy(ode, others);
            let Some(place) = remedy.or(last_resort.then_some(Place::Start)) else { break };
            let ahead = place == Place::Middle && self.predicts;
            let ahead = ahead.then_some((&mut self.ahead, &self.previous));
            self.matrices.prepare(&mut self.stages, ode, step, false, ahead)?;
            report.contraction = 0.0;
            self.predicts &= !last_resort || place == Place::Middle;
            outcome = self.iterate(ode, step, report);
        }
        outcome
    }

    /// Scaled error, filtered; estimated again where a first or repeated attempt would fail, because
    /// transients there are not what the step has to follow.
    fn error(&mut self, ode: &mut Counted<'_>, step: &Step<'_>) -> Result<f64, EvaluationFailure> {
        let estimate = self.caution() * self.estimated(ode, step)?;
        if estimate <= 1.0 && !self.options.fixed_step {
            Ok(self.at_least_own(estimate, ode, step))
        } else {
            Ok(estimate)
        }
    }

    /// What an estimate is multiplied by before it is judged.
    fn caution(&self) -> f64 {
        self.options.caution * self.strictness
    }

    /// The estimate, or the error of the formula itself, multiplied by what an estimate should exceed it by. Then that is
    /// in its place, as large as orders promise an estimate to be. Source: `docs/theory/method.md` (11b).
    fn at_least_own(&mut self, estimate: f64, ode: &mut Counted<'_>, step: &Step<'_>) -> f64 {
        let Some(promised) = self.promised else { return estimate };
        self.knows_own = self.stages.own_error(ode, step.h, &mut self.own);
        if !self.knows_own {
            return estimate;
        }
        let size = self.strictness * ode.error_norm(&self.own, self.stages.end().w);
        let own = (OWN_ERROR * promised).max(1.0) * size;
        if own <= estimate {
            return estimate;
        }
        own
    }

    fn estimated(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
    ) -> Result<f64, EvaluationFailure> {
        let caution = self.caution();
        let (stages, error, imbalance) =
            (&mut self.stages, &mut self.change, &mut self.at_end.change);
        stages.estimate(ode, step, error)?;
        if !self.options.filter_error {
            return Ok(ode.error_norm(error, stages.end().w));
        }
        let least = S::LEAST_FILTERED.map(|part| part * ode.error_norm(error, stages.end().w));
        stages.filter(ode, error);
        let filtered = ode.error_norm(error, stages.end().w);
        // What the length of the step changes by less than half as much was there before it.
        let before = least.and_then(|least| self.rough.replace([step.h, least]));
        let stays = |least: f64, [h, size]: [f64; 2]| {
            (least - size).abs() <= 0.5 * (1.0 - step.h / h) * size
        };
        let counts = |least: &f64| !before.is_some_and(|before| stays(*least, before));
        let mut found = least.filter(counts).map_or(filtered, |least| larger(filtered, least));
        if let Some(part) = S::LEAST_FILTERED
            && stages.imbalance(ode, step, imbalance)
        {
            found = larger(found, part * ode.error_norm(imbalance, stages.end().w));
        }
        let again = caution * found > 1.0 && self.memory.is_fragile() && !self.options.fixed_step;
        if !(again && stages.estimate_again(ode, step, error)) {
            return Ok(found);
        }
        stages.filter(ode, error);
        Ok(ode.error_norm(error, stages.end().w))
    }

    /// What the accepted step of a formula that does not iterate has left at its end, scaled: accelerations of the equations beyond
    /// those of the step, where the matrix damps them and they do not answer as it says, by the matrix of the end, or whole. Source:
    /// `docs/theory/method.md` (11c).
    fn hidden(&mut self, ode: &mut Counted<'_>, step: &Step<'_>) -> Result<f64, EvaluationFailure> {
        if S::ITERATES || self.options.fixed_step {
            return Ok(0.0);
        }
        self.stages.end_defect(ode, step, &mut self.at_end.defect);
        let whole = ode.error_norm(&self.at_end.defect, self.stages.end().w);
        let by_start = self.filter_defect(ode);
        if whole - by_start <= 1.0 || self.answers(ode, step, by_start)? {
            return Ok(0.0);
        }
        self.matrices.forget();
        ode.linearize(step.t + step.h, self.stages.end().w)?;
        self.stages.factor(ode, step.h)?;
        let by_end = self.filter_defect(ode);
        Ok(if self.answers(ode, step, by_end)? { by_end - by_start } else { whole })
    }

    /// δ of (11c) by the matrix at hand. Returns its scaled size.
    fn filter_defect(&mut self, ode: &mut Counted<'_>) -> f64 {
        let Self { stages, at_end: AtEnd { defect, change, .. }, .. } = self;
        change.copy_from_slice(defect);
        stages.filter(ode, change);
        ode.error_norm(change, stages.end().w)
    }

    /// Whether accelerations answer to δ, of this size, as the matrix says. What was evaluated last is the end.
    fn answers(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
        size: f64,
    ) -> Result<bool, EvaluationFailure> {
        let Self { stages, at_end: AtEnd { defect, change, state, answer, slope }, .. } = self;
        let (t_end, gamma_h) = (step.t + step.h, stages.gamma() * step.h);
        let w = stages.end().w;
        for (state, (w, change)) in state.iter_mut().zip(w.iter().zip(&*change)) {
            *state = w + change;
        }
        ode.derivative(t_end, state, answer)?;
        ode.derivative(t_end, w, slope)?;
        for (k, change) in change.iter_mut().enumerate() {
            *change = defect[k] - *change + gamma_h * (answer[k] - slope[k]);
        }
        stages.filter(ode, change);
        let left = ode.error_norm(change, stages.end().w);
        Ok(left <= noise(self.floor).max(ANSWERS * size))
    }

    /// The attempt up to its judgement: error, and what follows from it.
    fn advance(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
        report: &mut StepReport,
    ) -> Result<(f64, StepVerdict), Failure> {
        let last_stage = self.solve(ode, step, report)?;
        self.matrices.observe(ode, report.contraction);
        if report.contraction > 0.0 {
            self.memory.contraction = report.contraction;
        } else if S::ITERATES && !self.memory.is_fragile() && self.memory.contraction.is_infinite()
        {
            // One correction each was enough, so the matrix is good enough for more steps. After a failure it is not
            // known what a matrix is good for.
            self.memory.contraction = f64::EPSILON;
        }
        let error = self.error(ode, step)?;
        let verdict = self.memory.judge(self.control, &self.options, step.h, error, last_stage);
        Ok((error, verdict))
    }

    /// Weighted norm of round-off at the start of the step.
    fn find_floor(&mut self, ode: &mut Counted<'_>, step: &Step<'_>) {
        // A step without error control may start at w = 0; elsewhere |w| alone is the safe scale.
        let movement = if self.options.fixed_step { step.h } else { 0.0 };
        for ((scale, &w), &g) in self.change.iter_mut().zip(step.w).zip(step.g) {
            *scale = w.abs() + movement * g.abs();
        }
        self.floor = f64::EPSILON * ode.norm(&self.change);
    }
}

impl<S: Stages> Stepper for ImplicitStepper<S> {
    fn order(&self) -> u32 {
        self.stages.order()
    }

    fn starting_order(&self) -> u32 {
        self.stages.embedded_order()
    }

    fn error_at_kinks(&self) -> f64 {
        self.error_at_kinks
    }

    fn explicit(&self) -> bool {
        false
    }

    fn restart(&mut self) {
        self.invalidate();
        self.matrices = Matrices::NONE;
        self.memory = Memory::default();
        self.stages.restart();
    }

    fn invalidate(&mut self) {
        self.commit();
        self.predicts = false;
        self.memory.eta = [1.0; MAX_SYSTEMS];
        self.stages.invalidate();
        self.matrices.forget();
        self.memory.contraction = f64::INFINITY;
    }

    fn begin_trend(&mut self, h: f64) {
        self.memory.history.accept(h, 1.0);
    }

    fn discard(&mut self) {
        if std::mem::take(&mut self.pending) {
            self.memory = self.before;
        }
        if std::mem::take(&mut self.are_of_end) {
            self.matrices.forget();
        }
    }

    fn attempt(
        &mut self,
        ode: &mut dyn LinearizedOde,
        t: f64,
        h: f64,
        w: &[f64],
        g: &[f64],
    ) -> StepReport {
        self.commit();
        let step = Step { t, h, w, g, is_fixed: self.options.fixed_step };
        let mut ode = Counted::new(ode, self.statistics);
        let mut report = StepReport::rejected(h);
        self.before = self.memory;
        self.knows_own = false;
        self.find_floor(&mut ode, &step);
        match self.advance(&mut ode, &step, &mut report) {
            Ok((error, StepVerdict::Accept { next })) => {
                self.stages.finish(&mut ode, &step, &mut self.current);
                let hidden = self.hidden(&mut ode, &step).unwrap_or(f64::INFINITY);
                let is_right_at_end = hidden <= 1.0; // so that a NaN is refused
                let inside = if is_right_at_end {
                    self.settle_inside(&mut ode, &step)
                } else {
                    Inside::RIGHT
                };
                let by_inside = h * inside.ratio.max(self.control.min_ratio);
                // Written so that a NaN fails.
                let is_right_inside = inside.off <= 1.0 || self.options.fixed_step;
                if !is_right_at_end {
                    self.matrices.forget();
                    self.memory.history.reject();
                    report.error = hidden;
                    // What is moved by accelerations grows like the square of the step.
                    report.next_step = h * (0.9 / hidden.sqrt()).max(self.control.min_ratio);
                    report.cause = Some(Rejection::ErrorTooLarge);
                } else if !is_right_inside {
                    self.memory.history.reject();
                    (report.error, report.next_step) = (inside.off, by_inside);
                    report.cause = Some(Rejection::ErrorTooLarge);
                } else {
                    self.pending = true;
                    self.memory.history.accept(h, error);
                    let longest = self.memory.longest_after(h, report.contraction).min(by_inside);
                    report.accept(error, next.min(longest).min(self.options.max_step));
                }
            }
            Ok((error, StepVerdict::Reject { retry })) => {
                self.memory.history.reject();
                (report.error, report.next_step) = (error, retry);
                report.cause = Some(Rejection::ErrorTooLarge);
            }
            Err(failure) => {
                self.predicts = false;
                if failure.is_of_newton() {
                    self.memory.failed = h;
                }
                self.memory.history.reject();
                self.memory.contraction = f64::INFINITY;
                report.next_step = h * failure.ratio;
                report.cause = Some(failure.cause);
            }
        }
        let statistics = &mut ode.statistics;
        statistics.iterations += u64::from(report.iterations);
        statistics.contractions = statistics.contractions.plus(&report.contractions);
        self.statistics = ode.statistics;
        report
    }

    fn end(&self) -> StepEnd<'_> {
        self.stages.end()
    }

    fn interpolate(&mut self, theta: f64, w: &mut [f64]) {
        let last = if self.pending { &self.current } else { &self.previous };
        last.interpolate(theta, w);
    }

    fn largest_degree(&self) -> usize {
        S::DEGREE
    }

    fn polynomial(&self, coefficients: &mut [f64]) -> usize {
        let last = if self.pending { &self.current } else { &self.previous };
        last.write(coefficients);
        last.degree()
    }

    fn collocation_places(&self) -> Option<&'static [f64; 3]> {
        self.stages.collocation_places()
    }

    fn filter_part(&self) -> f64 {
        self.stages.gamma()
    }

    fn filter(&mut self, ode: &mut dyn LinearizedOde, change: &mut [f64]) {
        let mut ode = Counted::new(ode, self.statistics);
        // Matrices serve many steps, in which bodies may turn far.
        let turns = ode.turns();
        if turns {
            ode.turn_back(change);
        }
        self.stages.filter(&mut ode, change);
        if turns {
            ode.turn(0, change);
        }
        self.statistics = ode.statistics;
    }

    fn linearize_at_end(
        &mut self,
        ode: &mut dyn LinearizedOde,
        t_end: f64,
        h: f64,
    ) -> Result<bool, EvaluationFailure> {
        self.matrices.forget();
        let mut ode = Counted::new(ode, self.statistics);
        let linearized = ode.linearize(t_end, self.stages.end().w);
        let factored = linearized.and_then(|()| self.stages.factor(&mut ode, h));
        self.statistics = ode.statistics;
        factored?;
        // The start of the next step, if this one counts.
        self.matrices.take(h);
        self.are_of_end = true;
        Ok(true)
    }

    fn answers_inside(
        &mut self,
        ode: &mut dyn LinearizedOde,
        t_end: f64,
        h: f64,
        theta: f64,
    ) -> Result<bool, EvaluationFailure> {
        let (time, gamma_h) = (t_end + (theta - 1.0) * h, self.stages.gamma() * h);
        self.statistics.derivatives += 3;
        let AtEnd { defect, state, slope, .. } = &mut self.at_end;
        let last = if self.pending { &self.current } else { &self.previous };
        last.interpolate(theta, state);
        last.slope_beyond((theta - 1.0) * h, defect);
        ode.derivative(time, state, slope)?;
        for (defect, slope) in defect.iter_mut().zip(&*slope) {
            *defect = gamma_h * (slope - *defect);
        }
        let mut change = std::mem::take(&mut self.at_end.change);
        change.copy_from_slice(&self.at_end.defect);
        self.filter(ode, &mut change);
        let size = ode.error_norm(&change, self.stages.end().w);
        let AtEnd { defect, state, slope, answer, .. } = &mut self.at_end;
        state.iter_mut().zip(&change).for_each(|(state, change)| *state += change);
        let evaluated = ode.derivative(time, state, answer);
        for (k, change) in change.iter_mut().enumerate() {
            *change = defect[k] - *change + gamma_h * (answer[k] - slope[k]);
        }
        self.filter(ode, &mut change);
        let left = ode.error_norm(&change, self.stages.end().w);
        self.at_end.change = change;
        // What was evaluated last is the end.
        ode.derivative(t_end, self.stages.end().w, &mut self.at_end.slope)?;
        evaluated.map(|()| left <= noise(self.floor).max(ANSWERS * size))
    }

    fn last_change(&self) -> &[f64] {
        &self.change
    }

    fn own_error(&self) -> Option<&[f64]> {
        self.knows_own.then_some(&self.own[..])
    }

    fn shorten(&mut self, by: f64) {
        self.strictness = by.powi(self.stages.embedded_order() as i32 + 1);
    }

    fn reuse_below(&mut self, contraction: f64) {
        self.options.reuse_contraction = self.reuse_contraction.min(contraction);
    }

    fn statistics(&self) -> &StepperStatistics {
        &self.statistics
    }
}
