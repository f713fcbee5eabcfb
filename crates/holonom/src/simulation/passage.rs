//! Parts of force laws that a step passes over.

use crate::error::EvaluationFailure;
use crate::system::{LawArgument, LawPlace, State, System};
use std::f64::consts::PI;

/// Halvings of a piece of a cubic in search of a knot: round-off.
const HALVINGS: u32 = 50;
/// Halvings of each half of a step in search of a course that is a cubic.
const PARTS: u32 = 10;
/// The same in search of the moment at which a line is next to its other end, where its length has a cusp.
const PARTS_AT_CUSP: u32 = 25;
/// States that a law is worth: with knots those of all parts, without those on the way to a cusp from both sides. What
/// turns on and on is not followed through all its turns.
const STATES: [usize; 2] = [2 << PARTS, 4 * PARTS_AT_CUSP as usize];
/// Turn of a line within which its length is a cubic, rad.
const TURN: f64 = 0.5;
/// What cubics seem to miss may be so many times as much.
const CAUTION: f64 = 4.0;

/// An argument of a law at a time; its unit is that of the knots.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    /// s.
    pub(super) time: f64,
    pub(super) value: f64,
    pub(super) rate: f64,
    /// How fast the direction may turn that it depends on, rad/s.
    pub(super) turning: f64,
    /// Up to which size of a velocity the law has no feature.
    pub(super) smooth: f64,
}

impl Place {
    /// The argument at a state.
    pub(super) fn of(
        system: &dyn System,
        argument: &LawArgument,
        time: f64,
        state: &State,
    ) -> Self {
        Self::at(time, system.law_place(argument, state))
    }

    /// The argument where it stands so at a time, s.
    pub(super) fn at(time: f64, LawPlace { value, rate, turning, smooth }: LawPlace) -> Self {
        Self { time, value, rate, turning, smooth }
    }

    /// A velocity with its rate, which the value at another time tells.
    pub(super) fn with_rate(self, other: &Self) -> Self {
        let rate = (other.value - self.value) / (other.time - self.time);
        Self { rate, ..self }
    }

    /// Whether a velocity may pass one of the knots near these places of a step.
    pub(super) fn may_pass(places: &[Self; 3], knots: &[f64]) -> bool {
        let bends = places.iter().any(|place| place.value.abs() > place.smooth);
        let [least, largest] =
            places.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[least, largest], place| {
                [least.min(place.value), largest.max(place.value)]
            });
        let spread = largest - least;
        let below = |value: f64| knots.partition_point(|&knot| knot <= value);
        bends && below(least - spread) < below(largest + spread)
    }

    /// Whether the line that it depends on may be next to its other end within `step` of here.
    pub(super) fn is_near_cusp(&self, step: f64) -> bool {
        self.turning * step > TURN
    }
}

/// A part of a step between knots of a law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Passage {
    /// Its middle, s.
    pub(super) time: f64,
    /// How long it lasts, s.
    pub(super) duration: f64,
    /// How far the law is from the line between both ends of the step there, in its unit.
    pub(super) deviation: f64,
    /// Whether the step begins with it.
    pub(super) is_first: bool,
}

impl Passage {
    /// What the law deviates in all of it.
    pub(super) fn weight(&self) -> f64 {
        self.duration * self.deviation
    }
}

/// The cubic through two places, in 0 ≤ θ ≤ 1: s(θ) = Σ cₖ θᵏ.
#[derive(Debug, Clone, Copy)]
struct Course([f64; 4]);

impl Course {
    fn through([start, end]: [&Place; 2]) -> Self {
        let length = end.time - start.time;
        let (first, last) = (length * start.rate, length * end.rate);
        let change = end.value - start.value;
        Self([start.value, first, 3.0 * change - 2.0 * first - last, first + last - 2.0 * change])
    }

    fn at(&self, theta: f64) -> f64 {
        let [a, b, c, d] = self.0;
        a + theta * (b + theta * (c + theta * d))
    }

