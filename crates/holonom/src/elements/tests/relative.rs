//! Relative coordinates and the kinematics of edges. Independent truth: Richardson-extrapolated
//! differences of the function each block is the derivative of, dual numbers through it, and that placed bodies
//! have the coordinates they were placed by.

use num_dual::Dual64;

use super::*;
use crate::elements::kinematics::{
    Anchor, EdgeKinematics, Form, Orientation, bushing_form, free_form, line_form,
};
use crate::elements::relative::{Reference, RelativeElement};
use crate::elements::space::{Planar, Spatial, Triad, triads};
use crate::elements::{RowBlocks, product as rows_times};
use crate::math::Real;
use crate::model::JointKind;

type Group<'a, E> = (&'a E, &'a Reference);

fn value<T: Real, const N: usize>(
    (e, reference): Group<'_, impl RelativeElement<N>>,
    q: &Pair<T, N>,
) -> Vec<T> {
    let mut u = [T::zero(); 6];
    e.value(refs(q), reference, &mut u);
    u[..e.rows()].to_vec()
}

fn gradient_times<T: Real, const N: usize>(
    (e, reference): Group<'_, impl RelativeElement<N>>,
    q: &Pair<T, N>,
    w: &Pair<f64, N>,
) -> Vec<T> {
    let mut rows = RowBlocks::zero();
    e.jacobian(refs(q), reference, &mut rows);
    let w = w.map(|side| side.map(T::from));
    (0..e.rows()).map(|k| rows_times(&[rows.0[0][k], rows.0[1][k]], refs(&w))).collect()
}

fn curvature<T: Real, const N: usize>(
    (e, reference): Group<'_, impl RelativeElement<N>>,
    q: &Pair<T, N>,
    v: &Pair<f64, N>,
) -> Vec<T> {
    let mut u = [T::zero(); 6];
    let v = v.map(|side| side.map(T::from));
    e.curvature(refs(q), refs(&v), reference, &mut u);
    u[..e.rows()].to_vec()
}

fn check_group<const N: usize>(
    name: &str,
    e: &impl RelativeElement<N>,
    reference: &Reference,
    q: &Pair<f64, N>,
    random: &mut Random,
) {
    let (w, v) = (random_pair::<N>(random, 1.0), random_pair::<N>(random, 1.0));
    let block = |rows: &RowBlocks<f64, N>| -> Vec<Vec<f64>> {
        (0..e.rows()).map(|r| [rows.0[0][r], rows.0[1][r]].concat()).collect()
    };
    let (group, h, mut rows) = ((e, reference), 1e-4, RowBlocks::zero());
    let label = |what: &str| format!("{name}, {what}");
    e.jacobian(refs(q), reference, &mut rows);
    let dual = |q: &Pair<Dual64, N>| value(group, q);
    check_block(&label("gradient"), q, h, block(&rows), |q| value(group, q), dual);
    e.directional(refs(q), refs(&w), reference, &mut rows);
    let dual = |q: &Pair<Dual64, N>| gradient_times(group, q, &w);
    check_block(&label("directional"), q, h, block(&rows), |q| gradient_times(group, q, &w), dual);
    // (G v)_q v is the change of G v along v: the row of the check above, times v.
    e.directional(refs(q), refs(&v), reference, &mut rows);
    let bend = curvature(group, q, &v);
    for (k, found) in bend.iter().enumerate() {
        let expected = rows_times(&[rows.0[0][k], rows.0[1][k]], refs(&v));
        assert!((found - expected).abs() <= 1e-11 * (1.0 + expected.abs()), "{name}: curvature");
    }
    let mut blocks = [RowBlocks::zero(); 2];
    e.rate_blocks(refs(q), refs(&v), refs(&w), reference, &mut blocks);
    let plain = |q: &Pair<f64, N>| gradient_times(group, q, &v);
    let dual = |q: &Pair<Dual64, N>| gradient_times(group, q, &v);
    check_block(&label("of velocities"), q, h, block(&blocks[0]), plain, dual);
    let plain = |q: &Pair<f64, N>| {
        let along = gradient_times(group, q, &w);
        curvature(group, q, &v).iter().zip(along).map(|(bent, along)| bent + along).collect()
    };
    let dual = |q: &Pair<Dual64, N>| {
        let along = gradient_times(group, q, &w);
        curvature(group, q, &v).iter().zip(along).map(|(bent, along)| bent + along).collect()
    };
    check_block(&label("of accelerations"), q, h, block(&blocks[1]), plain, dual);
}

