//! A joint or driver in either dimension: its rows, what they prescribe, its relative coordinates.

use super::angle::Angle;
use super::measure::Measure;
use super::motion::MotionRows;
use super::row::RowKind;
use super::space::{Space, Triad};
use super::{ConstraintElement, PairBlocks, Quantity, RowBlocks, product, set_first};
use crate::math::{Real, TimeFunction};

/// A joint (u = 0) or driver (u = s(t)) between two bodies.
///
/// Use it by its names [`planar::Constraint`](super::planar::Constraint) and
/// [`spatial::Constraint`](super::spatial::Constraint).
#[derive(Debug, Clone, PartialEq)]
pub struct Constraint<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> {
    rows: Rows<S, D, N, R>,
    kinds: &'static [RowKind],
    coordinates: Vec<Coordinate<S, D, N, R>>,
    quantities: &'static [Quantity],
    point_on_second: [f64; 3],
    motion: Option<TimeFunction>,
}

#[derive(Debug, Clone, PartialEq)]
enum Rows<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> {
    Measure(Measure<S, D, N, R>),
    Angle(S::Angle),
}

/// A relative coordinate that a joint leaves free.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Coordinate<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> {
    /// One row: displacement along an axis.
    Displacement(Measure<S, D, N, R>),
    /// Angle of the second frame from the first.
    Angle(S::Angle),
}

const fn scalar(name: &'static str, unit: &'static str) -> Quantity {
    Quantity { name, unit, frame: "", size: 1 }
}

const NONE: &[Quantity] = &[];
const TURNS: &[Quantity] = &[scalar("angle", "rad"), scalar("rate", "rad/s")];
const SLIDES: &[Quantity] = &[scalar("displacement", "m"), scalar("rate", "m/s")];
const SLIDES_AND_TURNS: &[Quantity] = &[
    scalar("displacement", "m"),
    scalar("displacement_rate", "m/s"),
    scalar("angle", "rad"),
    scalar("angle_rate", "rad/s"),
];

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> Constraint<S, D, N, R> {
    /// A joint with one kind per row of its measure.
    pub(super) fn of_joint(
        frames: &[Triad<D>; 2],
        measure: Measure<S, D, N, R>,
        kinds: &'static [RowKind],
        coordinates: Vec<Coordinate<S, D, N, R>>,
    ) -> Self {
        debug_assert_eq!(measure.rows(), kinds.len());
        let quantities = match coordinates.as_slice() {
            [] => NONE,
            [Coordinate::Angle(_)] => TURNS,
            [Coordinate::Displacement(_)] => SLIDES,
            _ => SLIDES_AND_TURNS,
        };
        let rows = Rows::Measure(measure);
        Self { rows, kinds, coordinates, quantities, point_on_second: point(frames), motion: None }
    }

    /// A driver of the coordinate `driven`.
    pub(super) fn of_driver(
        frames: &[Triad<D>; 2],
        driven: Coordinate<S, D, N, R>,
        kinds: &'static [RowKind],
        motion: TimeFunction,
    ) -> Self {
        let rows = match driven {
            Coordinate::Displacement(measure) => Rows::Measure(measure),
            Coordinate::Angle(angle) => Rows::Angle(angle),
        };
        Self {
            rows,
            kinds,
            coordinates: Vec::new(),
            quantities: NONE,
            point_on_second: point(frames),
            motion: Some(motion),
        }
    }
}

