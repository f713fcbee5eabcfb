//! Blocks and energies of forces. Independent truth: Richardson-extrapolated differences of `evaluate` under finite
//! rotations, dual numbers through `evaluate`, and differences of the potential along a motion. Rates of the
//! arguments of laws: differences along it.

use num_dual::Dual64;

use super::constraints::pair_of;
use super::*;
use crate::elements::body::Rigid;
use crate::elements::space::{Planar, Spatial};
use crate::elements::{
    Energy, ExtraRows, ForceBlocks, ForceElement, ForceInput, LawPlace, MOST_ARGUMENTS, planar,
    product as pair_product, spatial,
};
use crate::math::spatial::rotate;
use crate::math::turn::exponential;
use crate::math::{MonotoneCubic, Real, TimeFunction};
use crate::model::{
    BodyIndex, Branch, ElasticLaw, Force, ForceAxes, ForceKind, LateralTyre, Road, Tyre,
};
use crate::testing::random_states;

/// Room for the extra states of every kind.
pub(super) type States<T> = [T; 12];

/// Where a force is evaluated: poses and twists.
#[derive(Debug, Clone, Copy)]
pub(super) struct At<T, const N: usize, const W: usize> {
    pub(super) t: T,
    pub(super) q: Pair<T, N>,
    pub(super) y: Pair<T, W>,
    pub(super) z: States<T>,
    pub(super) winding: f64,
}

/// Displacements of poses.
pub(super) trait Displaced<const D: usize, const N: usize, const W: usize>:
    Rigid<D, N, W>
{
    /// A pose after the translation and the rotation of a displacement that turns about one axis, or is small.
    fn displaced<T: Real>(q: &[T; N], by: &[T; W]) -> [T; N];

    /// A pose that has moved with a steady twist for a time.
    fn advanced(q: &[f64; N], y: &[f64; W], s: f64) -> [f64; N];
}

impl Displaced<2, 3, 3> for Planar {
    fn displaced<T: Real>(q: &[T; 3], by: &[T; 3]) -> [T; 3] {
        std::array::from_fn(|k| q[k] + by[k])
    }

    fn advanced(q: &[f64; 3], y: &[f64; 3], s: f64) -> [f64; 3] {
        std::array::from_fn(|k| q[k] + s * y[k])
    }
}

impl Displaced<3, 7, 6> for Spatial {
    fn displaced<T: Real>(q: &[T; 7], by: &[T; 6]) -> [T; 7] {
        let mut p = [q[3], q[4], q[5], q[6]];
        for k in 0..3 {
            let (sin, cos) = (by[3 + k] * 0.5).sine_cosine();
            let mut turn = [cos, T::zero(), T::zero(), T::zero()];
            turn[1 + k] = sin;
            p = product(&turn, &p);
        }
        [q[0] + by[0], q[1] + by[1], q[2] + by[2], p[0], p[1], p[2], p[3]]
    }

    fn advanced(q: &[f64; 7], y: &[f64; 6], s: f64) -> [f64; 7] {
        let p = product(&exponential(&[s * y[3], s * y[4], s * y[5]]), &[q[3], q[4], q[5], q[6]]);
        [q[0] + s * y[0], q[1] + s * y[1], q[2] + s * y[2], p[0], p[1], p[2], p[3]]
    }
}

impl<T: Real, const N: usize, const W: usize> At<T, N, W> {
    pub(super) fn input<S: Rigid<D, N, W>, const D: usize>(&self) -> ForceInput<'_, T, D, N, W> {
        let bodies = [0, 1].map(|side| {
            let mut body = S::body(&self.q[side], &[T::zero(); N]);
            body.twist = self.y[side];
            body
        });
        ForceInput { t: self.t, bodies, z: &self.z, winding: self.winding }
    }

    pub(super) fn displaced<S: Displaced<D, N, W>, const D: usize>(&self, by: &Pair<T, W>) -> Self {
        Self { q: std::array::from_fn(|side| S::displaced(&self.q[side], &by[side])), ..*self }
    }
}

impl<const N: usize, const W: usize> At<f64, N, W> {
    fn lifted(&self) -> At<Dual64, N, W> {
        let (q, y) = (lifted(&self.q), lifted(&self.y));
        At { t: self.t.into(), q, y, z: self.z.map(Dual64::from), winding: self.winding }
    }

    /// Where a steady motion has led after time s.
    fn after<S: Displaced<D, N, W>, const D: usize>(&self, s: f64, z_rate: &[f64]) -> Self {
        let mut there = *self;
        there.t += s;
        there.z.iter_mut().zip(z_rate).for_each(|(z, rate)| *z += s * rate);
        for side in 0..2 {
            there.q[side] = S::advanced(&self.q[side], &self.y[side], s);
        }
        there
    }
}

