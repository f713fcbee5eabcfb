//! Blocks of joints and drivers. Independent truth: Richardson-extrapolated differences of the
//! function each block is the derivative of, and dual numbers through that function.

use num_dual::Dual64;

use super::*;
use crate::elements::{ConstraintElement, PairBlocks, RowBlocks, planar, spatial};
use crate::math::{Real, TimeFunction};
use crate::model::{Driver, DriverKind, Joint, JointKind};
use crate::testing::random_states;

fn rows_of<const N: usize>(blocks: &RowBlocks<f64, N>) -> Vec<Vec<f64>> {
    (0..6).map(|r| [blocks.0[0][r], blocks.0[1][r]].concat()).collect()
}

pub(super) fn pair_of<const N: usize>(blocks: &PairBlocks<f64, N>) -> Vec<Vec<f64>> {
    let row = |s: usize, i: usize| [blocks.0[s][0][i], blocks.0[s][1][i]].concat();
    (0..2 * N).map(|k| row(k / N, k % N)).collect()
}

fn value<T: Real, const N: usize>(e: &impl ConstraintElement<N>, q: &Pair<T, N>) -> Vec<T> {
    let mut u = [T::zero(); 6];
    e.value(refs(q), &mut u);
    u.to_vec()
}

fn jacobian<T: Real, const N: usize>(
    e: &impl ConstraintElement<N>,
    q: &Pair<T, N>,
) -> RowBlocks<T, N> {
    let mut out = RowBlocks::zero();
    e.jacobian(refs(q), &mut out);
    out
}

/// G w
fn times<T: Real, const N: usize>(
    e: &impl ConstraintElement<N>,
    q: &Pair<T, N>,
    w: &Pair<f64, N>,
) -> Vec<T> {
    let g = jacobian(e, q);
    let part = |row: usize, side: usize| {
        (0..N).fold(T::zero(), |sum, k| sum + g.0[side][row][k] * w[side][k])
    };
    (0..6).map(|row| part(row, 0) + part(row, 1)).collect()
}

/// Gᵀ c
pub(super) fn reaction<T: Real, const N: usize>(
    e: &impl ConstraintElement<N>,
    q: &Pair<T, N>,
    c: &[f64; 6],
) -> Vec<T> {
    let g = jacobian(e, q);
    let entry = |k: usize| (0..6).fold(T::zero(), |sum, row| sum + g.0[k / N][row][k % N] * c[row]);
    (0..2 * N).map(entry).collect()
}

/// A motion through q, with the velocities v and the accelerations a there: each level is the change of the one before.
fn check_levels<const N: usize>(
    name: &str,
    e: &impl ConstraintElement<N>,
    q: &Pair<f64, N>,
    [v, a]: [&Pair<f64, N>; 2],
) {
    let moving = |x: &Pair<f64, N>, rates: &Pair<f64, N>| {
        let mut out = lifted(x);
        for (out, rate) in out.as_flattened_mut().iter_mut().zip(rates.as_flattened()) {
            out.eps = *rate;
        }
        out
    };
    let levels = e.value_and_rates(refs(q), refs(v), refs(a));
    assert_eq!(levels[0].to_vec(), value(e, q), "{name}, value");
    let truth = e.value_and_rates(refs(&moving(q, v)), refs(&moving(v, a)), refs(&lifted(a)));
    for [before, after] in [[0, 1], [1, 2]] {
        let size = levels[after].iter().fold(1.0, |size: f64, u| size.max(u.abs()));
        for (rate, truth) in levels[after].iter().zip(&truth[before]) {
            let off = (rate - truth.eps).abs();
            assert!(off <= 1e-12 * size, "{name}, level {after}: {rate} {}", truth.eps);
        }
    }
}

