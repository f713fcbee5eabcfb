//! Elements at the edges of what they allow: several turns, no length, off the road.

use std::f64::consts::TAU;

use super::constraints::{driver, joint};
use super::forces::{At, named};
use super::*;
use crate::elements::space::{Planar, Spatial};
use crate::elements::{
    ConstraintElement, ForceBlocks, ForceElement, ForceInput, planar as plane, spatial,
};
use crate::model::{DriverKind, ElasticLaw, ForceKind, JointKind, Road, Tyre};

const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn origin() -> Frame {
    Frame { body: Some(0), point: [0.0; 3], axes: IDENTITY }
}

fn still<const N: usize, const W: usize>(q: Pair<f64, N>) -> At<f64, N, W> {
    At { t: 0.0, q, y: [[0.0; W]; 2], z: [0.0; 12], winding: 0.0 }
}

/// Wrenches.
fn evaluate<const D: usize, const N: usize, const W: usize>(
    e: &impl ForceElement<D, N, W>,
    input: &ForceInput<f64, D, N, W>,
) -> Pair<f64, W> {
    let mut out = [[0.0; W]; 2];
    e.evaluate(input, &mut out, &mut vec![0.0; e.extra_states()]);
    out
}

#[test] // independent truth: the angle that was set, and the spring's torque −k θ
fn rotational_spring_keeps_its_winding_over_several_turns() {
    let frames = [origin(), origin()];
    let law = ElasticLaw::Linear(3.0);
    let kind = ForceKind::Rsda { frames, law, damping: 0.0, free_angle: 0.0 };
    let e = spatial::Force::new(&named(kind.clone()), [[0.0; 3]; 2]);
    let flat = plane::Force::new(&named(kind), [[0.0; 3]; 2]);
    assert!(e.counts_turns());
    for direction in [1.0, -1.0] {
        let mut winding = 0.0;
        for k in 0..200 {
            let angle = direction * 0.2 * f64::from(k);
            let p = turn(&[0.0, 0.0, 1.0], angle);
            let q = [spatial::GROUND, [0.0, 0.0, 0.0, p[0], p[1], p[2], p[3]]];
            let at = At { winding, ..still(q) };
            let input = at.input::<Spatial, 3>();
            winding = e.angle([&input.bodies[0], &input.bodies[1]], winding);
            assert!((winding - angle).abs() < 1e-12, "{winding} {angle}");
            assert!((evaluate(&e, &input)[1][5] + 3.0 * angle).abs() < 1e-11);
            let at = still([[0.0; 3], [0.0, 0.0, angle]]);
            let plain = evaluate(&flat, &at.input::<Planar, 2>());
            assert!((plain[1][2] + 3.0 * angle).abs() < 1e-12);
            let energy = e.energy(&input).potential;
            assert!((energy - 1.5 * angle * angle).abs() < 1e-9);
        }
        assert!(winding.abs() > 6.0 * TAU);
    }
}

#[test] // independent truth: the difference of the body angles
fn planar_angles_are_differences_of_body_angles_over_any_turns() {
    let frames = [origin(), origin()];
    let pin = plane::Constraint::joint(&joint(JointKind::Revolute, frames), [[0.0; 3]; 2]);
    let law = ElasticLaw::Linear(2.0);
    let kind = ForceKind::Rsda { frames, law, damping: 0.0, free_angle: 3.5 };
    let spring = plane::Force::new(&named(kind), [[0.0; 3]; 2]);
    for angle in [0.0, 0.7, -9.0, 20.0] {
        let q = [[0.0; 3], [0.0, 0.0, 3.5 + angle]];
        let mut out = [0.0];
        pin.quantity(0, refs(&q), refs(&[[0.0; 3]; 2]), 0.0, &mut out);
        assert!((out[0] - 3.5 - angle).abs() < 1e-13);
        assert!(
            (evaluate(&spring, &still(q).input::<Planar, 2>())[1][2] + 2.0 * angle).abs() < 1e-12
        );
    }
    // a fixed joint does not care about whole turns of its bodies
    let (s, c) = (-3.5_f64).sin_cos();
    let turned = Frame { axes: [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], ..origin() };
    let frames = [origin(), turned];
    let weld = plane::Constraint::joint(&joint(JointKind::Fixed, frames), [[0.0; 3]; 2]);
    let mut u = [0.0; 6];
    weld.value(refs(&[[0.0; 3], [0.0, 0.0, 3.5 + TAU]]), &mut u);
    assert!(u[2].abs() < 1e-14);
}

