//! Every block of every element against differences and dual numbers, and laws that hold for all.

mod balance;
mod constraints;
mod forces;
mod limits;
mod motion;
mod relative;

use std::f64::consts::PI;

use num_dual::Dual64;

use crate::math::planar;
use crate::math::spatial::{conjugate, euler_parameters, product};
use crate::model::Frame;
use crate::testing::{Random, richardson};

/// Both poses, or rates of them, as one vector.
type Pair<T, const N: usize> = [[T; N]; 2];

fn refs<T, const N: usize>(q: &Pair<T, N>) -> [&[T; N]; 2] {
    [&q[0], &q[1]]
}

fn lifted<const N: usize>(q: &Pair<f64, N>) -> Pair<Dual64, N> {
    q.map(|row| row.map(Dual64::from))
}

/// q + s e_column
fn moved<const N: usize>(q: &Pair<f64, N>, column: usize, s: f64) -> Pair<f64, N> {
    let mut out = *q;
    out[column / N][column % N] += s;
    out
}

fn seeded<const N: usize>(q: &Pair<f64, N>, column: usize) -> Pair<Dual64, N> {
    let mut out = lifted(q);
    out[column / N][column % N].eps = 1.0;
    out
}

/// Derivatives of `f` by columns: analytic against differences or dual numbers.
struct Checked<'a> {
    name: &'a str,
    /// rows × columns
    analytic: Vec<Vec<f64>>,
    /// Largest entry of f, the measure where the block vanishes.
    size: f64,
}

impl Checked<'_> {
    #[track_caller]
    fn against(&self, column: usize, expected: &[f64], tolerance: f64) {
        let largest = self.analytic.iter().flatten().fold(0.0_f64, |m, x| m.max(x.abs()));
        let allowed = tolerance * if largest > 0.0 { largest } else { self.size.max(1.0) };
        for (row, &expected) in expected.iter().enumerate() {
            let found = self.analytic[row][column];
            assert!(
                (found - expected).abs() <= allowed,
                "{}: ({row}, {column}) is {found:.12e}, not {expected:.12e}; allowed {allowed:.1e}",
                self.name
            );
        }
    }
}

/// Checks `analytic[row][column]` = ∂f_row/∂x_column, x the entries of `at`, by both means.
#[track_caller]
fn check_block<const N: usize>(
    name: &str,
    at: &Pair<f64, N>,
    h: f64,
    analytic: Vec<Vec<f64>>,
    plain: impl Fn(&Pair<f64, N>) -> Vec<f64>,
    dual: impl Fn(&Pair<Dual64, N>) -> Vec<Dual64>,
) {
    let size = plain(at).iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let checked = Checked { name, analytic, size };
    for column in 0..2 * N {
        checked.against(column, &richardson(h, |s| plain(&moved(at, column, s))), 1e-7);
        let exact: Vec<f64> = dual(&seeded(at, column)).iter().map(|x| x.eps).collect();
        checked.against(column, &exact, 1e-12);
    }
}

/// Orthonormal axes, `axes[row][column]`.
fn random_axes(random: &mut Random) -> [[f64; 3]; 3] {
    crate::math::spatial::rotation_matrix(&random.unit::<4>())
}

fn random_frame(random: &mut Random, size: f64) -> Frame {
    let point = random.array(size);
    Frame { body: Some(0), point, axes: random_axes(random) }
}

fn planar_frame(random: &mut Random, size: f64) -> Frame {
    let [x, y] = random.array(size);
    let angle = random.range(-PI, PI);
    let ([a, b], [c, d]) = (planar::rotate(angle, &[1.0, 0.0]), planar::rotate(angle, &[0.0, 1.0]));
    Frame { body: Some(0), point: [x, y, 0.0], axes: [[a, c, 0.0], [b, d, 0.0], [0.0, 0.0, 1.0]] }
}

/// Euler parameters of a rotation about an axis.
fn turn(axis: &[f64; 3], angle: f64) -> [f64; 4] {
    let (s, c) = (0.5 * angle).sin_cos();
    [c, s * axis[0], s * axis[1], s * axis[2]]
}

/// Poses whose frames differ by the rotation `relative` (first frame's axes), at random places.
fn poses(random: &mut Random, frames: &[Frame; 2], relative: &[f64; 4]) -> Pair<f64, 7> {
    let first = random.unit::<4>();
    let [ci, cj] = [0, 1].map(|side| euler_parameters(&frames[side].axes));
    let second = product(&product(&product(&first, &ci), relative), &conjugate(&cj));
    [first, second].map(|p| {
        let mut q = [0.0; 7];
        q[..3].copy_from_slice(&random.array::<3>(1.0));
        q[3..].copy_from_slice(&p);
        q
    })
}

/// Takes Euler parameters off |p| = 1: derivatives must hold there too.
fn off_unit(random: &mut Random, q: &Pair<f64, 7>) -> Pair<f64, 7> {
    q.map(|mut row| {
        let factor = random.range(0.9, 1.1);
        row[3..].iter_mut().for_each(|x| *x *= factor);
        row
    })
}

/// A relative rotation of up to nearly 3 rad about any axis.
fn any_turn(random: &mut Random) -> [f64; 4] {
    turn(&random.unit(), random.range(-2.95, 2.95))
}

/// A relative rotation of up to nearly 3 rad about h, then a tilt of up to 0.4 rad.
fn axial_turn(random: &mut Random) -> [f64; 4] {
    let about_h = turn(&[0.0, 0.0, 1.0], random.range(-2.95, 2.95));
    product(&turn(&random.unit(), random.range(0.0, 0.4)), &about_h)
}

fn random_pair<const N: usize>(random: &mut Random, size: f64) -> Pair<f64, N> {
    [random.array(size), random.array(size)]
}

/// Planar poses with angles of up to several turns.
fn planar_poses(random: &mut Random) -> Pair<f64, 3> {
    let [a, b, c, d] = random.array(1.0);
    [[a, b, random.range(-7.0, 7.0)], [c, d, random.range(-7.0, 7.0)]]
}

/// Shortest arm of the frames, the length that differences are scaled by.
fn smallest_length(frames: &[Frame; 2]) -> f64 {
    frames.iter().fold(1.0, |least: f64, frame| {
        least.min(frame.point.iter().map(|x| x * x).sum::<f64>().sqrt())
    })
}
