//! Laws of mechanics that hold for every element between two bodies, and for the bushing.

use super::constraints::{DRIVERS, PLANAR_JOINTS, SPATIAL_JOINTS, driver, joint, reaction};
use super::forces::{At, coupled_matrix, internal_kinds, named, spatial_state};
use super::*;
use crate::elements::body::Rigid;
use crate::elements::space::{Planar, Spatial};
use crate::elements::{ConstraintElement, ForceElement, ForceInput, planar as plane, spatial};
use crate::math::TimeFunction;
use crate::math::spatial::{cross, e_times, rotate, rotate_back};
use crate::model::{ForceAxes, ForceKind, JointKind};

fn wrenches<const D: usize, const N: usize, const W: usize>(
    e: &impl ForceElement<D, N, W>,
    input: &ForceInput<f64, D, N, W>,
) -> Pair<f64, W> {
    let mut out = [[0.0; W]; 2];
    e.evaluate(input, &mut out, &mut vec![0.0; e.extra_states()]);
    out
}

fn euler(q: &[f64; 7]) -> [f64; 4] {
    [q[3], q[4], q[5], q[6]]
}

/// Force and moment about the centre of mass, ground axes, of a generalized force on one body.
fn wrench(q: &[f64; 7], force: &[f64]) -> ([f64; 3], [f64; 3]) {
    let on_p = [force[3], force[4], force[5], force[6]];
    let moment = e_times(&euler(q), &on_p).map(|x| 0.5 * x);
    ([force[0], force[1], force[2]], moment)
}

/// Those on both bodies.
fn of_pair(q: &Pair<f64, 7>, force: &[f64]) -> [([f64; 3], [f64; 3]); 2] {
    [0, 1].map(|side| wrench(&q[side], &force[7 * side..7 * side + 7]))
}

fn parts(w: &[f64; 6]) -> ([f64; 3], [f64; 3]) {
    ([w[0], w[1], w[2]], [w[3], w[4], w[5]])
}

/// Net force and net moment about the ground origin vanish (d'Alembert: only moving or turning
/// both bodies together, which does no internal work).
fn assert_internal(name: &str, q: &Pair<f64, 7>, wrenches: [([f64; 3], [f64; 3]); 2]) {
    let mut net = [0.0; 6];
    let mut size = 1e-9_f64;
    for (side, (f, n)) in wrenches.into_iter().enumerate() {
        let arm = cross(&[q[side][0], q[side][1], q[side][2]], &f);
        for k in 0..3 {
            net[k] += f[k];
            net[3 + k] += n[k] + arm[k];
            size = size.max(f[k].abs()).max(n[k].abs()).max(arm[k].abs());
        }
    }
    assert!(net.iter().all(|x| x.abs() < 1e-13 * size), "{name}: net {net:?} of {size:e}");
}

fn assert_internal_plane(name: &str, q: &Pair<f64, 3>, force: &[f64]) {
    let (mut net, mut size) = ([0.0; 3], 1e-9_f64);
    for side in 0..2 {
        let [x, y, _] = q[side];
        let f = &force[3 * side..3 * side + 3];
        let terms = [f[0], f[1], f[2] + x * f[1] - y * f[0]];
        for k in 0..3 {
            net[k] += terms[k];
            size = size.max(terms[k].abs());
        }
    }
    assert!(net.iter().all(|x| x.abs() < 1e-13 * size), "{name}: net {net:?} of {size:e}");
}

/// Moves the second body so that its point stands off the first's by `offset` (ground axes).
fn bring_together(
    q: &mut Pair<f64, 7>,
    frames: &[Frame; 2],
    centers: &[[f64; 3]; 2],
    offset: &[f64; 3],
) {
    let [si, sj]: [[f64; 3]; 2] = std::array::from_fn(|side| {
        let s = std::array::from_fn(|k| frames[side].point[k] - centers[side][k]);
        rotate(&euler(&q[side]), &s)
    });
    for k in 0..3 {
        q[1][k] = q[0][k] + si[k] + offset[k] - sj[k];
    }
}