/// Wrenches and ż in one column.
fn force<S: Rigid<D, N, W>, T: Real, const D: usize, const N: usize, const W: usize>(
    e: &impl ForceElement<D, N, W>,
    at: &At<T, N, W>,
) -> Vec<T> {
    let (mut wrenches, mut z_rate) = ([[T::zero(); W]; 2], vec![T::zero(); e.extra_states()]);
    e.evaluate(&at.input::<S, D>(), &mut wrenches, &mut z_rate);
    [wrenches[0].as_slice(), &wrenches[1], &z_rate].concat()
}

/// `block` with opposite sign and the rows of ż below.
fn columns<const W: usize>(block: Vec<Vec<f64>>, rates: &[Pair<f64, W>]) -> Vec<Vec<f64>> {
    let mut rows: Vec<Vec<f64>> =
        block.into_iter().map(|row| row.into_iter().map(|x| -x).collect()).collect();
    rows.extend(rates.iter().map(|rate| rate.as_flattened().to_vec()));
    rows
}

fn check<S: Displaced<D, N, W>, const D: usize, const N: usize, const W: usize>(
    name: &str,
    e: &impl ForceElement<D, N, W>,
    at: &At<f64, N, W>,
    length: f64,
) {
    let mut b = ForceBlocks::zero();
    e.blocks(&at.input::<S, D>(), &mut b);
    let states = e.extra_states();
    let [mut by_z, mut rate_x, mut rate_y] = [0; 3].map(|_| vec![[[f64::NAN; W]; 2]; states]);
    let (mut own, mut time) = (vec![f64::NAN; states * states], vec![f64::NAN; states]);
    let mut rows = ExtraRows {
        force: &mut by_z,
        by_displacement: &mut rate_x,
        by_twist: &mut rate_y,
        own: &mut own,
        time: &mut time,
    };
    e.extra_rows(&at.input::<S, D>(), &mut rows);
    let wide = at.lifted();
    assert_eq!(b.wrenches.concat(), force::<S, _, D, N, W>(e, at)[..2 * W], "{name}");

    check_block(
        &format!("{name}, by displacement"),
        &[[0.0; W]; 2],
        1e-4 * length,
        columns(pair_of(&b.k), &rate_x),
        |by| force::<S, _, D, N, W>(e, &at.displaced::<S, D>(by)),
        |by| force::<S, _, D, N, W>(e, &wide.displaced::<S, D>(by)),
    );
    check_block(
        &format!("{name}, by twist"),
        &at.y,
        1e-4,
        columns(pair_of(&b.c), &rate_y),
        |y| force::<S, _, D, N, W>(e, &At { y: *y, ..*at }),
        |y| force::<S, _, D, N, W>(e, &At { y: *y, ..wide }),
    );
    let moves = b.c.entries().iter().any(|x| *x != 0.0);
    assert!(b.damped || !moves, "{name}");
    // t and z as the first two columns of a pair whose other entries do nothing
    let single = |row: &Pair<f64, W>, rates: &[f64]| -> Vec<Vec<f64>> {
        let forces = row.as_flattened().iter().map(|x| vec![-x]);
        forces.chain(rates.iter().map(|rate| vec![*rate])).collect()
    };
    let at_force = |at: &At<f64, N, W>| force::<S, _, D, N, W>(e, at);
    let size = at_force(at).iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let parts = |at: &At<Dual64, N, W>| {
        force::<S, _, D, N, W>(e, at).iter().map(|x| x.eps).collect::<Vec<_>>()
    };
    let name_t = format!("{name}, by time");
    let checked = Checked { name: &name_t, analytic: single(&b.t, &time), size };
    checked.against(0, &richardson(1e-4, |s| at_force(&At { t: at.t + s, ..*at })), 1e-7);
    checked.against(0, &parts(&At { t: Dual64::new(at.t, 1.0), ..wide }), 1e-12);
    for k in 0..states {
        let name = format!("{name}, by extra state {k}");
        let own: Vec<f64> = own[k..].iter().step_by(states).copied().collect();
        let checked = Checked { name: &name, analytic: single(&by_z[k], &own), size };
        let moved = |s: f64| {
            let mut there = *at;
            there.z[k] += s;
            at_force(&there)
        };
        checked.against(0, &richardson(1e-4 * length, moved), 1e-7);
        let mut along = wide;
        along.z[k] = Dual64::new(at.z[k], 1.0);
        checked.against(0, &parts(&along), 1e-12);
    }

    // power = −d(potential)/dt − dissipated + supplied, along a motion with steady twists, z + s ż
    let out = at_force(at);
    let wrenches: Pair<f64, W> =
        std::array::from_fn(|side| std::array::from_fn(|k| out[side * W + k]));
    let power = pair_product(&wrenches, refs(&at.y));
    let h = 1e-4 * length;
    let after = |s: f64| at.after::<S, D>(s, &out[2 * W..]);
    let potential_rate = richardson(h, |s| vec![e.energy(&after(s).input::<S, D>()).potential])[0];
    let Energy { potential, dissipated, supplied } = e.energy(&at.input::<S, D>());
    let balance = power + potential_rate + dissipated - supplied;
    let size = power.abs().max(potential_rate.abs()).max(dissipated.abs()).max(supplied.abs());
    // what rounding of potential and position makes of a difference over h
    let largest = out.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let noise = (1e-14 * potential.abs() + 1e-15 * largest) / h;
    assert!(balance.abs() <= 1e-7 * size + noise, "{name}: energy {balance:e} of {size:e}");

    // Rates of velocities take accelerations.
    let count = e.knots().len();
    let places = |at: &ForceInput<f64, D, N, W>| {
        let mut out = [LawPlace::default(); MOST_ARGUMENTS];
        e.arguments(at, &mut out[..count]);
        out
    };
    let here = places(&at.input::<S, D>());
    for (index, LawPlace { value, rate, .. }) in
        here[..count - e.velocities()].iter().copied().enumerate()
    {
        let found = richardson(h, |s| vec![places(&after(s).input::<S, D>())[index].value])[0];
        let noise = 1e-14 * value.abs().max(1.0) / h;
        let error = (rate - found).abs();
        assert!(
            error <= 1e-7 * rate.abs() + noise,
            "{name}: argument {index}, rate off by {error:e}"
        );
    }
}

