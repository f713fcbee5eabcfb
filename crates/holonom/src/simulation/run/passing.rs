//! What a step that was accepted by its formula has passed over: stops, contacts, bumps of the road.

use super::Run;
use crate::error::EvaluationFailure;
use crate::simulation::passage::{Looking, Passage, Place, Way};
use crate::simulation::recorder::Recorder;
use crate::system::{LawArgument, Measure};

/// Most parts of a step in whose middles accelerations are compared for these parts alone, since they deviate much.
const ALONE: usize = 3;
/// Moments at which they are compared for all other parts, each for an equal share of what the law deviates in these.
const SHARES: f64 = 3.0;

/// Part of a step in which accelerations of arguments are told by their rates.
const SHORT: f64 = 0.01;
/// Part of a step in which rates of velocities are told by their values.
const NEXT: f64 = 1e-3;
/// Part of the rate of an argument within which it keeps its way through a law; by a half of it a hill would turn it back.
const KEEPS_WAY: f64 = 0.25;

/// A part of a force law that a step has not seen, and that counts.
pub(super) struct PassedOver {
    /// Where a step would see it, s.
    pub(super) time: f64,
    /// Error that it makes, 1 = on tolerance.
    pub(super) error: f64,
}

impl Run<'_> {
    /// The first part of a force law that the attempt from `t` over `step` has passed over, if the error that this
    /// makes exceeds the tolerance.
    ///
    /// The formula's own estimate knows of the laws what its stages see. Where the argument of a law passes a knot,
    /// the accelerations of the equations are set against those of the dense output. A step into which one cannot
    /// look is refused, too: a shorter one can be looked into.
    pub(super) fn passed_over(&mut self, t: f64, step: f64, t_end: f64) -> Option<PassedOver> {
        let unknown = PassedOver { time: t + 0.5 * step, error: f64::INFINITY };
        self.passes_knot = false;
        self.delay = 0.0;
        self.passed.fill(0.0);
        if !self.may_pass_over(t, step, t_end) {
            return None;
        }
        let [first, halfway, last] = &mut self.law_places;
        if halfway.is_empty() {
            return Some(unknown);
        }
        self.system.law_places(&self.state, first);
        self.system.law_places(&self.form.point().state, last);
        let mut inspector = self.inspector.take()?;
        let mut way = std::mem::take(&mut self.way);
        let mut look = |run: &mut Self| {
            let found = run.look_into([t, step, t_end], &mut inspector, &mut way);
            found.unwrap_or(Some(PassedOver { ..unknown }))
        };
        self.damped.clear();
        let mut found = look(self);
        // What a matrix from inside a contact damps does not decay where the contact is left.
        if found.is_none() && !self.damped.is_empty() {
            self.damped.clear();
            self.passed.fill(0.0);
            found = match self.stepper.linearize_at_end(self.form.as_mut(), t_end, step) {
                Ok(true) => look(self),
                Ok(false) => None,
                Err(_) => Some(PassedOver { ..unknown }),
            };
        }
        // Nor where friction that holds at both ends lets go in between.
        while let (None, Some(damped)) = (&found, self.damped.pop()) {
            let theta = ((damped.time - t) / step).clamp(0.0, 1.0);
            let form = self.form.as_mut();
            found = match self.stepper.answers_inside(form, t_end, step, theta) {
                Ok(true) => None,
                Ok(false) => Some(damped),
                Err(_) => Some(PassedOver { ..unknown }),
            };
        }
        (self.way, self.inspector) = (way, Some(inspector));
        found
    }

    /// The first time in the attempt from `t` over `step` at which the argument of a law passes a knot, by its rate and
    /// acceleration at the start.
    pub(super) fn next_knot(&mut self, t: f64, step: f64) -> Option<f64> {
        let (system, state, moved) = (self.system.as_ref(), &self.state, &mut self.row);
        let [here, _, there] = &mut self.law_places;
        let short = SHORT * step;
        moved.copy_from(state);
        for (q, v) in moved.q.iter_mut().zip(&state.v) {
            *q += short * v;
        }
        for (v, a) in moved.v.iter_mut().zip(&state.a) {
            *v += short * a;
        }
        system.law_places(state, here);
        system.law_places(moved, there);
        let places = here.iter().copied().zip(&*there);
        let times = system.law_arguments().iter().zip(places).filter_map(|(argument, places)| {
            let (mut here, there) = places;
            let mut acceleration = (there.rate - here.rate) / short;
            if argument.is_velocity {
                if here.value.abs() <= here.smooth {
                    return None;
                }
                (here.rate, acceleration) = ((there.value - here.value) / short, 0.0);
            }
            let knots = &argument.knots;
            let below = knots.partition_point(|&knot| knot < here.value);
            let above = knots.partition_point(|&knot| knot <= here.value);
            let next = [knots[..below].last(), knots.get(above)].into_iter().flatten();
            let ways = next.map(|knot| soonest(knot - here.value, here.rate, acceleration));
            ways.reduce(f64::min)
        });
        let first = t + times.fold(f64::INFINITY, f64::min);
        (first < t + step).then_some(first)
    }

    fn look_into(
        &mut self,
        times: [f64; 3],
        inspector: &mut Recorder,
        way: &mut Way,
    ) -> Result<Option<PassedOver>, EvaluationFailure> {
        let system = self.system.clone();
        let mut found: Option<PassedOver> = None;
        for (k, argument) in system.law_arguments().iter().enumerate() {
            self.follow(way, inspector, (k, argument), times)?;
            self.passes_knot |= way.passes_knot();
            let delay = way.delay_at_cusps(system.as_ref(), argument);
            self.delay = self.delay.max(self.options.tolerance.translation * delay);
            let step = [times[0], times[1]];
            let at_cusps = self.missed(inspector, step, None, way.cusps())?;
            let passages = way.passages(system.as_ref(), argument);
            let held = (!argument.is_velocity).then_some(argument);
            let between = self.missed(inspector, step, held, passages)?;
            let passed = [at_cusps, between].into_iter().flatten().chain(found);
            found =
                passed.reduce(|first, other| if other.time < first.time { other } else { first });
        }
        Ok(found)
    }

    /// Whether a law may have been passed over: always if it has knots, otherwise if its line is so short at one end
    /// of the attempt that it may be next to its other end within.
    pub(super) fn may_pass_over(&self, t: f64, step: f64, t_end: f64) -> bool {
        let system = self.system.as_ref();
        let arguments = system.law_arguments();
        let ends = [(t, &self.state), (t_end, &self.form.point().state)];
        let is_near_cusp = |argument: &LawArgument| {
            let near = |(time, state)| Place::of(system, argument, time, state).is_near_cusp(step);
            ends.into_iter().any(near)
        };
        self.inspector.is_some()
            && (arguments.iter().any(|argument| !argument.knots.is_empty())
                || arguments.iter().any(is_near_cusp))
    }

    /// A change of the argument of a law that does not count: its absolute tolerance. Friction changes from one side to the other
    /// within any velocity.
    pub(super) fn negligible(&self, argument: &LawArgument) -> f64 {
        let tolerance = &self.options.tolerance;
        if argument.is_velocity {
            return 0.0;
        }
        match argument.measure {
            Measure::Length => tolerance.translation,
            Measure::Angle => tolerance.rotation,
        }
    }

    /// Follows the argument of a law through the attempt.
    fn follow(
        &mut self,
        way: &mut Way,
        inspector: &mut Recorder,
        (k, argument): (usize, &LawArgument),
        [t, step, t_end]: [f64; 3],
    ) -> Result<(), EvaluationFailure> {
        let system = self.system.as_ref();
        let negligible = self.negligible(argument);
        let mut places = [(t, 0), (t + 0.5 * step, 1), (t_end, 2)]
            .map(|(time, at): (f64, usize)| Place::at(time, self.law_places[at][k]));
        let stepper = &mut self.stepper;
        let interpolate = &mut |theta: f64, w: &mut [f64]| stepper.interpolate(theta, w);
        let mut at = |time: f64| {
            let state = inspector.state(interpolate, t, step, (time - t) / step, false)?;
            Ok(Place::of(system, argument, time, state))
        };
        let knots = &argument.knots;
        if !argument.is_velocity {
            let looking = Looking { knots, negligible, bends: false, inside: &mut at };
            return way.follow(looking, places);
        }
        if !Place::may_pass(&places, knots) {
            way.clear();
            return Ok(());
        }
        let next_to = |time: f64| time + NEXT * if time - t < 0.5 * step { step } else { -step };
        for place in &mut places {
            *place = place.with_rate(&at(next_to(place.time))?);
        }
        let inside = &mut |time: f64| {
            let next = at(next_to(time))?;
            Ok(at(time)?.with_rate(&next))
        };
        way.follow(Looking { knots, negligible, bends: true, inside }, places)
    }

    /// Where a law deviates most, if what the attempt misses of it exceeds the tolerance; or where that would change the rate of
    /// its argument so much that this would not go on as it does, whatever else makes up for it.
    fn missed(
        &mut self,
        inspector: &mut Recorder,
        [t, step]: [f64; 2],
        argument: Option<&LawArgument>,
        passages: &[Passage],
    ) -> Result<Option<PassedOver>, EvaluationFailure> {
        if passages.is_empty() {
            return Ok(None);
        }
        let (alone, share) = looked_at_alone(passages);
        self.missed.iter_mut().for_each(|missed| missed.fill(0.0));
        let (mut sum, mut looked, mut worst) = (0.0, 0.5, &passages[0]);
        let mut turned: Option<PassedOver> = None;
        for (k, passage) in passages.iter().enumerate() {
            if passage.weight() > worst.weight() {
                worst = passage;
            }
            let duration = if alone.contains(&Some(k)) {
                passage.duration
            } else {
                sum += passage.weight();
                let mut shares = 0.0;
                while looked < SHARES && looked * share <= sum {
                    looked += 1.0;
                    shares += share;
                }
                let duration = shares / passage.deviation;
                // Before the first knot formulas without a stage at the start of a step know nothing.
                if passage.is_first { duration.max(passage.duration) } else { duration }
            };
            if duration > 0.0 {
                self.miss(inspector, [t, step], passage.time, duration)?;
                if let (None, Some(argument)) = (&turned, argument) {
                    let part = self.turned_part(inspector, [t, step], argument, passage.time)?;
                    let error = part / KEEPS_WAY;
                    turned = (error > 1.0).then_some(PassedOver { time: passage.time, error });
                }
            }
        }
        let [near, far] = &mut self.missed;
        let whole = &mut self.scratch[0];
        whole.copy_from_slice(near);
        whole.iter_mut().zip(&*far).for_each(|(whole, far)| *whole += far);
        let undamped = self.form.error_norm(whole, &self.w_end);
        // Changes of velocities and of positions both as changes of velocities: what the filter makes of them together
        // may cancel where a step is as long as a swing.
        let moved = &mut self.scratch[0];
        let ndof = self.form.second_order_split();
        moved.fill(0.0);
        moved[ndof..2 * ndof].copy_from_slice(&far[..ndof]);
        far[..ndof].fill(0.0);
        for velocities in [&mut *far, &mut *moved] {
            self.stepper.filter(self.form.as_mut(), velocities);
        }
        for k in 0..ndof {
            near[k] += moved[ndof + k];
            near[ndof + k] += far[ndof + k];
        }
        self.passed.iter_mut().zip(&*near).for_each(|(passed, missed)| *passed += missed);
        let error = self.form.error_norm(near, &self.w_end);
        if error <= 1.0 && undamped > 1.0 {
            self.damped.push(PassedOver { time: worst.time, error: undamped });
        }
        Ok((error > 1.0).then_some(PassedOver { time: worst.time, error }).or(turned))
    }

    /// By which part of its rate at `time`, up to all of it, an argument would be slower or faster for what is missed up to the end of the part of
    /// the step there; 0 where that is within the tolerance of velocities.
    fn turned_part(
        &mut self,
        inspector: &mut Recorder,
        [t, step]: [f64; 2],
        argument: &LawArgument,
        time: f64,
    ) -> Result<f64, EvaluationFailure> {
        let ndof = self.form.second_order_split();
        let (change, [near, far]) = (&mut self.scratch[1], &self.missed);
        change.fill(0.0);
        for k in ndof..2 * ndof {
            change[k] = near[k] + far[k];
        }
        if self.form.error_norm(change, &self.w_end) <= 1.0 {
            return Ok(0.0);
        }
        let (system, stepper, theta) = (self.system.as_ref(), &mut self.stepper, (time - t) / step);
        let mut rate = |part: f64| {
            let interpolate = &mut |theta: f64, w: &mut [f64]| {
                stepper.interpolate(theta, w);
                w.iter_mut().zip(&*change).for_each(|(w, change)| *w += part * change);
            };
            let state = inspector.state(interpolate, t, step, theta, false)?;
            Ok(Place::of(system, argument, time, state).rate)
        };
        let (before, after) = (rate(0.0)?, rate(1.0)?);
        let change = (after - before).abs();
        let part = change / before.abs().max(change);
        Ok(if part.is_nan() { 0.0 } else { part })
    }

    /// Adds what the end of the attempt misses if its accelerations miss those of the equations for `duration` seconds
    /// as they do at `time`.
    fn miss(
        &mut self,
        inspector: &mut Recorder,
        [t, step]: [f64; 2],
        time: f64,
        duration: f64,
    ) -> Result<(), EvaluationFailure> {
        let theta = ((time - t) / step).clamp(0.0, 1.0);
        let ([near, far], [slope, _]) = (&mut self.missed, &mut self.scratch);
        let stepper = &mut self.stepper;
        let interpolate = &mut |theta: f64, w: &mut [f64]| stepper.interpolate(theta, w);
        inspector.slope(interpolate, t, step, theta, slope)?;
        let (n, degree, ndof) =
            (near.len(), self.stepper.largest_degree(), self.form.second_order_split());
        self.coefficients.resize((degree + 1) * n, 0.0);
        let degree = self.stepper.polynomial(&mut self.coefficients);
        let powers = self.coefficients.chunks_exact(n.max(1)).take(degree + 1);
        let mut weight = 1.0 / step;
        for (j, power) in powers.enumerate().skip(1) {
            for (slope, power) in slope[ndof..2 * ndof].iter_mut().zip(&power[ndof..]) {
                *slope -= j as f64 * weight * power;
            }
            weight *= theta;
        }
        let left = t + step - time;
        let damped = (left / (self.stepper.filter_part() * step)).min(1.0).powi(2);
        for k in 0..ndof {
            let change = duration * slope[ndof + k];
            for (missed, part) in [(&mut *near, 1.0 - damped), (&mut *far, damped)] {
                missed[ndof + k] += part * change;
                missed[k] += part * left * change;
            }
        }
        Ok(())
    }
}

