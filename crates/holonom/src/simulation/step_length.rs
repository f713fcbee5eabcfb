//! How long a step may be, whatever its error.

use super::ledger::WAVES;
use crate::system::{Sizes, State, System};

/// Smallest number of steps of a run without unknowns.
pub(super) const KINEMATIC_STEPS: f64 = 200.0;
/// Largest rotation of a body in space in any step, rad: half of it is the angle of Euler parameters.
const LARGEST_TURN: f64 = 0.8;
/// Largest relative rotation in any step where only the branch of an angle is known, rad.
const UNTOLD_TURN: f64 = 2.0;
/// The same of joints in loops, which are closed at one turn as at another, while what turns unevenly shows in no error of a
/// step of some radians.
const TURN_IN_LOOP: f64 = 0.9;
/// Most halvings of a step that does not follow a driver.
const HALVINGS: u32 = 30;
/// Largest rotation of a body in a step of a run without unknowns, rad.
const KINEMATIC_TURN: f64 = 0.5;

/// Longest step from a state, s: no local feature of a force that lies ahead is jumped over. Turns are not limited
/// where bodies are placed along the forest (`tree`), but for angles whose turns it does not tell; in the other
/// charts no body in space turns by more than its Euler parameters can tell apart, so that not every other
/// step is refused where a rotor's tolerance is loose.
/// `h` is the step intended; every limit on turning is multiplied by `part`.
pub(super) fn longest(system: &dyn System, state: &State, tree: bool, h: f64, part: f64) -> f64 {
    let sizes = &system.structure().sizes;
    let turn = if tree {
        // No two bodies turn faster against each other.
        let all = 2.0 * turning(sizes, &state.v) * h;
        if all <= part * TURN_IN_LOOP { f64::INFINITY } else { untold(system, state) }
    } else if sizes.is_planar() {
        untold(system, state)
    } else {
        LARGEST_TURN / turning(sizes, &state.v)
    };
    system.longest_step(state).min(part * turn)
}

/// Time in which an angle of this rate, rad/s, that is told up to whole turns only turns by [`UNTOLD_TURN`].
pub(super) fn untold_at(rate: f64) -> f64 {
    UNTOLD_TURN / rate.abs()
}

/// Time in which two bodies whose relative angle is told by its branch alone turn by [`UNTOLD_TURN`], or by
/// [`TURN_IN_LOOP`] in loops.
fn untold(system: &dyn System, state: &State) -> f64 {
    let time = |pairs: &[[Option<usize>; 2]], turn: f64| {
        let times = pairs.iter().map(|&pair| turn / relative_rate(system, state, pair));
        times.fold(f64::INFINITY, f64::min)
    };
    let tree = system.tree();
    time(&tree.untold_turns, UNTOLD_TURN).min(time(&tree.turns_in_loops, TURN_IN_LOOP))
}

/// Angular velocity of the second body against the first one, rad/s; none is the ground.
fn relative_rate(system: &dyn System, state: &State, bodies: [Option<usize>; 2]) -> f64 {
    let [a, b] = bodies
        .map(|body| body.map_or([0.0; 3], |b| system.body(b, &state.q, &state.v).angular_velocity));
    (0..3).map(|k| (b[k] - a[k]).powi(2)).sum::<f64>().sqrt()
}

/// How far joints in loops turn in a step of `h` seconds between two states, and angles that nothing tells, by the rates at both, as
/// a part of what can be told.
pub(super) fn turned(system: &dyn System, states: [&State; 2], h: f64) -> f64 {
    let sizes = &system.structure().sizes;
    let all = h * states.map(|state| turning(sizes, &state.v)).iter().sum::<f64>();
    if all <= UNTOLD_TURN {
        return 0.0;
    }
    let turned = |&pair: &[Option<usize>; 2]| {
        let rates = states.map(|state| relative_rate(system, state, pair));
        0.5 * h * (rates[0] + rates[1])
    };
    let tree = system.tree();
    let pairs = tree.untold_turns.iter().chain(&tree.turns_in_loops);
    pairs.map(turned).fold(0.0, f64::max) / UNTOLD_TURN
}

/// Longest step of a run without unknowns over `span` seconds, s: no error limits it, but the energy
/// ledger is an integral, and bodies turn by [`KINEMATIC_TURN`] at most, as their rates and
/// accelerations foretell.
pub(super) fn kinematic(system: &dyn System, state: &State, span: f64) -> f64 {
    let sizes = &system.structure().sizes;
    let (rate, acceleration) = (turning(sizes, &state.v), turning(sizes, &state.a));
    (KINEMATIC_TURN / rate)
        .min((2.0 * KINEMATIC_TURN / acceleration).sqrt())
        .min(span / KINEMATIC_STEPS)
}