fn table() -> ElasticLaw {
    let x = vec![-0.9, -0.3, -0.1, 0.0, 0.15, 0.4, 1.1];
    let y = vec![-9000.0, -1500.0, -200.0, 0.0, 300.0, 2500.0, 9500.0];
    ElasticLaw::Table(Box::new(MonotoneCubic::new(x, y).unwrap()))
}

/// Whether a deformation is away from the knots of `table`, where the slope has a kink.
fn away_from_knots(x: f64) -> bool {
    [-0.9, -0.3, -0.1, 0.0, 0.15, 0.4, 1.1].iter().all(|knot: &f64| (knot - x).abs() > 2e-3)
}

fn functions(random: &mut Random) -> [TimeFunction; 3] {
    [0, 1, 2].map(|k| match k {
        0 => TimeFunction::Constant(random.range(-50.0, 50.0)),
        1 => TimeFunction::Harmonic {
            amplitude: random.range(10.0, 50.0),
            angular_frequency: 3.0,
            phase: 0.3,
            offset: 5.0,
        },
        _ => TimeFunction::Polynomial { coefficients: vec![3.0, -20.0, 8.0, 5.0], start: 0.1 },
    })
}

/// A positive definite matrix with coupling of translation and rotation.
pub(super) fn coupled_matrix(random: &mut Random, size: f64) -> [[f64; 6]; 6] {
    let rows: [[f64; 6]; 6] = std::array::from_fn(|_| random.array(1.0));
    std::array::from_fn(|i| {
        std::array::from_fn(|j| size * (0..6).map(|k| rows[i][k] * rows[j][k]).sum::<f64>())
    })
}

fn tyre(random: &mut Random, road: Road, lateral: bool) -> Tyre {
    let lateral = lateral.then(|| LateralTyre {
        cornering_stiffness: 50000.0,
        regularization_speed: 0.5,
        axis: random.unit(),
    });
    Tyre {
        frame: random_frame(random, 0.5),
        radius: 0.4699,
        stiffness: 296325.0,
        damping: 3502.0,
        smoothing: 1e-3,
        road,
        lateral,
    }
}

pub(super) fn named(kind: ForceKind) -> Force {
    Force { name: "force".into(), kind }
}