/// The parts that are looked at for themselves, since they are more than an equal share of what others have, and such a share.
fn looked_at_alone(passages: &[Passage]) -> ([Option<usize>; ALONE], f64) {
    let mut alone = [None; ALONE];
    let mut share = f64::INFINITY;
    for taken in 0..=ALONE {
        let others = || passages.iter().enumerate().filter(|(k, _)| !alone.contains(&Some(*k)));
        let weights = others().map(|(_, passage)| passage.weight());
        let Some((k, largest)) =
            others().max_by(|(_, a), (_, b)| a.weight().total_cmp(&b.weight()))
        else {
            break;
        };
        share = weights.sum::<f64>() / SHARES;
        let few = passages.len() <= ALONE;
        match alone.get_mut(taken) {
            Some(place) if few || largest.weight() >= share => *place = Some(k),
            _ => break,
        }
    }
    (alone, share)
}

/// When something has come as far as `way`, s: the smallest τ > 0 with rate τ + ½ acceleration τ² = way; never is infinite.
fn soonest(way: f64, rate: f64, acceleration: f64) -> f64 {
    let square = rate * rate + 2.0 * acceleration * way;
    if square < 0.0 {
        return f64::INFINITY;
    }
    let sum = rate + square.sqrt().copysign(rate);
    let times = [2.0 * way / sum, sum / acceleration];
    let ahead = times.into_iter().filter(|time| *time > 0.0);
    ahead.fold(f64::INFINITY, f64::min)
}