fn check<const N: usize>(
    name: &str,
    e: &impl ConstraintElement<N>,
    q: &Pair<f64, N>,
    random: &mut Random,
    length: f64,
) {
    let (w, v) = (random_pair::<N>(random, 2.0), random_pair::<N>(random, 2.0));
    let c: [f64; 6] = random.array(3.0);
    let h = 1e-4 * length;

    let mut rows = jacobian(e, q);
    for r in e.rows()..6 {
        assert!([rows.0[0][r], rows.0[1][r]].iter().flatten().all(|x| *x == 0.0), "{name}");
    }
    let label = |block: &str| format!("{name}, {block}");
    let mut rate = [0.0; 6];
    e.rate(refs(q), refs(&v), &mut rate);
    for (rate, truth) in rate.iter().zip(times(e, q, &v)) {
        assert!((rate - truth).abs() <= 1e-13 * (1.0 + length), "{}", label("G v"));
    }
    check_levels(name, e, q, [&w, &v]);
    check_block(&label("jacobian"), q, h, rows_of(&rows), |q| value(e, q), |q| value(e, q));

    e.directional(refs(q), refs(&w), &mut rows);
    let plain = |q: &Pair<f64, N>| times(e, q, &w);
    let dual = |q: &Pair<Dual64, N>| times(e, q, &w);
    check_block(&label("directional"), q, h, rows_of(&rows), plain, dual);

    // (G v)_q v is the change of G v along v
    let mut curvature = [0.0; 6];
    e.curvature(refs(q), refs(&v), &mut curvature);
    let along = |s: f64| {
        let mut there = *q;
        for side in 0..2 {
            for k in 0..N {
                there[side][k] += s * v[side][k];
            }
        }
        times(e, &there, &v)
    };
    // its terms v_i H_ij v_j may cancel: they are the measure
    e.directional(refs(q), refs(&v), &mut rows);
    let terms = |row: usize| {
        let entries = [rows.0[0][row], rows.0[1][row]].concat();
        entries.iter().zip(v.as_flattened()).map(|(a, b)| (a * b).abs()).sum::<f64>()
    };
    let size = (0..6).map(terms).fold(0.0, f64::max);
    let mut there = lifted(q);
    for side in 0..2 {
        for k in 0..N {
            there[side][k].eps = v[side][k];
        }
    }
    let exact: Vec<f64> = times(e, &there, &v).iter().map(|x| x.eps).collect();
    for (expected, tolerance) in [(richardson(h, along), 1e-7), (exact, 1e-12)] {
        for (found, expected) in curvature.iter().zip(expected) {
            let allowed = tolerance * if size > 0.0 { size } else { 1.0 };
            assert!((found - expected).abs() <= allowed, "{name}, curvature: {found} {expected}");
        }
    }

    let mut blocks = [RowBlocks::zero(); 2];
    e.rate_blocks(refs(q), refs(&v), refs(&w), &mut blocks);
    let plain = |q: &Pair<f64, N>| times(e, q, &v);
    let dual = |q: &Pair<Dual64, N>| times(e, q, &v);
    check_block(&label("of velocities"), q, h, rows_of(&blocks[0]), plain, dual);
    let plain = |q: &Pair<f64, N>| {
        let mut out = [0.0; 6];
        e.curvature(refs(q), refs(&v), &mut out);
        out.iter().zip(times(e, q, &w)).map(|(bent, along)| bent + along).collect()
    };
    let lifted_v = lifted(&v);
    let dual = |q: &Pair<Dual64, N>| {
        let mut out = [Dual64::from(0.0); 6];
        e.curvature(refs(q), refs(&lifted_v), &mut out);
        out.iter().zip(times(e, q, &w)).map(|(bent, along)| bent + along).collect()
    };
    check_block(&label("of accelerations"), q, h, rows_of(&blocks[1]), plain, dual);

    let mut hessian = PairBlocks::zero();
    e.hessian(refs(q), &c, &mut hessian);
    let full = pair_of(&hessian);
    let between = [hessian.0[0][1], hessian.0[1][0]];
    let coupled = between.as_flattened().as_flattened().iter().any(|x| *x != 0.0);
    assert!(e.couples() || !coupled, "{}", label("couples"));
    for i in 0..2 * N {
        for j in 0..2 * N {
            assert!((full[i][j] - full[j][i]).abs() < 1e-13, "{name}: symmetric");
        }
    }
    let plain = |q: &Pair<f64, N>| reaction(e, q, &c);
    let dual = |q: &Pair<Dual64, N>| reaction(e, q, &c);
    check_block(&label("hessian"), q, h, full, plain, dual);
}

pub(super) const SPATIAL_JOINTS: [JointKind; 7] = [
    JointKind::Fixed,
    JointKind::Revolute,
    JointKind::Translational,
    JointKind::Cylindrical,
    JointKind::Universal,
    JointKind::Spherical,
    JointKind::Distance { length: 0.7 },
];

pub(super) const PLANAR_JOINTS: [JointKind; 4] = [
    JointKind::Fixed,
    JointKind::Revolute,
    JointKind::Translational,
    JointKind::Distance { length: 0.7 },
];

