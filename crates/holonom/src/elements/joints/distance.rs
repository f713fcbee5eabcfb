use super::points;
use crate::elements::constraint::Constraint;
use crate::elements::measure::{Dot, Measure};
use crate::elements::row::RowKind::Distance;
use crate::elements::space::{Space, Triad};

/// Distance joint, planar or spatial: the points keep a distance C > 0.
///
/// ```text
/// (dᵀd − C²) / (2 C) = 0     1 row, m: to first order the error of the distance
/// ```
///
/// Source: Haug (1989), 3.3 and 9.4, scaled to metres.
pub(in crate::elements) fn of_any_dimension<S, const D: usize, const N: usize, const R: usize>(
    frames: &[Triad<D>; 2],
    length: f64,
) -> Constraint<S, D, N, R>
where
    S: Space<D, N, R>,
{
    let measure = Measure::new(points(frames), false, vec![Dot::distance(length)]);
    Constraint::of_joint(frames, measure, &[Distance], Vec::new())
}
