//! Elements and bodies with their places in the equations.

use super::turns::Turns;
use holonom_linalg::BlockId;

/// A joint or driver between two bodies with its place in the equations.
#[derive(Debug, Clone)]
pub(super) struct PlacedConstraint<C> {
    pub(super) name: String,
    pub(super) kind: &'static str,
    pub(super) element: C,
    pub(super) bodies: [Option<usize>; 2],
    pub(super) row: usize,
    /// Kinks of a driver's motion, s.
    pub(super) breakpoints: Vec<f64>,
    /// Of a joint whose angle counts turns.
    pub(super) turns: Option<Turns>,
}

/// A force between two bodies with its place in the equations.
#[derive(Debug, Clone)]
pub(super) struct PlacedForce<F> {
    pub(super) name: String,
    pub(super) element: F,
    pub(super) bodies: [Option<usize>; 2],
    pub(super) extra: Option<usize>,
    pub(super) turns: Option<Turns>,
}

/// Numbers of one body.
#[derive(Debug, Clone)]
pub(super) struct PlacedBody {
    pub(super) name: String,
    pub(super) mass: f64,
    pub(super) inertia: [[f64; 3]; 3],
    pub(super) center: [f64; 3],
    pub(super) markers: Vec<(String, [f64; 3])>,
}

/// Block numbers of the elements in the patterns of [`Structure`].
#[derive(Debug, Clone, Default)]
pub(super) struct Slots {
    /// Per constraint and side: block of G.
    pub(super) jacobian: Vec<[Option<BlockId>; 2]>,
    /// Per constraint and pair of sides: block of K.
    pub(super) constraint_pairs: Vec<[[Option<BlockId>; 2]; 2]>,
    /// Per force and pair of sides: block of K and C.
    pub(super) force_pairs: Vec<[[Option<BlockId>; 2]; 2]>,
    /// Per body: diagonal block of K and C.
    pub(super) diagonal: Vec<BlockId>,
    /// Per body: translational and rotational block of M.
    pub(super) mass: Vec<[BlockId; 2]>,
    /// Per body: normalisation block of G.
    pub(super) normalization: Vec<BlockId>,
}