    /// ds/dθ.
    fn rate(&self, theta: f64) -> f64 {
        let [_, b, c, d] = self.0;
        b + theta * (2.0 * c + 3.0 * d * theta)
    }

    /// How far the change is from the one of mean rates: 0 on a parabola, and the more the less the ends say of
    /// what is between them.
    fn doubt(&self) -> f64 {
        0.5 * self.0[3].abs()
    }

    /// Ends of the pieces on which it rises or falls.
    fn pieces(&self) -> [f64; 4] {
        let [_, b, c, d] = self.0;
        // b + 2 c θ + 3 d θ² = 0, without cancellation
        let square = c * c - 3.0 * b * d;
        if square <= 0.0 {
            return [0.0, 0.0, 0.0, 1.0];
        }
        let root = square.sqrt();
        let sum = -(c + root.copysign(c));
        let inside = |x: f64| if x > 0.0 && x < 1.0 { x } else { 0.0 };
        let [x, y] = [b / sum, sum / (3.0 * d)].map(inside);
        [0.0, x.min(y), x.max(y), 1.0]
    }

    /// Smallest and largest value.
    fn range(&self) -> [f64; 2] {
        let values = self.pieces().map(|theta| self.at(theta));
        let least = values.into_iter().fold(f64::INFINITY, f64::min);
        [least, values.into_iter().fold(f64::NEG_INFINITY, f64::max)]
    }

    /// Whether it passes two knots or more, or may pass others than it seems to if it is wrong by `doubt`.
    fn is_doubtful(&self, knots: &[f64], doubt: f64) -> bool {
        let [least, largest] = self.range();
        let below = |value: f64| knots.partition_point(|&knot| knot <= value);
        if below(least - doubt) < below(least) || below(largest) < below(largest + doubt) {
            return true;
        }
        let mut passed = 0;
        self.marks(knots, |_, is_knot| passed += u32::from(is_knot));
        passed > 1
    }

    /// Tells the θ at which it passes one of the knots or turns back, in their order, and whether it is a knot.
    fn marks(&self, knots: &[f64], mut found: impl FnMut(f64, bool)) {
        let below = |theta: f64| knots.partition_point(|&knot| knot <= self.at(theta));
        for piece in self.pieces().windows(2) {
            let (from, to) = (piece[0], piece[1]);
            let (first, last) = (below(from), below(to));
            let passed = &knots[first.min(last)..first.max(last)];
            let rises = last > first;
            for k in 0..passed.len() {
                let knot = passed[if rises { k } else { passed.len() - 1 - k }];
                let (mut a, mut b) = (from, to);
                for _ in 0..HALVINGS {
                    let middle = 0.5 * (a + b);
                    if (self.at(middle) < knot) == rises { a = middle } else { b = middle }
                }
                found(0.5 * (a + b), true);
            }
            if from < to && to < 1.0 {
                found(to, false);
            }
        }
    }
}

/// What the way of an argument is looked at for.
pub(super) struct Looking<'a> {
    /// Knots of the law.
    pub(super) knots: &'a [f64],
    /// What courses of the argument may be wrong by.
    pub(super) negligible: f64,
    /// Whether the law bends beside its knots, too, so that what passes none is looked at as well.
    pub(super) bends: bool,
    /// The argument at a time inside the step.
    pub(super) inside: &'a mut dyn FnMut(f64) -> Result<Place, EvaluationFailure>,
}

/// The way of an argument through a step, with room for one.
#[derive(Debug, Clone, Default)]
pub(super) struct Way {
    /// Between each two of them the argument follows the cubic through them.
    places: Vec<Place>,
    /// Start of the step, times at which it passes a knot, turns back or is beside the other end of its line, end, s; empty
    /// where it only turns back.
    marks: Vec<f64>,
    passages: Vec<Passage>,
    /// Where the line is next to its other end.
    cusps: Vec<Passage>,
    /// Whether it passes a knot or the other end of its line.
    passes: bool,
    /// States that may still be asked for.
    left: usize,
}