#[test] // independent truth: action and reaction
fn joints_and_drivers_act_and_react_equally() {
    let mut random = Random::new(1000);
    for _ in 0..20 {
        let c: [f64; 6] = random.array(2.0);
        let frames = [0, 1].map(|_| random_frame(&mut random, 0.8));
        let centers = [random.array(0.3), random.array(0.3)];
        let relative = axial_turn(&mut random);
        let q = poses(&mut random, &frames, &relative);
        // the force of coinciding points acts at one place only once they coincide
        let mut met = q;
        bring_together(&mut met, &frames, &centers, &[0.0; 3]);
        for kind in SPATIAL_JOINTS {
            let e = spatial::Constraint::joint(&joint(kind, frames), centers);
            let points_meet = !matches!(
                kind,
                JointKind::Translational | JointKind::Cylindrical | JointKind::Distance { .. }
            );
            let q = if points_meet { met } else { q };
            assert_internal(&format!("{kind:?}"), &q, of_pair(&q, &reaction(&e, &q, &c)));
        }
        for kind in DRIVERS {
            let e = spatial::Constraint::driver(&driver(kind, frames), centers);
            assert_internal(&format!("{kind:?}"), &q, of_pair(&q, &reaction(&e, &q, &c)));
        }
        let frames = [0, 1].map(|_| planar_frame(&mut random, 0.8));
        let q = planar_poses(&mut random);
        let centers = [[0.1, 0.2, 0.0]; 2];
        let mut met = q;
        let pin = plane::Constraint::joint(&joint(JointKind::Revolute, frames), centers);
        let mut gap = [0.0; 6];
        pin.value(refs(&q), &mut gap);
        (0..2).for_each(|k| met[1][k] -= gap[k]);
        for kind in PLANAR_JOINTS {
            let e = plane::Constraint::joint(&joint(kind, frames), centers);
            let points_meet = matches!(kind, JointKind::Fixed | JointKind::Revolute);
            let q = if points_meet { met } else { q };
            assert_internal_plane(&format!("{kind:?}"), &q, &reaction(&e, &q, &c));
        }
        for kind in DRIVERS {
            let e = plane::Constraint::driver(&driver(kind, frames), centers);
            assert_internal_plane(&format!("{kind:?}"), &q, &reaction(&e, &q, &c));
        }
    }
}

#[test] // independent truth: action and reaction
fn internal_forces_act_and_react_equally() {
    let mut random = Random::new(1100);
    for _ in 0..20 {
        let frames = [0, 1].map(|_| random_frame(&mut random, 0.8));
        let mut kinds = internal_kinds(&mut random, frames);
        for axes in [ForceAxes::Ground, ForceAxes::Body] {
            let torque = [3.0, -2.0, 5.0].map(TimeFunction::Constant);
            kinds.push(ForceKind::Torque { body: Some(0), reaction: Some(1), torque, axes });
        }
        for kind in kinds {
            let e = spatial::Force::new(&named(kind.clone()), [[0.1, 0.2, -0.1]; 2]);
            let at = spatial_state(&mut random, &kind, &frames);
            let out = wrenches(&e, &at.input::<Spatial, 3>());
            assert_internal(&format!("{kind:?}"), &at.q, out.map(|w| parts(&w)));
        }
        let frames = [0, 1].map(|_| planar_frame(&mut random, 0.8));
        for kind in internal_kinds(&mut random, frames) {
            if matches!(kind, ForceKind::Bushing { .. }) {
                continue;
            }
            let e = plane::Force::new(&named(kind.clone()), [[0.1, 0.2, 0.0]; 2]);
            let (q, y) = (planar_poses(&mut random), random_pair(&mut random, 1.0));
            let at = At { t: 0.3, q, y, z: [0.2; 12], winding: 0.0 };
            let out = wrenches(&e, &at.input::<Planar, 2>());
            assert_internal_plane(&format!("{kind:?}"), &at.q, &out.concat());
        }
    }
}

