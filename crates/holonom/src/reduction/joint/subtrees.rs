//! Subtrees that several threads share.

use super::algebra::Algebra;
use super::engine::{Edge, Engine};
use crate::reduction::body_tree::parts_of_forest;
use crate::threads::Threads;
use std::ops::Range;

/// Bodies times the square of the length of their twists from which threads share the work: what two of them save, of the processor time
/// measured for binary trees of 3,000 bodies, is then twice the 20 µs that sharing adds.
const SHARED: usize = 20_000;

/// Edges that can be gone through at the same time, and those near the roots.
#[derive(Debug, Clone)]
pub(super) struct Subtrees {
    /// Of each part the subtrees hang on the same body, or on none.
    pub(super) parts: Vec<Range<usize>>,
    /// The others, ascending, and among them the first edges of the subtrees.
    pub(super) rest: Vec<Place>,
}

/// An edge where one thread comes by.
#[derive(Debug, Clone, Copy)]
pub(super) enum Place {
    /// In no part.
    Of(usize),
    /// First of a subtree, in a part.
    Top(usize),
}

impl Subtrees {
    /// None where too little is in them.
    fn new(edges: &[Edge]) -> Option<Self> {
        let parts = parts_of_forest(edges.len(), |at| edges[at].carrier);
        let mut rest = Vec::new();
        let mut end = 0;
        for part in &parts {
            rest.extend((end..part.start).map(Place::Of));
            let base = edges[part.start].carrier;
            let tops = part.clone().filter(|&at| edges[at].carrier == base);
            rest.extend(tops.map(Place::Top));
            end = part.end;
        }
        rest.extend((end..edges.len()).map(Place::Of));
        (!parts.is_empty()).then_some(Self { parts, rest })
    }
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// These threads share the work of trees that are large enough.
    pub(super) fn share_among(&mut self, threads: &Threads) {
        let large = threads.are_several() && self.edges.len() * W * W >= SHARED;
        let subtrees = if large { Subtrees::new(&self.edges) } else { None };
        self.subtrees = subtrees.map(|subtrees| (threads.clone(), subtrees.into()));
    }
}
