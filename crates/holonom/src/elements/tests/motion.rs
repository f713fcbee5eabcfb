//! Rows from how bodies stand and move. Independent truth: the rows from coordinates of poses, and Richardson-extrapolated
//! differences along a displacement of both bodies.

use super::constraints::{DRIVERS, PLANAR_JOINTS, SPATIAL_JOINTS, driver, joint};
use super::*;
use crate::elements::kinematics::{bushing_form, free_form, line_form};
use crate::elements::motion::{Field, Motion, MotionRows, Stance};
use crate::elements::relative::RelativeElement;
use crate::elements::space::{Planar, Spatial, triads};
use crate::elements::{ConstraintElement, planar, spatial};
use crate::math::spatial::rotation_matrix;
use crate::math::turn::exponential;
use crate::math::vector::dot;

/// What a displacement makes of how a body stands.
fn displaced(body: &Stance, by: &Field, s: f64) -> Stance {
    let turn = rotation_matrix(&exponential(&by[1].map(|x| s * x)));
    let column = |k: usize| body.axes.map(|row| row[k]);
    let columns = [0, 1, 2].map(|k| turn.map(|row| dot(&row, &column(k))));
    Stance {
        place: std::array::from_fn(|k| body.place[k] + s * by[0][k]),
        axes: std::array::from_fn(|row| columns.map(|column| column[row])),
    }
}

/// u̇ by the wrenches of the rows.
fn power(
    rows: &dyn MotionRows,
    count: usize,
    bodies: [&Stance; 2],
    fields: [&Field; 2],
) -> Vec<f64> {
    let mut wrenches = [[[[0.0; 3]; 2]; 2]; 6];
    rows.wrenches(bodies, &mut wrenches);
    let of_side = |row: usize, side: usize| {
        let [force, moment] = &wrenches[row][side];
        dot(force, &fields[side][0]) + dot(moment, &fields[side][1])
    };
    (0..count).map(|row| of_side(row, 0) + of_side(row, 1)).collect()
}

fn near(name: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    let size = expected.iter().fold(1.0_f64, |m, x| m.max(x.abs()));
    for (found, expected) in found.iter().zip(expected) {
        assert!(
            (found - expected).abs() <= tolerance * size,
            "{name}: {found:.12e} {expected:.12e}"
        );
    }
}

/// Checks rows of values `expected` where `plane` bodies move in it only.
fn check(
    name: &str,
    rows: &dyn MotionRows,
    expected: &[f64],
    bodies: [&Stance; 2],
    plane: bool,
    random: &mut Random,
) {
    let mut u = [0.0; 6];
    rows.value_at(bodies, &mut u);
    near(&format!("{name}, value"), &u, expected, 1e-13);
    let mut field = || -> Field {
        let [linear, angular]: [[f64; 3]; 2] = [random.array(1.0), random.array(1.0)];
        if !plane {
            return [linear, angular];
        }
        [[linear[0], linear[1], 0.0], [0.0, 0.0, angular[2]]]
    };
    let motions =
        [0, 1].map(|_| Motion { velocity: field(), displacement: field(), change: field() });
    let count = expected.len();
    let at = |s: f64| [0, 1].map(|side| displaced(bodies[side], &motions[side].displacement, s));
    // The wrenches' power along the displacement is the change of the value.
    let found = power(rows, count, bodies, [&motions[0].displacement, &motions[1].displacement]);
    let changes = richardson(1e-4, |s| {
        let mut u = [0.0; 6];
        let [first, second] = at(s);
        rows.value_at([&first, &second], &mut u);
        u[..count].to_vec()
    });
    near(&format!("{name}, wrenches"), &found, &changes, 1e-8);
    // Their power along the velocities changes with the displacement and with these.
    rows.rate_changes(bodies, [&motions[0], &motions[1]], &mut u);
    let changes = richardson(1e-4, |s| {
        let velocity = [0, 1].map(|side| {
            let Motion { velocity, change, .. } = &motions[side];
            [0, 1].map(|part| std::array::from_fn(|k| velocity[part][k] + s * change[part][k]))
        });
        let [first, second] = at(s);
        power(rows, count, [&first, &second], [&velocity[0], &velocity[1]])
    });
    near(&format!("{name}, changes of rates"), &u, &changes, 1e-8);
}

