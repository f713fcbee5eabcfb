//! Orders of blocks with a small envelope, and one with little fill to compare with.
//!
//! An order names the block at each position. All are deterministic: ties go to the smaller degree,
//! then to the smaller number.

use super::graph::{BlockGraph, eliminate};
use std::cmp::Reverse;
use std::collections::{BTreeSet, VecDeque};

/// Reverse Cuthill-McKee: breadth first from an end of each component, neighbours by degree, all
/// reversed.
///
/// Source: E. Cuthill, J. McKee (1969); A. George, J. W. Liu, *Computer Solution of Large Sparse Positive
/// Definite Systems* (1981), chapter 4, also for the start.
pub fn reverse_cuthill_mckee(graph: &BlockGraph) -> Vec<usize> {
    let mut order = Vec::with_capacity(graph.len());
    for_each_component(graph, |start| {
        let (mut from, mut levels) = (start, Levels::new(graph, start));
        loop {
            let last = levels.sets.last().expect("the start is in a level");
            let other = *last.iter().min_by_key(|&&v| graph.degree(v)).expect("no empty level");
            let others = Levels::new(graph, other);
            if others.sets.len() <= levels.sets.len() {
                break;
            }
            (from, levels) = (other, others);
        }
        let mut seen = BTreeSet::from([from]);
        let mut waiting = VecDeque::from([from]);
        while let Some(v) = waiting.pop_front() {
            order.push(v);
            let mut next: Vec<usize> =
                graph.neighbours(v).iter().copied().filter(|w| !seen.contains(w)).collect();
            next.sort_by_key(|&w| graph.degree(w));
            seen.extend(&next);
            waiting.extend(&next);
        }
        seen
    });
    order.reverse();
    order
}

/// Gibbs-King: the levels of Gibbs, Poole and Stockmeyer between two ends of each component, numbered by
/// King's least growth of the front; of the order and its reverse the one with fewer operations.
///
/// Source: N. E. Gibbs, ACM Trans. Math. Softw. 2 (1976), algorithm 509; J. G. Lewis, *Implementation of
/// the Gibbs-Poole-Stockmeyer and Gibbs-King algorithms*, ACM Trans. Math. Softw. 8 (1982).
pub fn gibbs_king(graph: &BlockGraph) -> Vec<usize> {
    let mut order = Vec::with_capacity(graph.len());
    for_each_component(graph, |start| {
        let (first, last) = ends(graph, start);
        let mut levels = between(graph, &first, &last);
        if graph.degree(last.root) < graph.degree(first.root) {
            levels.reverse();
        }
        let from = order.len();
        number(graph, &levels, &mut order);
        let part = &mut order[from..];
        let forward = front_work(graph, part);
        part.reverse();
        if forward <= front_work(graph, part) {
            part.reverse();
        }
        levels.into_iter().flatten().collect()
    });
    order
}

/// Minimum degree: at each step the block with the fewest neighbours left. Good for storage of single
/// blocks, not for an envelope: [`BlockGraph::factor_widths`] tells what these are.
pub fn least_degree(graph: &BlockGraph) -> Vec<usize> {
    let mut rest: Vec<BTreeSet<usize>> =
        (0..graph.len()).map(|i| graph.neighbours(i).iter().copied().collect()).collect();
    let mut queue: BTreeSet<(usize, usize)> =
        (0..graph.len()).map(|i| (rest[i].len(), i)).collect();
    let mut order = Vec::with_capacity(graph.len());
    while let Some((_, i)) = queue.pop_first() {
        let around: Vec<usize> = rest[i].iter().copied().collect();
        for &j in &around {
            queue.remove(&(rest[j].len(), j));
        }
        eliminate(&mut rest, i);
        queue.extend(around.iter().map(|&j| (rest[j].len(), j)));
        order.push(i);
    }
    order
}

/// The best of the order as given, Gibbs-King and reverse Cuthill-McKee, by the bound of their block
/// operations.
pub fn least_envelope(graph: &BlockGraph) -> Vec<usize> {
    let work =
        |order: &Vec<usize>| graph.widths(order).into_iter().map(|b| b * (b + 3)).sum::<usize>();
    let given: Vec<usize> = (0..graph.len()).collect();
    let orders = [given, gibbs_king(graph), reverse_cuthill_mckee(graph)];
    orders.into_iter().min_by_key(work).expect("three orders")
}

/// Calls `visit` with a block of least degree of each component; it returns what it has visited.
fn for_each_component(graph: &BlockGraph, mut visit: impl FnMut(usize) -> BTreeSet<usize>) {
    let mut by_degree: Vec<usize> = (0..graph.len()).collect();
    by_degree.sort_by_key(|&v| graph.degree(v));
    let mut done = BTreeSet::new();
    for v in by_degree {
        if !done.contains(&v) {
            done.extend(visit(v));
        }
    }
}

/// Vertices by their distance from a root.
struct Levels {
    root: usize,
    sets: Vec<Vec<usize>>,
}