/// Longest step from `t` in a ramp of an applied force, s, a part of it: what is slow has no error that would tell a ramp,
/// however much its motion is in the end that of the ramp's impulse.
/// Equations: `docs/theory/simulation.md` (8e).
pub(super) fn ramped(ramps: &[[f64; 2]], t: f64, last: f64) -> f64 {
    const PARTS: f64 = 4.0;
    let inside = ramps.iter().filter(|[start, end]| *start <= t && t < *end);
    let part = inside.map(|[start, end]| (end - start) / PARTS).fold(f64::INFINITY, f64::min);
    // What is shorter than times can tell is a jump.
    if part < smallest_step(t, last) { f64::INFINITY } else { part }
}

/// A driver and the largest rate that it has in a run, as far as samples tell.
pub(super) struct Driven {
    pub(super) row: usize,
    rate: f64,
}

/// The drivers of a run from `start` to `end`.
pub(super) fn drivers(system: &dyn System, [start, end]: [f64; 2]) -> Vec<Driven> {
    const SAMPLES: u32 = 256;
    if !system.has_drivers() {
        return Vec::new();
    }
    // Multiples of the golden section, which no period meets, and what is between breakpoints, however short.
    let part = |k: u32| (0.618_033_988_749_894_9 * f64::from(k)).fract();
    let mut times: Vec<f64> = (1..=SAMPLES).map(|k| start + part(k) * (end - start)).collect();
    let inside = system.breakpoints().into_iter().filter(|t| *t > start && *t < end);
    let parts: Vec<f64> = std::iter::once(start).chain(inside).chain([end]).collect();
    times.extend(parts.windows(2).map(|two| 0.5 * (two[0] + two[1])));
    let all = system.structure().joints.iter().map(|joint| {
        let rate = |t: &f64| system.drive(joint.row, *t)[1].abs();
        Driven { row: joint.row, rate: times.iter().map(rate).fold(0.0, f64::max) }
    });
    all.filter(|driven| driven.rate > 0.0).collect()
}

/// Longest step of at most `h` from `t` that follows the drivers: no formula's error tells what is prescribed, but
/// energies are integrals of it. Where a rate r changes like a wave of ω² = |r̈|/|r|, Simpson's rule misses (2hω)⁴/2880 of
/// a power of twice its frequency: ten tolerances at most.
pub(super) fn driven(
    system: &dyn System,
    drivers: &[Driven],
    t: f64,
    h: f64,
    relative: f64,
) -> f64 {
    const MOMENTS: [f64; 4] = [0.0, 0.155_051_025_721_682_2, 0.644_948_974_278_317_8, 1.0];
    let most = 0.5 * (WAVES * 2880.0 * relative).powf(0.25);
    let mut longest = h;
    for Driven { row, rate } in drivers {
        let mut rate = *rate;
        for _ in 0..HALVINGS {
            let mut bend = 0.0f64;
            for x in MOMENTS {
                let [_, first, _, third] = system.drive(*row, t + x * longest);
                (rate, bend) = (rate.max(first.abs()), bend.max(third.abs()));
            }
            let ratio = longest * (bend / rate).sqrt() / most;
            if ratio <= 1.0 {
                break;
            }
            longest *= (0.99 / ratio).max(0.5);
        }
    }
    longest
}

/// Largest rotation among the bodies of a change of the coordinates, rad.
fn turning(sizes: &Sizes, x: &[f64]) -> f64 {
    let turns = sizes.by_body(x).map(|[_, p]| p.iter().map(|x| x * x).sum::<f64>().sqrt());
    sizes.angle_factor() * turns.fold(0.0, f64::max)
}

/// The step rounded to the resolution of times near `end`, s, so that equal steps stay equal; unrounded where that changes it by more
/// than a thousandth.
pub(super) fn representable(step: f64, t: f64, end: f64) -> f64 {
    const SAME: f64 = 1e-3;
    let far = t.abs().max(end.abs());
    let told = (far + step) - far;
    if (told - step).abs() <= SAME * step { told } else { step }
}

/// Smallest step worth trying.
pub(super) fn smallest_step(t: f64, end: f64) -> f64 {
    10.0 * f64::EPSILON * t.abs().max((end - t).abs() * 1e-3).max(1e-3)
}

/// Fits a step to the next time that must be hit: reaches it, or leaves room for two equal steps.
pub(super) fn clip(t: f64, h: f64, next: f64, fixed: bool) -> (f64, bool) {
    if t + 1.01 * h >= next {
        return (next - t, true);
    }
    if !fixed && t + 2.0 * h > next {
        return (0.5 * (next - t), false);
    }
    (h, false)
}