pub(super) const DRIVERS: [DriverKind; 2] = [DriverKind::Translation, DriverKind::Rotation];

pub(super) fn joint(kind: JointKind, frames: [Frame; 2]) -> Joint {
    Joint { name: "joint".into(), kind, frames }
}

pub(super) fn driver(kind: DriverKind, frames: [Frame; 2]) -> Driver {
    let motion =
        TimeFunction::Harmonic { amplitude: 0.3, angular_frequency: 2.0, phase: 0.1, offset: 0.2 };
    Driver { name: "driver".into(), kind, frames, motion }
}

#[test]
fn blocks_of_spatial_joints_are_derivatives() {
    for (k, kind) in SPATIAL_JOINTS.into_iter().enumerate() {
        let mut random = Random::new(100 + k as u64);
        for _ in 0..random_states() {
            let frames = [0, 1].map(|_| random_frame(&mut random, 0.8));
            let centers = [random.array(0.3), random.array(0.3)];
            let e = spatial::Constraint::joint(&joint(kind, frames), centers);
            let relative = any_turn(&mut random);
            let q = poses(&mut random, &frames, &relative);
            let q = off_unit(&mut random, &q);
            check(&format!("{kind:?}"), &e, &q, &mut random, smallest_length(&frames));
        }
    }
}

#[test]
fn blocks_of_planar_joints_are_derivatives() {
    for (k, kind) in PLANAR_JOINTS.into_iter().enumerate() {
        let mut random = Random::new(200 + k as u64);
        for _ in 0..random_states() {
            let frames = [0, 1].map(|_| planar_frame(&mut random, 0.8));
            let centers = [0, 1].map(|_| [random.range(-0.3, 0.3), random.range(-0.3, 0.3), 0.0]);
            let e = planar::Constraint::joint(&joint(kind, frames), centers);
            let q = planar_poses(&mut random);
            check(&format!("{kind:?}"), &e, &q, &mut random, smallest_length(&frames));
        }
    }
}

#[test]
fn blocks_of_drivers_are_derivatives() {
    for (k, kind) in DRIVERS.into_iter().enumerate() {
        let mut random = Random::new(300 + k as u64);
        for _ in 0..random_states() {
            let frames = [0, 1].map(|_| random_frame(&mut random, 0.8));
            let e = spatial::Constraint::driver(&driver(kind, frames), [[0.1, 0.2, -0.3]; 2]);
            let relative = axial_turn(&mut random);
            let q = poses(&mut random, &frames, &relative);
            let q = off_unit(&mut random, &q);
            check(&format!("{kind:?}"), &e, &q, &mut random, smallest_length(&frames));

            let frames = [0, 1].map(|_| planar_frame(&mut random, 0.8));
            let e = planar::Constraint::driver(&driver(kind, frames), [[0.1, 0.2, 0.0]; 2]);
            let q = planar_poses(&mut random);
            check(&format!("planar {kind:?}"), &e, &q, &mut random, smallest_length(&frames));
        }
    }
}

#[test] // independent truth: rates by differences of the coordinate along the motion
fn rates_of_relative_coordinates_are_their_derivatives() {
    let mut random = Random::new(400);
    for kind in SPATIAL_JOINTS {
        for _ in 0..20 {
            let frames = [0, 1].map(|_| random_frame(&mut random, 0.8));
            let e = spatial::Constraint::joint(&joint(kind, frames), [[0.0; 3]; 2]);
            let relative = axial_turn(&mut random);
            let (q, v) = (poses(&mut random, &frames, &relative), random_pair(&mut random, 1.0));
            for index in (0..e.quantities().len()).step_by(2) {
                let (mut out, mut rate) = ([0.0], [0.0]);
                e.quantity(index + 1, refs(&q), refs(&v), 0.0, &mut rate);
                let found = richardson(1e-4, |s| {
                    let mut there = q;
                    for side in 0..2 {
                        for k in 0..7 {
                            there[side][k] += s * v[side][k];
                        }
                    }
                    let mut out = [0.0];
                    e.quantity(index, refs(&there), refs(&v), 0.0, &mut out);
                    out.to_vec()
                });
                e.quantity(index, refs(&q), refs(&v), 0.0, &mut out);
                assert!((found[0] - rate[0]).abs() < 1e-8, "{kind:?} {index}");
            }
        }
    }
}