impl Way {
    /// Room for laws with at most so many knots; for none at all without.
    pub(super) fn with_room(knots: Option<usize>) -> Self {
        let places = if knots.is_none() { 0 } else { STATES[0] + 3 };
        let knots = knots.unwrap_or(0);
        let marks = 3 * knots + places;
        Self {
            places: Vec::with_capacity(places),
            marks: Vec::with_capacity(marks),
            passages: Vec::with_capacity(2 * marks),
            cusps: Vec::with_capacity(places),
            passes: false,
            left: 0,
        }
    }

    /// Nothing is on the way.
    pub(super) fn clear(&mut self) {
        self.marks.clear();
        self.cusps.clear();
        self.passes = false;
    }

    /// Follows an argument through the start, the middle and the end of a step, and looks at more of its states where
    /// these do not say whether a knot is passed between them.
    ///
    /// # Errors
    /// Where a state inside the step is not found.
    pub(super) fn follow(
        &mut self,
        mut looking: Looking<'_>,
        places: [Place; 3],
    ) -> Result<(), EvaluationFailure> {
        self.places.clear();
        self.places.push(places[0]);
        self.left = STATES[usize::from(looking.knots.is_empty())];
        self.halves(&mut looking, places, 0)?;
        self.find_cusps();
        self.marks.clear();
        let Self { places, marks, cusps, .. } = self;
        let mut passes = !cusps.is_empty();
        let mut cusps = cusps.iter().map(|cusp| cusp.time).peekable();
        marks.push(places[0].time);
        for pair in places.windows(2) {
            let length = pair[1].time - pair[0].time;
            let course = Course::through([&pair[0], &pair[1]]);
            course.marks(looking.knots, |theta, is_knot| {
                marks.push(pair[0].time + theta * length);
                passes |= is_knot;
            });
            marks.extend(cusps.next_if(|&cusp| cusp <= pair[1].time));
        }
        marks.push(places[places.len() - 1].time);
        if !passes && !looking.bends {
            marks.clear();
        }
        self.passes = passes;
        Ok(())
    }

    /// Finds the moments at which a line turns by half a turn in less than the step: then it is next to its other end.
    ///
    /// Past the distance d at the speed u it turns at ω/(1 + ω²t²), ω = u/d, and so does what its force leaves out:
    /// for π/ω in the whole.
    fn find_cusps(&mut self) {
        let Self { places, cusps, .. } = self;
        cusps.clear();
        let step = places[places.len() - 1].time - places[0].time;
        cusps.extend(places.windows(3).filter_map(|three| {
            let [before, at, after] = [0, 1, 2].map(|k| three[k].turning);
            let duration = PI / at;
            (at > before && at >= after && duration < step).then_some(Passage {
                time: three[1].time,
                duration,
                deviation: 1.0,
                is_first: false,
            })
        }));
    }

    /// What [`Way::follow`] has found where a line is next to its other end: how long that lasts.
    pub(super) fn cusps(&self) -> &[Passage] {
        &self.cusps
    }

    /// How much later, s, the force of the line turns round for each metre that places are off, where [`Way::follow`] has found that it
    /// passes its other end; less where the force hardly does so for what it changes in the step.
    pub(super) fn delay_at_cusps(&self, system: &dyn System, argument: &LawArgument) -> f64 {
        let force = |place: &Place| system.law_profile(argument, place.value).abs();
        let delays = self.cusps.iter().map(|cusp| {
            let after = self.places.partition_point(|place| place.time <= cusp.time);
            let there = after.saturating_sub(1);
            let beside = [there.saturating_sub(1), after.min(self.places.len() - 1)];
            let speed = beside.map(|at| self.places[at].rate.abs()).into_iter().fold(0.0, f64::max);
            let ends = [&self.places[0], &self.places[self.places.len() - 1]];
            let most = ends.into_iter().map(force).sum::<f64>();
            let turned = 2.0 * force(&self.places[there]);
            if turned > 0.0 && speed > 0.0 { turned / turned.max(most) / speed } else { 0.0 }
        });
        delays.fold(0.0, f64::max)
    }