/// Every kind between two bodies, for two frames.
pub(super) fn internal_kinds(random: &mut Random, frames: [Frame; 2]) -> Vec<ForceKind> {
    let (damping, free_length) = (40.0, 0.6);
    let linear = ElasticLaw::Linear(2000.0);
    vec![
        ForceKind::Tsda { frames, law: linear.clone(), damping, free_length },
        ForceKind::Tsda { frames, law: table(), damping, free_length },
        ForceKind::Tsda { frames, law: linear.clone(), damping: 0.0, free_length: 0.0 },
        ForceKind::Maxwell { frames, stiffness: 3000.0, damping: 200.0, free_length },
        ForceKind::Rsda { frames, law: linear, damping, free_angle: 0.4 },
        ForceKind::Rsda { frames, law: table(), damping: 0.0, free_angle: 0.4 },
        ForceKind::Bushing {
            frames,
            stiffness: Box::new(coupled_matrix(random, 4000.0)),
            damping: Box::new(coupled_matrix(random, 60.0)),
            branches: Vec::new(),
        },
        ForceKind::Bushing {
            frames,
            stiffness: Box::new(coupled_matrix(random, 4000.0)),
            damping: Box::new([[0.0; 6]; 6]),
            branches: branches(random),
        },
    ]
}

/// A branch in all directions, coupled, and one in three of them.
pub(super) fn branches(random: &mut Random) -> Vec<Branch> {
    let name = String::from;
    let full = Branch {
        name: name("full"),
        stiffness: coupled_matrix(random, 3000.0),
        damping: definite_matrix(random, 50.0),
    };
    let diagonal = |values: [f64; 6]| {
        std::array::from_fn(|i| std::array::from_fn(|j| if i == j { values[i] } else { 0.0 }))
    };
    let few = Branch {
        name: name("few"),
        stiffness: diagonal([2000.0, 0.0, 900.0, 0.0, 0.0, 700.0]),
        damping: diagonal([30.0, 0.0, 500.0, 0.0, 0.0, 9.0]),
    };
    vec![full, few]
}

/// The same, far from singular.
fn definite_matrix(random: &mut Random, size: f64) -> [[f64; 6]; 6] {
    let mut out = coupled_matrix(random, size);
    (0..6).for_each(|k| out[k][k] += size);
    out
}

/// Kinds whose second body carries an outer load, and torques with their reaction.
fn applied_kinds(random: &mut Random, frame: Frame) -> Vec<ForceKind> {
    let mut kinds = Vec::new();
    for axes in [ForceAxes::Ground, ForceAxes::Body] {
        kinds.push(ForceKind::PointForce { frame, force: functions(random), axes });
        let (body, reaction): (BodyIndex, BodyIndex) = (Some(0), Some(1));
        kinds.push(ForceKind::Torque { body, reaction, torque: functions(random), axes });
    }
    kinds
}

/// Deformation of a tabulated element, 0.05 (away from knots) for the others.
fn table_deformation<const D: usize, const N: usize, const W: usize>(
    kind: &ForceKind,
    e: &impl ForceElement<D, N, W>,
    input: &ForceInput<f64, D, N, W>,
) -> f64 {
    let mut measure = [0.0];
    match kind {
        ForceKind::Tsda { law: ElasticLaw::Table(_), free_length, .. } => {
            e.quantity(0, input, &mut measure);
            measure[0] - free_length
        }
        ForceKind::Rsda { law: ElasticLaw::Table(_), free_angle, .. } => {
            e.quantity(0, input, &mut measure);
            measure[0] - free_angle
        }
        _ => 0.05,
    }
}

fn name_of(kind: &ForceKind) -> String {
    format!("{kind:?}").chars().take(60).collect()
}

pub(super) fn spatial_state(
    random: &mut Random,
    kind: &ForceKind,
    frames: &[Frame; 2],
) -> At<f64, 7, 6> {
    let relative = match kind {
        ForceKind::Rsda { .. } => axial_turn(random),
        _ => any_turn(random),
    };
    let q = poses(random, frames, &relative);
    let (y, t, z) = (random_pair(random, 2.0), random.range(0.0, 2.0), random.array(0.5));
    At { t, q, y, z, winding: random.range(-20.0, 20.0) }
}

/// Whether the winding is so near to half a turn from the angle that a difference may cross it.
fn near_branch_change(e: &spatial::Force, input: &ForceInput<f64, 3, 7, 6>) -> bool {
    let [first, second] = &input.bodies;
    let winding = input.winding;
    e.counts_turns() && (e.angle([first, second], winding) - winding).abs() > 3.1
}