#[test] // independent truth: the angle and displacement that were set, and the function's own slope
fn drivers_measure_the_motion_they_prescribe() {
    let frames = [origin(), origin()];
    let rotation =
        spatial::Constraint::driver(&driver(DriverKind::Rotation, frames), [[0.0; 3]; 2]);
    let shift =
        spatial::Constraint::driver(&driver(DriverKind::Translation, frames), [[0.0; 3]; 2]);
    assert!(rotation.wraps() && !shift.wraps());
    for angle in [-2.9, -0.4, 1.3, 2.9] {
        let p = turn(&[0.0, 0.0, 1.0], angle);
        let q = [spatial::GROUND, [0.3, 0.2, angle, p[0], p[1], p[2], p[3]]];
        let mut u = [0.0; 6];
        rotation.value(refs(&q), &mut u);
        assert!((u[0] - angle).abs() < 1e-14);
        shift.value(refs(&q), &mut u);
        assert!((u[0] - angle).abs() < 1e-14);
    }
    let d = rotation.drive(0.4).unwrap();
    for k in 0..3 {
        let slope = richardson(1e-3, |s| vec![rotation.drive(0.4 + s).unwrap()[k]])[0];
        assert!((slope - d[k + 1]).abs() < 1e-8);
    }
    let pin = spatial::Constraint::joint(&joint(JointKind::Revolute, frames), [[0.0; 3]; 2]);
    assert_eq!(pin.drive(0.4), None);
}

#[test] // independent truth: swing and twist of a rotation, θ = 2 atan2(p₃, p₀), and the moment −k θ ∂θ̇/∂ω by formula
fn twist_depends_on_the_axes_alone() {
    let mut random = Random::new(77);
    for _ in 0..200 {
        let across = random.range(0.0, TAU);
        let (s, c) = across.sin_cos();
        let axes = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]];
        let relative = turn(&random.unit(), random.range(-2.9, 2.9));
        let [_, x, y, _] = relative;
        let q = [spatial::GROUND, [0.0, 0.0, 0.0, relative[0], x, y, relative[3]]];
        let expected = 2.0 * relative[3].atan2(relative[0]);
        let frames = [origin(), origin()].map(|frame| Frame { axes, ..frame });
        let (law, damping, free_angle) = (ElasticLaw::Linear(3.0), 0.0, 0.0);
        let kind = ForceKind::Rsda { frames, law, damping, free_angle };
        let spring = spatial::Force::new(&named(kind), [[0.0; 3]; 2]);
        let at = still(q);
        let input = at.input::<Spatial, 3>();
        let angle = spring.angle([&input.bodies[0], &input.bodies[1]], expected);
        assert!((angle - expected).abs() < 1e-12);
        let kind = driver(DriverKind::Rotation, frames);
        let mut u = [0.0; 6];
        spatial::Constraint::driver(&kind, [[0.0; 3]; 2]).value(refs(&q), &mut u);
        assert!((u[0] - expected - TAU * ((u[0] - expected) / TAU).round()).abs() < 1e-12);
        let turned = crate::math::spatial::rotate(&relative, &[0.0, 0.0, 1.0]);
        let at = At { winding: expected, ..still(q) };
        let input = at.input::<Spatial, 3>();
        let moments = evaluate(&spring, &input);
        for k in 0..3 {
            let sum = turned[k] + if k == 2 { 1.0 } else { 0.0 };
            let moment = -3.0 * expected * sum / (1.0 + turned[2]);
            let allowed = 1e-11 / (1.0 + turned[2]);
            assert!((moments[1][3 + k] - moment).abs() < allowed);
            assert!((moments[0][3 + k] + moment).abs() < allowed);
        }
    }
}