fn check_constraint<const N: usize>(
    name: &str,
    e: &impl ConstraintElement<N>,
    q: &Pair<f64, N>,
    stance: impl Fn(&[f64; N]) -> Stance,
    random: &mut Random,
) -> bool {
    let Some(rows) = e.on_motions() else { return false };
    let mut u = [0.0; 6];
    e.value(refs(q), &mut u);
    let bodies = [stance(&q[0]), stance(&q[1])];
    check(name, rows, &u[..e.rows()], [&bodies[0], &bodies[1]], N == 3, random);
    true
}

fn check_relative<const N: usize>(
    e: &impl RelativeElement<N>,
    q: &Pair<f64, N>,
    stance: impl Fn(&[f64; N]) -> Stance,
    random: &mut Random,
) -> bool {
    let Some(rows) = e.on_motions() else { return false };
    let mut u = [0.0; 6];
    e.value(refs(q), &[0.0; 6], &mut u);
    let bodies = [stance(&q[0]), stance(&q[1])];
    let name = format!("{:?} of {N}", e.kind());
    check(&name, rows, &u[..e.rows()], [&bodies[0], &bodies[1]], N == 3, random);
    true
}

#[test]
fn rows_of_joints_and_drivers_follow_from_motions() {
    let mut random = Random::new(81);
    let mut checked = 0;
    for _ in 0..10 {
        let frames = [0, 1].map(|_| random_frame(&mut random, 0.8));
        let centers = [random.array(0.3), random.array(0.3)];
        let relative = any_turn(&mut random);
        let q = poses(&mut random, &frames, &relative);
        for kind in SPATIAL_JOINTS {
            let e = spatial::Constraint::joint(&joint(kind, frames), centers);
            let name = format!("{kind:?}");
            checked += usize::from(check_constraint(&name, &e, &q, Stance::spatial, &mut random));
        }
        for kind in DRIVERS {
            let e = spatial::Constraint::driver(&driver(kind, frames), centers);
            let name = format!("{kind:?}");
            checked += usize::from(check_constraint(&name, &e, &q, Stance::spatial, &mut random));
        }
        let frames = [0, 1].map(|_| planar_frame(&mut random, 0.8));
        let centers = [[0.1, 0.2, 0.0], [-0.2, 0.1, 0.0]];
        let q = planar_poses(&mut random);
        for kind in PLANAR_JOINTS {
            let e = planar::Constraint::joint(&joint(kind, frames), centers);
            let name = format!("planar {kind:?}");
            checked += usize::from(check_constraint(&name, &e, &q, Stance::planar, &mut random));
        }
    }
    // All but drivers of angles.
    assert_eq!(checked, 10 * (SPATIAL_JOINTS.len() + DRIVERS.len() - 1 + PLANAR_JOINTS.len()));
}

#[test]
fn displacements_and_lengths_follow_from_motions() {
    let mut random = Random::new(82);
    let mut checked = 0;
    for _ in 0..10 {
        let frames = [0, 1].map(|_| random_frame(&mut random, 0.8));
        let relative = any_turn(&mut random);
        let q = poses(&mut random, &frames, &relative);
        let own = triads(&frames, &[[0.1, 0.0, -0.2]; 2]);
        for (_, coordinates) in [
            line_form::<Spatial, 3, 7, 4>(&own, None),
            bushing_form::<Spatial, 3, 7, 4>(&own),
            free_form::<Spatial, 3, 7, 4>(),
        ] {
            for (e, _) in &coordinates {
                checked += usize::from(check_relative(e, &q, Stance::spatial, &mut random));
            }
        }
        let frames = [0, 1].map(|_| planar_frame(&mut random, 0.8));
        let q = planar_poses(&mut random);
        let own = triads(&frames, &[[0.1, 0.0, 0.0]; 2]);
        for (_, coordinates) in
            [line_form::<Planar, 2, 3, 1>(&own, None), free_form::<Planar, 2, 3, 1>()]
        {
            for (e, _) in &coordinates {
                checked += usize::from(check_relative(e, &q, Stance::planar, &mut random));
            }
        }
    }
    // One of each form.
    assert_eq!(checked, 10 * 5);
}
