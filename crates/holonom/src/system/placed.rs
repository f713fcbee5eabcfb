//! Elements and bodies with their places in the equations.

use super::ExtraBlock;
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
    pub(super) extra: ExtraBlock,
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

/// Elements, by their numbers.
#[derive(Debug, Clone, Default)]
pub(super) struct Elements {
    pub(super) constraints: Vec<u32>,
    pub(super) forces: Vec<u32>,
}

/// Bodies that stand together in the walk along the forest, with the elements among them: blocks of G, K and C
/// with one of these bodies and none that comes later stand together too.
#[derive(Debug, Clone)]
pub(super) struct Part {
    pub(super) elements: Elements,
    /// Where its bodies end in the walk, and its blocks among the values of K or C and of G.
    pub(super) end: [usize; 3],
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
    /// Bodies in the order of a walk along the forest, and the place of each.
    pub(super) walk: Vec<u32>,
    pub(super) position: Vec<u32>,
    /// What can be evaluated at the same time, and what comes after that: elements between bodies of
    /// different parts.
    pub(super) parts: Vec<Part>,
    pub(super) rest: Elements,
}