/// Blocks of all coordinates of an edge at a pose away from its references, and its kinematics both ways.
fn check_form<S, const D: usize, const N: usize, const R: usize>(
    name: &str,
    (kinematics, coordinates): Form<S, D, N, R>,
    ground: [f64; N],
    start: Pair<f64, N>,
    moved: &Pair<f64, N>,
    random: &mut Random,
) where
    S: Orientation<D, N, R>,
{
    use crate::elements::kinematics::Between;
    for parent_is_first in [true, false] {
        let child = usize::from(parent_is_first);
        if !parent_is_first && name.starts_with("free") {
            continue; // its first body is the ground
        }
        let ends = |q: &Pair<f64, N>, between: Between| match between {
            Between::Both => *q,
            Between::GroundAndChild => [ground, q[child]],
        };
        let mut first = start;
        if name.starts_with("free") {
            first[0] = ground;
        }
        let mut references = Vec::new();
        let mut anchor = Anchor {
            orientation: kinematics.orientation(refs(&first), &first[child]),
            x: [0.0; 6],
        };
        let mut at = 0;
        for (e, between) in &coordinates {
            let q = ends(&first, *between);
            let reference = e.reference(refs(&q), &[0.0; 6]);
            for x in value((e, &reference), &q) {
                anchor.x[at] = x;
                at += 1;
            }
            references.push(reference);
        }
        for ((e, between), reference) in coordinates.iter().zip(&references) {
            let q = ends(moved, *between);
            let label = format!("{name}, {:?}, parent first: {parent_is_first}", e.kind());
            check_group(&label, e, reference, &q, random);
        }
        // A change of every coordinate, within reach.
        let mut x = anchor.x;
        x[..at]
            .iter_mut()
            .for_each(|x| *x += random.range(-0.9, 0.9) * if *x == 0.0 { 1.0 } else { 0.3 });
        let parent = first[1 - child];
        let stance = S::stance(&parent);
        let from = (&parent, &stance);
        let reference = kinematics.direction().map_or([0.0; 6], |own| references[own]);
        let (placed, stands) = kinematics.place(&x, &reference, &anchor, from, parent_is_first);
        assert_eq!(stands, S::stance(&placed), "{name}: how a placed body stands");
        let mut q = first;
        q[child] = placed;
        let mut found = Vec::new();
        for ((e, between), reference) in coordinates.iter().zip(&references) {
            found.extend(value((e, reference), &ends(&q, *between)));
        }
        for (k, (found, expected)) in found.iter().zip(&x).enumerate() {
            let turns = (found - expected) / std::f64::consts::TAU;
            let off = (found - expected).abs().min((turns - turns.round()).abs());
            assert!(off < 1e-12, "{name}, coordinate {k} of a placed body: {found} {expected}");
        }
    }
}

#[test]
fn spatial_coordinates_have_their_derivatives_and_place_bodies() {
    let mut random = Random::new(71);
    for _ in 0..10 {
        let frames = [random_frame(&mut random, 0.6), random_frame(&mut random, 0.6)];
        let centers = [[0.0; 3]; 2];
        let triads: [Triad<3>; 2] = triads(&frames, &centers);
        // Joints start assembled: frames at the same place, turned about h, or h across h.
        let assembled = |random: &mut Random, relative: &[f64; 4], slide: f64| {
            let mut q = poses(random, &frames, relative);
            let turned = |q: &[f64; 7], a: &[f64; 3]| {
                crate::math::spatial::rotate(&[q[3], q[4], q[5], q[6]], a)
            };
            let arms = [turned(&q[0], &triads[0].point), turned(&q[1], &triads[1].point)];
            let along = turned(&q[0], &triads[0].axes[2]);
            for k in 0..3 {
                q[1][k] = q[0][k] + arms[0][k] + slide * along[k] - arms[1][k];
            }
            q
        };
        let about_h = turn(&[0.0, 0.0, 1.0], random.range(-3.0, 3.0));
        let quarter = turn(&[1.0, 0.0, 0.0], 0.5 * std::f64::consts::PI);
        let crossed = product(&about_h, &quarter);
        let relative = any_turn(&mut random);
        for (name, kind, e, slide) in [
            ("fixed", JointKind::Fixed, [1.0, 0.0, 0.0, 0.0], 0.0),
            ("revolute", JointKind::Revolute, about_h, 0.0),
            ("translational", JointKind::Translational, [1.0, 0.0, 0.0, 0.0], 0.4),
            ("cylindrical", JointKind::Cylindrical, about_h, -0.3),
            ("universal", JointKind::Universal, crossed, 0.0),
            ("spherical", JointKind::Spherical, relative, 0.0),
            ("distance", JointKind::Distance { length: 0.7 }, relative, 0.7),
        ] {
            let start = assembled(&mut random, &e, slide);
            let moved = off_unit(&mut random, &start);
            let form = Spatial::joint_form(&kind, &triads);
            check_form(name, form, crate::elements::spatial::GROUND, start, &moved, &mut random);
        }
        let start = poses(&mut random, &frames, &relative);
        let other = any_turn(&mut random);
        let moved = poses(&mut random, &frames, &other);
        let ground = crate::elements::spatial::GROUND;
        check_form(
            "line",
            line_form::<Spatial, 3, 7, 4>(&triads, None),
            ground,
            start,
            &moved,
            &mut random,
        );
        check_form(
            "bushing",
            bushing_form::<Spatial, 3, 7, 4>(&triads),
            ground,
            start,
            &moved,
            &mut random,
        );
        check_form("free", free_form::<Spatial, 3, 7, 4>(), ground, start, &moved, &mut random);
    }
}

#[test]
fn planar_coordinates_have_their_derivatives_and_place_bodies() {
    let mut random = Random::new(72);
    for _ in 0..10 {
        let frames = [planar_frame(&mut random, 0.6), planar_frame(&mut random, 0.6)];
        let triads: [Triad<2>; 2] = triads(&frames, &[[0.0; 3]; 2]);
        let ground = crate::elements::planar::GROUND;
        let start = planar_poses(&mut random);
        let moved = planar_poses(&mut random);
        // Links start as they are: only the coordinates that a joint leaves free are compared.
        for (name, kind) in [("fixed", JointKind::Fixed), ("revolute", JointKind::Revolute)] {
            let form = Planar::joint_form(&kind, &triads);
            check_form(name, form, ground, start, &moved, &mut random);
        }
        let slide = Planar::joint_form(&JointKind::Translational, &triads);
        check_form("translational", slide, ground, start, &moved, &mut random);
        check_form(
            "line",
            line_form::<Planar, 2, 3, 1>(&triads, None),
            ground,
            start,
            &moved,
            &mut random,
        );
        check_form("free", free_form::<Planar, 2, 3, 1>(), ground, start, &moved, &mut random);
    }
}