fn spring(free_length: f64) -> ForceKind {
    let law = ElasticLaw::Linear(1000.0);
    ForceKind::Tsda { frames: [origin(), origin()], law, damping: 5.0, free_length }
}

#[test] // independent truth: a spring without free length is the linear force −k d
fn spring_without_free_length_is_linear_down_to_no_length() {
    let e = plane::Force::new(&named(spring(0.0)), [[0.0; 3]; 2]);
    for d in [[0.0, 0.0], [1e-14, 0.0], [1e-9, -2e-9], [0.3, -0.4]] {
        let at = still([[0.0; 3], [d[0], d[1], 0.3]]);
        let at = at.input::<Planar, 2>();
        let w = evaluate(&e, &at);
        for k in 0..2 {
            assert!((w[1][k] + 1000.0 * d[k]).abs() <= 1e-12 * d[k].abs() * 1000.0);
        }
        let mut blocks = ForceBlocks::zero();
        e.blocks(&at, &mut blocks);
        for i in 0..2 {
            for j in 0..2 {
                let expected = if i == j { 1000.0 } else { 0.0 };
                assert!((blocks.k.0[1][1][i][j] - expected).abs() < 1e-9);
                assert!((blocks.k.0[0][1][i][j] + expected).abs() < 1e-9);
            }
        }
    }
}

#[test] // independent truth: the documented limit: no direction, no force, finite blocks
fn springs_stay_finite_where_their_points_meet() {
    let kinds = [
        spring(0.5),
        ForceKind::Maxwell {
            frames: [origin(), origin()],
            stiffness: 1000.0,
            damping: 10.0,
            free_length: 0.2,
        },
    ];
    for kind in kinds {
        let e = spatial::Force::new(&named(kind), [[0.0; 3]; 2]);
        let mut at = still([spatial::GROUND, spatial::GROUND]);
        at.y[1][0] = 2.0;
        let at = at.input::<Spatial, 3>();
        assert_eq!(evaluate(&e, &at), [[0.0; 6]; 2]);
        let mut blocks = ForceBlocks::zero();
        e.blocks(&at, &mut blocks);
        let all = blocks.k.entries();
        assert!(all.iter().all(|x| x.is_finite()));
        assert!(blocks.c.entries().iter().all(|x| *x == 0.0));
    }
}

#[test] // independent truth: the law by hand at rest
fn tyre_carries_its_law_and_none_off_the_road() {
    let tyre = Tyre {
        frame: origin(),
        radius: 0.4699,
        stiffness: 296325.0,
        damping: 3502.0,
        smoothing: 1e-3,
        road: Road::Flat { height: 0.2 },
        lateral: None,
    };
    let e = spatial::Force::new(&named(ForceKind::Tyre(tyre)), [[0.0; 3]; 2]);
    let at = |z: f64| still([spatial::GROUND, [1.0, 2.0, z, 1.0, 0.0, 0.0, 0.0]]);
    let on = evaluate(&e, &at(0.2 + 0.4699 - 0.02).input::<Spatial, 3>())[1];
    let s = 0.5 * (0.02 + (0.02_f64.powi(2) + 1e-6).sqrt());
    assert!((on[2] - 296325.0 * s).abs() < 1e-7);
    assert_eq!([on[0], on[1]], [0.0, 0.0]);
    let off = evaluate(&e, &at(2.0).input::<Spatial, 3>())[1];
    assert!(off[2] > 0.0 && off[2] < 0.1, "what the smoothing leaves: {}", off[2]);
}