    /// Whether [`Way::follow`] has found a knot or such a place.
    pub(super) fn passes_knot(&self) -> bool {
        self.passes
    }

    /// Goes on over the middle of a part to its end, in smaller parts if need be.
    fn halves(
        &mut self,
        looking: &mut Looking<'_>,
        [start, middle, end]: [Place; 3],
        parts: u32,
    ) -> Result<(), EvaluationFailure> {
        let whole = Course::through([&start, &end]);
        let missed_rate = whole.rate(0.5) - middle.rate * (end.time - start.time);
        let missed = (whole.at(0.5) - middle.value).abs().max(0.25 * missed_rate.abs());
        for half in [[start, middle], [middle, end]] {
            let course = Course::through([&half[0], &half[1]]);
            let doubt = CAUTION * course.doubt().max(missed);
            let length = half[1].time - half[0].time;
            let turns = half.iter().any(|place| place.is_near_cusp(length));
            let doubtful =
                || doubt > looking.negligible && course.is_doubtful(looking.knots, doubt);
            let halve = (parts < PARTS_AT_CUSP && turns) || (parts < PARTS && doubtful());
            if halve && self.left > 0 {
                self.left -= 1;
                let middle = (looking.inside)(0.5 * (half[0].time + half[1].time))?;
                self.halves(looking, [half[0], middle, half[1]], parts + 1)?;
            } else {
                self.places.push(half[1]);
            }
        }
        Ok(())
    }

    /// The argument at a time, s.
    fn value(&self, time: f64) -> f64 {
        let after = self.places.partition_point(|place| place.time <= time);
        let after = after.clamp(1, self.places.len() - 1);
        let [start, end] = [&self.places[after - 1], &self.places[after]];
        Course::through([start, end]).at((time - start.time) / (end.time - start.time))
    }