#[test] // independent truth: virtual work of a torque vector, n · ω
fn torques_and_following_forces_do_their_work() {
    let mut random = Random::new(1150);
    for _ in 0..20 {
        let frame = random_frame(&mut random, 0.5);
        let at = spatial_state(
            &mut random,
            &ForceKind::Torque {
                body: Some(0),
                reaction: None,
                torque: [0.0; 3].map(TimeFunction::Constant),
                axes: ForceAxes::Ground,
            },
            &[frame, frame],
        );
        let spin = at.y.map(|y| parts(&y).1);
        let given: [f64; 3] = random.array(10.0);
        for axes in [ForceAxes::Ground, ForceAxes::Body] {
            let p = euler(&at.q[1]);
            let ground = if axes == ForceAxes::Ground { given } else { rotate(&p, &given) };
            let work = |e: &spatial::Force| {
                let input = at.input::<Spatial, 3>();
                let out = wrenches(e, &input);
                let mut channel = [0.0; 3];
                e.quantity(0, &input, &mut channel);
                for k in 0..3 {
                    assert!((channel[k] - ground[k]).abs() < 1e-13, "channel in ground axes");
                }
                (0..2)
                    .flat_map(|s| (0..6).map(move |k| (s, k)))
                    .fold(0.0, |sum, (s, k)| sum + out[s][k] * at.y[s][k])
            };
            let components = given.map(TimeFunction::Constant);
            let torque = spatial::Force::new(
                &named(ForceKind::Torque {
                    body: Some(0),
                    reaction: Some(1),
                    torque: components.clone(),
                    axes,
                }),
                [[0.0; 3]; 2],
            );
            let expected: f64 = (0..3).map(|k| ground[k] * (spin[1][k] - spin[0][k])).sum();
            assert!((work(&torque) - expected).abs() < 1e-12);

            let center = [0.1, 0.2, -0.1];
            let force = spatial::Force::new(
                &named(ForceKind::PointForce { frame, force: components, axes }),
                [[0.0; 3], center],
            );
            let arm = rotate(&p, &std::array::from_fn(|k| frame.point[k] - center[k]));
            let turning = cross(&spin[1], &arm);
            let expected: f64 = (0..3).map(|k| ground[k] * (at.y[1][k] + turning[k])).sum();
            assert!((work(&force) - expected).abs() < 1e-12);
        }
    }
}

/// An undamped bushing with full coupling, its frames, and its potential.
fn bushing(random: &mut Random, damping: f64) -> (spatial::Force, [Frame; 2], [[f64; 6]; 6]) {
    let frames = [0, 1].map(|_| random_frame(random, 0.4));
    let stiffness = coupled_matrix(random, 5000.0);
    let damping = coupled_matrix(random, damping);
    let (boxed, damping) = (Box::new(stiffness), Box::new(damping));
    let kind = ForceKind::Bushing { frames, stiffness: boxed, damping, branches: Vec::new() };
    (spatial::Force::new(&named(kind), [[0.05, 0.1, -0.1]; 2]), frames, stiffness)
}

#[test] // independent truth: differences of ½ uᵀK u
fn undamped_bushing_is_the_gradient_of_its_potential_to_3_rad() {
    let mut random = Random::new(1200);
    for _ in 0..50 {
        let (e, frames, _) = bushing(&mut random, 0.0);
        let relative = turn(&random.unit(), random.range(2.0, 3.0));
        let q = poses(&mut random, &frames, &relative);
        let at = At { t: 0.0, q, y: random_pair(&mut random, 1.0), z: [0.0; 12], winding: 0.0 };
        let out = wrenches(&e, &at.input::<Spatial, 3>());
        let size = out.as_flattened().iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        for column in 0..12 {
            let slope = richardson(1e-4, |s| {
                let by = moved(&[[0.0; 6]; 2], column, s);
                vec![e.energy(&at.displaced::<Spatial, 3>(&by).input::<Spatial, 3>()).potential]
            })[0];
            let found = out[column / 6][column % 6];
            assert!((found + slope).abs() < 1e-8 * size, "{column}: {found} {slope}");
        }
    }
}

/// A closed path of both bodies through relative rotations of nearly 3 rad, at phase 0..1.
fn cycle(phase: f64, frames: &[Frame; 2]) -> Pair<f64, 7> {
    let (s, c) = (std::f64::consts::TAU * phase).sin_cos();
    let (s2, c2) = (2.0 * std::f64::consts::TAU * phase).sin_cos();
    let tilt = turn(&[0.6, 0.0, 0.8], 1.2 * c + 0.3 * s2);
    let relative = product(&tilt, &turn(&[0.0, 0.6, 0.8], 1.4 * s));
    let first = product(&turn(&[1.0, 0.0, 0.0], 0.7 * s), &turn(&[0.0, 0.0, 1.0], 0.5 * c2));
    let [ci, cj] = [0, 1].map(|side| euler_parameters(&frames[side].axes));
    let second = product(&product(&product(&first, &ci), &relative), &conjugate(&cj));
    let place = [[0.1 * s, 0.2 * c, 0.05 * s2], [0.3 * c2, -0.1 * s, 0.2 * s * c]];
    std::array::from_fn(|side| {
        let p = if side == 0 { first } else { second };
        let [x, y, z] = place[side];
        [x, y, z, p[0], p[1], p[2], p[3]]
    })
}