impl Levels {
    fn new(graph: &BlockGraph, root: usize) -> Self {
        let mut seen = BTreeSet::from([root]);
        let mut sets = vec![vec![root]];
        loop {
            let last = &sets[sets.len() - 1];
            let next: BTreeSet<usize> = (last.iter().flat_map(|&v| graph.neighbours(v)))
                .copied()
                .filter(|w| !seen.contains(w))
                .collect();
            if next.is_empty() {
                return Self { root, sets };
            }
            seen.extend(&next);
            sets.push(next.into_iter().collect());
        }
    }

    fn width(&self) -> usize {
        self.sets.iter().map(Vec::len).max().unwrap_or(0)
    }

    /// Level of each vertex of the component.
    fn of(&self, count: usize) -> Vec<usize> {
        let mut level = vec![usize::MAX; count];
        for (k, set) in self.sets.iter().enumerate() {
            set.iter().for_each(|&v| level[v] = k);
        }
        level
    }
}

/// The two ends of a pseudo-diameter with their levels.
fn ends(graph: &BlockGraph, start: usize) -> (Levels, Levels) {
    let mut first = Levels::new(graph, start);
    'deeper: loop {
        let mut far = first.sets.last().expect("the start is in a level").clone();
        far.sort_by_key(|&v| graph.degree(v));
        let mut last: Option<Levels> = None;
        for v in far {
            let levels = Levels::new(graph, v);
            if levels.sets.len() > first.sets.len() {
                first = levels;
                continue 'deeper;
            }
            if last.as_ref().is_none_or(|best| levels.width() < best.width()) {
                last = Some(levels);
            }
        }
        return (first, last.expect("no empty level"));
    }
}

/// Levels that are narrow seen from both ends: a vertex whose two distances agree has its place; of the
/// others each connected group goes where the widest level stays narrower.
fn between(graph: &BlockGraph, first: &Levels, last: &Levels) -> Vec<Vec<usize>> {
    let depth = first.sets.len();
    let (near, far) = (first.of(graph.len()), last.of(graph.len()));
    let pair = |v: usize| [near[v], depth - 1 - far[v].min(depth - 1)];
    let mut levels = vec![Vec::new(); depth];
    let mut open = BTreeSet::new();
    for &v in first.sets.iter().flatten() {
        let [a, b] = pair(v);
        if a == b {
            levels[a].push(v);
        } else {
            open.insert(v);
        }
    }
    let mut groups = Vec::new();
    while let Some(v) = open.pop_first() {
        let mut group = vec![v];
        let mut at = 0;
        while at < group.len() {
            for w in graph.neighbours(group[at]) {
                if open.remove(w) {
                    group.push(*w);
                }
            }
            at += 1;
        }
        groups.push(group);
    }
    groups.sort_by_key(|group| Reverse(group.len()));
    for group in groups {
        let widest = |side: usize| {
            let mut width: Vec<usize> = levels.iter().map(Vec::len).collect();
            group.iter().for_each(|&v| width[pair(v)[side]] += 1);
            group.iter().map(|&v| width[pair(v)[side]]).max().unwrap_or(0)
        };
        let key = [(widest(0), first.width()), (widest(1), last.width())];
        let side = usize::from(key[1] < key[0]);
        group.iter().for_each(|&v| levels[pair(v)[side]].push(v));
    }
    levels
}

/// Numbers level by level; next comes what lets the front grow least, then what is in it longest.
fn number(graph: &BlockGraph, levels: &[Vec<usize>], order: &mut Vec<usize>) {
    // When each vertex came into the front: next to something numbered.
    let mut entered = vec![usize::MAX; graph.len()];
    let mut numbered = vec![false; graph.len()];
    let mut time = 0;
    for level in levels {
        let mut left: BTreeSet<usize> = level.iter().copied().collect();
        while let Some(&v) = left.iter().min_by_key(|&&v| {
            let new = graph.neighbours(v).iter().filter(|&&w| entered[w] == usize::MAX).count();
            (new + usize::from(entered[v] == usize::MAX), entered[v], graph.degree(v))
        }) {
            left.remove(&v);
            numbered[v] = true;
            order.push(v);
            for &w in std::iter::once(&v).chain(graph.neighbours(v)) {
                if entered[w] == usize::MAX && (w == v || !numbered[w]) {
                    entered[w] = time;
                    time += 1;
                }
            }
        }
    }
}

/// Twice the bound of block operations of one component in this order.
fn front_work(graph: &BlockGraph, order: &[usize]) -> usize {
    let mut position = vec![usize::MAX; graph.len()];
    order.iter().enumerate().for_each(|(p, &v)| position[v] = p);
    let width = |(p, &v): (usize, &usize)| {
        let first = graph.neighbours(v).iter().map(|&w| position[w]).min().unwrap_or(p);
        p - first.min(p)
    };
    order.iter().enumerate().map(width).map(|b| b * (b + 3)).sum()
}