#[test]
fn blocks_and_energies_of_spatial_forces_hold() {
    let kinds = {
        let mut random = Random::new(1);
        let frames = [0, 1].map(|_| random_frame(&mut random, 0.8));
        let applied = applied_kinds(&mut random, frames[0]).len();
        internal_kinds(&mut random, frames).len() + applied
    };
    for index in 0..kinds {
        let mut random = Random::new(500 + index as u64);
        let mut done = 0;
        while done < random_states() {
            let frames = [0, 1].map(|_| random_frame(&mut random, 0.8));
            let centers = [random.array(0.3), random.array(0.3)];
            let mut all = internal_kinds(&mut random, frames);
            all.extend(applied_kinds(&mut random, frames[0]));
            let kind = all.swap_remove(index);
            let e = spatial::Force::new(&named(kind.clone()), centers);
            let at = spatial_state(&mut random, &kind, &frames);
            let input = at.input::<Spatial, 3>();
            let smooth = away_from_knots(table_deformation(&kind, &e, &input));
            if !smooth || near_branch_change(&e, &input) {
                continue;
            }
            check::<Spatial, 3, 7, 6>(&name_of(&kind), &e, &at, smallest_length(&frames));
            done += 1;
        }
    }
}

#[test]
fn blocks_and_energies_of_planar_forces_hold() {
    let kinds = |random: &mut Random| {
        let frames = [0, 1].map(|_| planar_frame(random, 0.8));
        let mut all = internal_kinds(random, frames);
        all.retain(|kind| !matches!(kind, ForceKind::Bushing { .. }));
        all.extend(applied_kinds(random, frames[0]));
        (all, frames)
    };
    for index in 0..kinds(&mut Random::new(1)).0.len() {
        let mut random = Random::new(600 + index as u64);
        let mut done = 0;
        while done < random_states() {
            let (mut all, frames) = kinds(&mut random);
            let kind = all.swap_remove(index);
            let e = planar::Force::new(&named(kind.clone()), [[0.1, -0.2, 0.0]; 2]);
            let q = planar_poses(&mut random);
            let (y, t) = (random_pair(&mut random, 2.0), random.range(0.0, 2.0));
            let at = At { t, q, y, z: random.array(0.5), winding: 0.0 };
            if !away_from_knots(table_deformation(&kind, &e, &at.input::<Planar, 2>())) {
                continue;
            }
            let name = format!("planar {}", name_of(&kind));
            check::<Planar, 2, 3, 3>(&name, &e, &at, smallest_length(&frames));
            done += 1;
        }
    }
}

#[test]
fn blocks_and_energies_of_tyres_hold() {
    let roads = [
        Road::Flat { height: 0.1 },
        Road::SmoothBump { height: 0.05, half_length: 0.35, center: 0.1 },
        Road::HalfCylinder { radius: 0.05, center: 0.1 },
    ];
    for (index, road) in roads.into_iter().enumerate() {
        for lateral in [false, true] {
            let mut random = Random::new(700 + 2 * index as u64 + u64::from(lateral));
            let mut done = 0;
            while done < random_states() {
                let tyre = tyre(&mut random, road, lateral);
                let (frame, law) = (tyre.frame, tyre.lateral);
                let e = spatial::Force::new(
                    &named(ForceKind::Tyre(tyre)),
                    [[0.0; 3], [0.1, -0.05, 0.02]],
                );
                let relative = any_turn(&mut random);
                let q = poses(&mut random, &[frame, frame], &relative);
                let y = random_pair(&mut random, 4.0);
                let mut at = At { t: 0.0, q, y, z: [0.0; 12], winding: 0.0 };
                // bring the wheel centre near the road, where the onset of contact is smoothed too
                let mut deflection = [0.0];
                e.quantity(0, &at.input::<Spatial, 3>(), &mut deflection);
                let wanted = match done % 3 {
                    0 => random.range(-3e-3, 3e-3),
                    _ => random.range(-0.05, 0.1),
                };
                at.q[1][2] += deflection[0] - wanted;
                // x of the wheel centre: kinks of the profiles are the knots to be avoided
                let point: [f64; 3] =
                    std::array::from_fn(|k| frame.point[k] - [0.1, -0.05, 0.02][k]);
                let p = [at.q[1][3], at.q[1][4], at.q[1][5], at.q[1][6]];
                let x = at.q[1][0] + rotate(&p, &point)[0] - 0.1;
                let edge = (0.5199_f64.powi(2) - 0.4699_f64.powi(2)).sqrt();
                let kinked = [0.35, edge].iter().any(|k| (x.abs() - k).abs() < 1e-4);
                // a wheel axis near the vertical has no heading
                let flat = law.is_some_and(|l| rotate(&p, &l.axis)[2].abs() > 0.9);
                if kinked || flat {
                    continue;
                }
                let name = format!("tyre on {road:?}, lateral {lateral}");
                check::<Spatial, 3, 7, 6>(&name, &e, &at, 1e-3);
                done += 1;
            }
        }
    }
}