#[test] // independent truth: no work over a closed path; the trapezoidal rule is spectral there
fn undamped_bushing_does_no_work_over_a_closed_cycle() {
    let mut random = Random::new(1300);
    let (e, frames, _) = bushing(&mut random, 0.0);
    let n = 400;
    let (mut work, mut turnover, mut largest) = (0.0, 0.0, 0.0_f64);
    for k in 0..n {
        let phase = f64::from(k) / f64::from(n);
        let q = cycle(phase, &frames);
        let rate = richardson(1e-3, |s| cycle(phase + s, &frames).concat());
        let at = At { t: 0.0, q, y: [[0.0; 6]; 2], z: [0.0; 12], winding: 0.0 };
        let out = wrenches(&e, &at.input::<Spatial, 3>());
        let power: f64 = (0..2)
            .map(|side| {
                let v: [f64; 7] = std::array::from_fn(|k| rate[7 * side + k]);
                let twist = Spatial::body(&q[side], &v).twist;
                twist.iter().zip(&out[side]).map(|(a, b)| a * b).sum::<f64>()
            })
            .sum();
        work += power / f64::from(n);
        turnover += power.abs() / f64::from(n);
        let mut u = [0.0; 6];
        e.quantity(0, &at.input::<Spatial, 3>(), &mut u);
        let half_sine = 0.5 * (u[3] * u[3] + u[4] * u[4] + u[5] * u[5]).sqrt();
        largest = largest.max(2.0 * half_sine.min(1.0).asin());
    }
    assert!(largest > 1.5, "the path turns far: {largest}");
    assert!(work.abs() < 1e-8 * turnover, "{work:e} of {turnover:e}");
}

#[test] // independent truth: the linear law at small deformation, moments by hand
fn bushing_channels_are_its_wrench_on_the_second_body() {
    let mut random = Random::new(1400);
    for _ in 0..20 {
        let (e, frames, stiffness) = bushing(&mut random, 0.0);
        // same place, turned by a small vector: torque −K φ, force −K φ, in axes of the first frame
        let (axis, angle) = (random.unit::<3>(), 1e-6);
        let mut q = poses(&mut random, &frames, &turn(&axis, angle));
        bring_together(&mut q, &frames, &[[0.05, 0.1, -0.1]; 2], &[0.0; 3]);
        let at = At { t: 0.0, q, y: [[0.0; 6]; 2], z: [0.0; 12], winding: 0.0 };
        let (mut force, mut torque) = ([0.0; 3], [0.0; 3]);
        e.quantity(1, &at.input::<Spatial, 3>(), &mut force);
        e.quantity(2, &at.input::<Spatial, 3>(), &mut torque);
        for k in 0..3 {
            let expected = |row: usize| -> f64 {
                (0..3).map(|j| -stiffness[row][3 + j] * angle * axis[j]).sum()
            };
            assert!((force[k] - expected(k)).abs() < 1e-7);
            assert!((torque[k] - expected(3 + k)).abs() < 1e-7);
        }
        // at any deformation: channels against the wrench on the second body
        let (e, frames, _) = bushing(&mut random, 30.0);
        let relative = any_turn(&mut random);
        let q = poses(&mut random, &frames, &relative);
        let at = At { t: 0.0, q, y: random_pair(&mut random, 1.0), z: [0.0; 12], winding: 0.0 };
        let out = wrenches(&e, &at.input::<Spatial, 3>());
        e.quantity(1, &at.input::<Spatial, 3>(), &mut force);
        e.quantity(2, &at.input::<Spatial, 3>(), &mut torque);
        let (f, n) = parts(&out[1]);
        let s: [f64; 3] = std::array::from_fn(|k| frames[1].point[k] - [0.05, 0.1, -0.1][k]);
        let about_point = cross(&rotate(&euler(&q[1]), &s), &f);
        let n = std::array::from_fn(|k| n[k] - about_point[k]);
        // into axes of the first frame
        let ci = euler_parameters(&frames[0].axes);
        let to_frame = |a: &[f64; 3]| rotate_back(&product(&euler(&q[0]), &ci), a);
        let (f, n) = (to_frame(&f), to_frame(&n));
        for k in 0..3 {
            assert!((f[k] - force[k]).abs() < 1e-10 * (1.0 + force[k].abs()));
            assert!((n[k] - torque[k]).abs() < 1e-10 * (1.0 + torque[k].abs()));
        }
    }
}