    /// The parts between the marks of the step, halved where the law deviates to both sides of what both ends of the step let expect, the line between
    /// them; but for those in which it does not deviate.
    pub(super) fn passages(&mut self, system: &dyn System, argument: &LawArgument) -> &[Passage] {
        let mut passages = std::mem::take(&mut self.passages);
        passages.clear();
        if self.marks.is_empty() {
            self.passages = passages;
            return &self.passages;
        }
        let profile = |time: f64| system.law_profile(argument, self.value(time));
        let [from, to] = [self.places[0].time, self.places[self.places.len() - 1].time];
        let [start, end] = [from, to].map(profile);
        let deviation =
            |time: f64| profile(time) - (start + (time - from) / (to - from) * (end - start));
        for (k, between) in self.marks.windows(2).enumerate() {
            let duration = between[1] - between[0];
            let at = |part: f64| between[0] + part * duration;
            let mut add = |time: f64, duration: f64, is_first: bool| {
                let deviation = deviation(time).abs();
                let passage = Passage { time, duration, deviation, is_first };
                if passage.weight().is_normal() {
                    passages.push(passage);
                }
            };
            // Where the law deviates to both sides its middle may tell nothing.
            if deviation(at(0.25)) * deviation(at(0.75)) < 0.0 {
                add(at(0.25), 0.5 * duration, k == 0);
                add(at(0.75), 0.5 * duration, false);
            } else {
                add(at(0.5), duration, k == 0);
            }
        }
        self.passages = passages;
        &self.passages
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// θ at which the cubic through two places passes knots.
    fn crossings(length: f64, ends: [[f64; 2]; 2], knots: &[f64]) -> Vec<f64> {
        let [start, end] = [(0.0, ends[0]), (length, ends[1])].map(|(time, [value, rate])| Place {
            turning: 0.0,
            smooth: 0.0,
            time,
            value,
            rate,
        });
        let mut found = Vec::new();
        Course::through([&start, &end]).marks(knots, |theta, is_knot| {
            if is_knot {
                found.push(theta);
            }
        });
        found
    }

    #[test] // truth: θ at which polynomials have been given their values
    fn knots_are_passed_in_their_order() {
        let hill = [[0.0, 8.0], [0.0, -8.0]]; // 4 θ (1 − θ)
        let wave = [[0.0, 0.5], [0.0, 0.5]]; // θ (θ − 1/2) (θ − 1)
        for (length, ends, knots, truth) in [
            (0.5, hill, &[-0.1, 0.36, 0.64, 1.1][..], &[0.1, 0.2, 0.8, 0.9][..]),
            (0.5, [[0.0, 2.0], [1.0, 2.0]], &[0.25, 0.5], &[0.25, 0.5]),
            (0.5, [[1.0, -2.0], [0.0, -2.0]], &[0.25, 0.5], &[0.5, 0.75]),
            (0.5, [[1.0, 0.0], [1.0, 0.0]], &[0.25, 0.5, 1.0], &[]),
            (1.0, [[0.0, 1.0 + 1e-15], [1.0, 1.0]], &[0.25], &[0.25]),
            (1.0, wave, &[-0.024], &[0.6, 0.942_442_89]),
        ] {
            let found = crossings(length, ends, knots);
            assert_eq!(found.len(), truth.len(), "{found:?} {truth:?}");
            for (found, truth) in found.iter().zip(truth) {
                assert!((found - truth).abs() < 1e-7, "{found} {truth}");
            }
        }
        // θ + (θ − 1/2)³ rises all the way, though its curvature changes sign inside.
        assert_eq!(Course([-0.125, 1.75, -1.5, 1.0]).pieces(), [0.0, 0.0, 0.0, 1.0]);
    }

    #[test] // truth: |t − 1/3| passes 0.1 at 7/30 and 13/30, and the ends do not know
    fn what_ends_cannot_tell_is_looked_for_inside() {
        let place = |time: f64| Place {
            time,
            value: (time - 1.0 / 3.0).abs(),
            rate: (time - 1.0 / 3.0).signum(),
            turning: 0.0,
            smooth: 0.0,
        };
        let mut way = Way::with_room(Some(1));
        let mut asked = 0;
        let inside = &mut |time: f64| {
            asked += 1;
            Ok(place(time))
        };
        let looking = Looking { knots: &[0.1], negligible: 1e-6, bends: false, inside };
        way.follow(looking, [0.0, 0.5, 1.0].map(place)).unwrap();
        assert_eq!(way.marks.len(), 5);
        for (found, truth) in way.marks.iter().zip([0.0, 7.0, 10.0, 13.0, 30.0].map(|t| t / 30.0)) {
            assert!((found - truth).abs() < 0.02, "{found} {truth}");
        }
        assert!(asked > 0 && asked < 30, "{asked}");
        // Nothing is asked for where a parabola tells everything, or where nothing is near.
        let mut no = |_: f64| -> Result<Place, EvaluationFailure> { panic!("no need to ask") };
        let fall = |time: f64| {
            let place = LawPlace { value: -time * time, rate: -2.0 * time, ..LawPlace::default() };
            Place::at(time, place)
        };
        let looking = Looking { knots: &[-0.3], negligible: 1e-6, bends: false, inside: &mut no };
        way.follow(looking, [-1.0, 0.25, 1.5].map(fall)).unwrap();
        assert_eq!(way.marks.len(), 5);
        let looking = Looking { knots: &[-9.0], negligible: 1e-6, bends: false, inside: &mut no };
        way.follow(looking, [0.0, 0.5, 1.0].map(place)).unwrap();
        assert!(way.marks.is_empty());
    }
}