fn point<const D: usize>(frames: &[Triad<D>; 2]) -> [f64; 3] {
    let mut point = [0.0; 3];
    point[..D].copy_from_slice(&frames[1].point);
    point
}

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> ConstraintElement<N>
    for Constraint<S, D, N, R>
{
    fn rows(&self) -> usize {
        self.kinds.len()
    }

    fn row_kind(&self, row: usize) -> RowKind {
        self.kinds[row]
    }

    fn value<T: Real>(&self, q: [&[T; N]; 2], u: &mut [T; 6]) {
        match &self.rows {
            Rows::Measure(measure) => measure.value(q, u),
            Rows::Angle(angle) => {
                *u = [T::zero(); 6];
                u[0] = angle.value(q);
            }
        }
    }

    fn jacobian<T: Real>(&self, q: [&[T; N]; 2], out: &mut RowBlocks<T, N>) {
        match &self.rows {
            Rows::Measure(measure) => measure.jacobian(q, out),
            Rows::Angle(angle) => {
                *out = RowBlocks::zero();
                out.set(0, &angle.gradient(q));
            }
        }
    }

    fn directional<T: Real>(&self, q: [&[T; N]; 2], w: [&[T; N]; 2], out: &mut RowBlocks<T, N>) {
        match &self.rows {
            Rows::Measure(measure) => measure.directional(q, w, out),
            Rows::Angle(angle) => {
                *out = RowBlocks::zero();
                out.set(0, &angle.directional(q, w));
            }
        }
    }

    fn rate<T: Real>(&self, q: [&[T; N]; 2], v: [&[T; N]; 2], out: &mut [T; 6]) {
        match &self.rows {
            Rows::Measure(measure) => measure.rate(q, v, out),
            Rows::Angle(angle) => {
                *out = [T::zero(); 6];
                out[0] = product(&angle.gradient(q), v);
            }
        }
    }

    #[inline(always)]
    fn value_and_rates<T: Real>(
        &self,
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
        a: [&[T; N]; 2],
    ) -> [[T; 6]; 3] {
        match &self.rows {
            Rows::Measure(measure) => measure.value_and_rates(q, v, a),
            Rows::Angle(angle) => {
                let gradient = angle.gradient(q);
                let second = product(&gradient, a) + angle.curvature(q, v);
                let mut u = [[T::zero(); 6]; 3];
                (u[0][0], u[1][0], u[2][0]) = (angle.value(q), product(&gradient, v), second);
                u
            }
        }
    }

    fn curvature<T: Real>(&self, q: [&[T; N]; 2], v: [&[T; N]; 2], out: &mut [T; 6]) {
        match &self.rows {
            Rows::Measure(measure) => measure.curvature(q, v, out),
            Rows::Angle(angle) => {
                *out = [T::zero(); 6];
                out[0] = angle.curvature(q, v);
            }
        }
    }

    #[inline(always)]
    fn rate_blocks<T: Real>(
        &self,
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
        a: [&[T; N]; 2],
        out: &mut [RowBlocks<T, N>; 2],
    ) {
        match &self.rows {
            Rows::Measure(measure) => {
                measure.rate_blocks(q, v, a, out);
            }
            Rows::Angle(angle) => set_first(&angle.rate_blocks(q, v, a), out),
        }
    }

    #[inline(always)]
    fn hessian<T: Real>(&self, q: [&[T; N]; 2], c: &[T; 6], out: &mut PairBlocks<T, N>) {
        *out = PairBlocks::zero();
        match &self.rows {
            Rows::Measure(measure) => measure.add_hessian(q, c, out),
            Rows::Angle(angle) => angle.add_hessian(q, c[0], out),
        }
    }

    fn couples(&self) -> bool {
        match &self.rows {
            Rows::Measure(measure) => measure.couples(),
            Rows::Angle(_) => true,
        }
    }

    fn drive(&self, t: f64) -> Option<[f64; 4]> {
        self.motion.as_ref().map(|motion| motion.derivatives(t))
    }

    fn is_driven(&self) -> bool {
        self.motion.as_ref().is_some_and(|motion| !matches!(motion, TimeFunction::Constant(_)))
    }

    fn on_motions(&self) -> Option<&dyn MotionRows> {
        match &self.rows {
            Rows::Measure(measure) => Some(measure),
            Rows::Angle(_) => None,
        }
    }

    fn wraps(&self) -> bool {
        matches!(self.rows, Rows::Angle(_))
    }

    fn point_on_second(&self) -> [f64; 3] {
        self.point_on_second
    }

    fn quantities(&self) -> &'static [Quantity] {
        self.quantities
    }

    fn counts_turns(&self) -> bool {
        S::Angle::COUNTS_TURNS && self.coordinates.iter().any(|c| matches!(c, Coordinate::Angle(_)))
    }

    fn angle(&self, q: [&[f64; N]; 2], winding: f64) -> f64 {
        let angle = |c: &Coordinate<S, D, N, R>| match c {
            Coordinate::Angle(angle) => Some(angle.nearest(q, winding)),
            Coordinate::Displacement(_) => None,
        };
        self.coordinates.iter().find_map(angle).unwrap_or(0.0)
    }

    fn quantity(
        &self,
        index: usize,
        q: [&[f64; N]; 2],
        v: [&[f64; N]; 2],
        winding: f64,
        out: &mut [f64],
    ) {
        let rate = index % 2 == 1;
        out[0] = match &self.coordinates[index / 2] {
            Coordinate::Displacement(measure) if rate => {
                let mut rows = RowBlocks::zero();
                measure.jacobian(q, &mut rows);
                product(&[rows.0[0][0], rows.0[1][0]], v)
            }
            Coordinate::Displacement(measure) => {
                let mut u = [0.0; 6];
                measure.value(q, &mut u);
                u[0]
            }
            Coordinate::Angle(angle) if rate => product(&angle.gradient(q), v),
            Coordinate::Angle(angle) => angle.nearest(q, winding),
        };
    }
}