#[test] // independent truth: rows of a rank-deficient Jacobian would vanish when orthogonalised
fn rows_are_satisfied_and_independent_where_a_joint_is_assembled() {
    let mut random = Random::new(1500);
    for kind in SPATIAL_JOINTS {
        for _ in 0..20 {
            let frames = [0, 1].map(|_| random_frame(&mut random, 0.8));
            // frames coincide; the universal joint's axes are perpendicular, the distance is kept,
            // and what a joint leaves free is moved
            let angle = random.range(-3.0, 3.0);
            let slide = random.range(-0.5, 0.5);
            let about_h = turn(&[0.0, 0.0, 1.0], angle);
            let quarter = turn(&[1.0, 0.0, 0.0], 0.5 * PI);
            let (relative, offset) = match kind {
                JointKind::Fixed => ([1.0, 0.0, 0.0, 0.0], [0.0; 3]),
                JointKind::Revolute => (about_h, [0.0; 3]),
                JointKind::Translational => ([1.0, 0.0, 0.0, 0.0], [0.0, 0.0, slide]),
                JointKind::Cylindrical => (about_h, [0.0, 0.0, slide]),
                JointKind::Universal => (product(&product(&about_h, &quarter), &about_h), [0.0; 3]),
                JointKind::Spherical => (any_turn(&mut random), [0.0; 3]),
                JointKind::Distance { length } => {
                    (any_turn(&mut random), random.unit().map(|x| length * x))
                }
            };
            let mut q = poses(&mut random, &frames, &relative);
            let ci = euler_parameters(&frames[0].axes);
            let offset = rotate(&product(&euler(&q[0]), &ci), &offset);
            bring_together(&mut q, &frames, &[[0.0; 3]; 2], &offset);
            let e = spatial::Constraint::joint(&joint(kind, frames), [[0.0; 3]; 2]);
            let mut u = [0.0; 6];
            e.value(refs(&q), &mut u);
            assert!(u.iter().all(|x| x.abs() < 1e-14), "{kind:?}: {u:?}");

            let quantities = e.quantities();
            for (index, quantity) in quantities.iter().enumerate() {
                let mut out = [0.0];
                e.quantity(index, refs(&q), refs(&[[0.0; 7]; 2]), 0.0, &mut out);
                let expected = match quantity.name {
                    "angle" => angle,
                    "displacement" => slide,
                    _ => 0.0,
                };
                assert!((out[0] - expected).abs() < 1e-13, "{kind:?}: {quantity:?}");
            }

            let mut jacobian = crate::elements::RowBlocks::zero();
            e.jacobian(refs(&q), &mut jacobian);
            let mut basis: Vec<Vec<f64>> = Vec::new();
            for row in 0..e.rows() {
                // columns r and ½ G_p Eᵀ of both bodies
                let mut a = Vec::new();
                for side in 0..2 {
                    let entries = &jacobian.0[side][row];
                    let (f, n) = wrench(&q[side], entries);
                    a.extend(f.into_iter().chain(n));
                }
                let size = a.iter().map(|x| x * x).sum::<f64>().sqrt();
                for b in &basis {
                    let along: f64 = a.iter().zip(b).map(|(x, y)| x * y).sum();
                    a.iter_mut().zip(b).for_each(|(x, y)| *x -= along * y);
                }
                let left = a.iter().map(|x| x * x).sum::<f64>().sqrt();
                assert!(left > 0.1 * size, "{kind:?}, {}: {left}", e.row_kind(row));
                basis.push(a.iter().map(|x| x / left).collect());
            }
        }
    }
}
