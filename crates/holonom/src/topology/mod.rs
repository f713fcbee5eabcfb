//! Graph of bodies and what ties them, without numbers of its own: a spanning forest by the weights passed
//! in, the edges it leaves out, components.

use crate::model::BodyIndex;
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// What two bodies are tied by, in the order in which edges are taken into the forest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// First and second body.
    pub ends: [BodyIndex; 2],
    /// Smaller first: the number of relative coordinates of a joint, then distance joints, then forces;
    /// [`Edge::CUT`] is never taken.
    pub class: u32,
    /// Within a class larger first: for forces the square of a frequency, 1/s².
    pub strength: f64,
}

impl Edge {
    /// Class of an edge that closes a loop, whatever else there is.
    pub const CUT: u32 = u32::MAX;
}

/// A spanning forest, rooted at the ground.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "StoredForest")]
pub struct Forest {
    /// Edge that ties each body to its parent; `None` at the root of a component that nothing ties to
    /// the ground.
    pub edge: Vec<Option<usize>>,
    /// Parent of each body.
    pub parent: Vec<BodyIndex>,
    /// Bodies, parents before children.
    pub order: Vec<usize>,
    /// Edges between each body and the ground on the way through the forest.
    pub depth: Vec<usize>,
    /// Edges outside the forest: each closes a loop.
    pub cuts: Vec<usize>,
}

/// A forest as it was stored, perhaps of another graph.
#[derive(Deserialize)]
struct StoredForest {
    edge: Vec<Option<usize>>,
    parent: Vec<BodyIndex>,
    order: Vec<usize>,
    cuts: Vec<usize>,
}

impl TryFrom<StoredForest> for Forest {
    type Error = &'static str;

    fn try_from(stored: StoredForest) -> Result<Self, Self::Error> {
        let StoredForest { edge, parent, order, cuts } = stored;
        let edges = edge.iter().flatten().count() + cuts.len();
        Self::known(edge, parent, order, edges).ok_or("this is no spanning forest")
    }
}

/// An edge that could be taken next; the greatest is.
#[derive(PartialEq)]
struct Candidate {
    class: u32,
    strength: f64,
    depth: usize,
    edge: usize,
    body: usize,
    parent: BodyIndex,
}

impl Eq for Candidate {}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        (other.class.cmp(&self.class))
            .then(self.strength.total_cmp(&other.strength))
            .then(other.depth.cmp(&self.depth))
            .then(other.edge.cmp(&self.edge))
            .then(other.body.cmp(&self.body))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Forest {
    /// The forest of `weights.len()` bodies. A component that no edge ties to the ground has its heaviest
    /// body as root. Among edges of the same class and strength the one nearer to the root is taken, then
    /// the earlier one: Prim's algorithm, O(N log N).
    pub fn new(weights: &[f64], edges: &[Edge]) -> Self {
        let count = weights.len();
        let mut at = vec![Vec::new(); count];
        let mut from_ground = Vec::new();
        for (k, edge) in edges.iter().enumerate() {
            for end in edge.ends {
                match end {
                    Some(body) => at[body].push(k),
                    None => from_ground.push(k),
                }
            }
        }
        let mut out = Self {
            edge: vec![None; count],
            parent: vec![None; count],
            order: Vec::with_capacity(count),
            depth: vec![0; count],
            cuts: Vec::new(),
        };
        let mut reached = vec![false; count];
        let mut used = vec![false; edges.len()];
        let mut heap = BinaryHeap::new();
        let offer = |heap: &mut BinaryHeap<Candidate>, parent: BodyIndex, depth, list: &[usize]| {
            for &k in list {
                let Edge { ends, class, strength } = edges[k];
                let other = if ends[0] == parent { ends[1] } else { ends[0] };
                if let Some(body) = other.filter(|_| ends[0] != ends[1] && class != Edge::CUT) {
                    heap.push(Candidate { class, strength, depth, edge: k, body, parent });
                }
            }
        };
        offer(&mut heap, None, 0, &from_ground);
        let mut by_weight: Vec<usize> = (0..count).collect();
        by_weight.sort_by(|&a, &b| weights[b].total_cmp(&weights[a]).then(a.cmp(&b)));
        let mut roots = by_weight.into_iter();
        loop {
            while let Some(next) = heap.pop() {
                if reached[next.body] {
                    continue;
                }
                reached[next.body] = true;
                used[next.edge] = true;
                out.edge[next.body] = Some(next.edge);
                out.parent[next.body] = next.parent;
                out.depth[next.body] = next.depth + 1;
                out.order.push(next.body);
                offer(&mut heap, Some(next.body), next.depth + 1, &at[next.body]);
            }
            let Some(root) = roots.find(|&b| !reached[b]) else { break };
            reached[root] = true;
            out.depth[root] = 1;
            out.order.push(root);
            offer(&mut heap, Some(root), 1, &at[root]);
        }
        out.cuts = (0..edges.len()).filter(|&k| !used[k]).collect();
        out
    }

    /// The forest that was found before for the same graph of `edges` edges, from the edge and the parent of
    /// each body and the order of the bodies; `None` if it is none.
    pub fn known(
        edge: Vec<Option<usize>>,
        parent: Vec<BodyIndex>,
        order: Vec<usize>,
        edges: usize,
    ) -> Option<Self> {
        let count = edge.len();
        let mut depth = vec![0; count];
        let mut used = vec![false; edges];
        for &body in &order {
            if body >= count || depth[body] > 0 || parent.len() != count {
                return None;
            }
            let above = match parent[body] {
                Some(parent) => *depth.get(parent).filter(|depth| **depth > 0)?,
                None => 0,
            };
            depth[body] = above + 1;
            if let Some(edge) = edge[body]
                && std::mem::replace(used.get_mut(edge)?, true)
            {
                return None;
            }
        }
        let cuts = (0..edges).filter(|&k| !used[k]).collect();
        (order.len() == count).then_some(Self { edge, parent, order, depth, cuts })
    }

    /// All bodies, each with those that hang on it right behind, few before many: neighbours are near.
    pub fn walk(&self) -> Vec<usize> {
        let mut sizes = vec![1; self.parent.len()];
        for &body in self.order.iter().rev() {
            if let Some(parent) = self.parent[body] {
                sizes[parent] += sizes[body];
            }
        }
        let mut children = vec![Vec::new(); self.parent.len()];
        let mut left = Vec::new();
        for &body in &self.order {
            self.parent[body].map_or(&mut left, |parent| &mut children[parent]).push(body);
        }
        left.reverse();
        let mut walk = Vec::with_capacity(self.parent.len());
        while let Some(body) = left.pop() {
            walk.push(body);
            children[body].sort_by_key(|&child| std::cmp::Reverse(sizes[child]));
            left.append(&mut children[body]);
        }
        walk
    }

    /// Number of edges of the graph.
    pub fn edges(&self) -> usize {
        self.cuts.len() + self.edge.iter().flatten().count()
    }

    /// The body at the outer end of the edge that ties two bodies, if one of them hangs on the other.
    pub fn outer(&self, ends: [BodyIndex; 2]) -> Option<usize> {
        let [a, b] = ends;
        let hangs = |body: BodyIndex, on| body.filter(|&body| self.parent[body] == on);
        hangs(a, b).or(hangs(b, a))
    }
}

/// Pairs of edges (the smaller number first, ascending) that share a body: the graph in which edges are
/// vertices. The ground is no body; one with k edges makes them a clique of k(k − 1)/2 pairs.
pub fn sharing_a_body(count: usize, ends: &[[BodyIndex; 2]]) -> Vec<[usize; 2]> {
    let mut at = vec![Vec::new(); count];
    for (k, ends) in ends.iter().enumerate() {
        for body in ends.iter().flatten() {
            at[*body].push(k);
        }
    }
    let pairs = |list: &Vec<usize>| -> Vec<[usize; 2]> {
        let later = |(n, &i): (usize, &usize)| list[n + 1..].iter().map(move |&j| [i, j]).collect();
        list.iter().enumerate().flat_map::<Vec<_>, _>(later).filter(|[i, j]| i != j).collect()
    };
    let mut out: Vec<[usize; 2]> = at.iter().flat_map(pairs).collect();
    out.sort_unstable();
    out.dedup();
    out
}

/// What a graph is like, whatever its weights.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shape {
    /// Number of independent loops.
    pub loops: usize,
    /// Groups of bodies that no edge ties to the ground.
    pub floating: Vec<Vec<usize>>,
}

impl Shape {
    /// The shape of the graph of `count` bodies with edges between these ends.
    pub fn new(count: usize, ends: &[[BodyIndex; 2]]) -> Self {
        let edges: Vec<Edge> =
            ends.iter().map(|ends| Edge { ends: *ends, class: 0, strength: 0.0 }).collect();
        let forest = Forest::new(&vec![0.0; count], &edges);
        let mut group = vec![None; count];
        let mut floating: Vec<Vec<usize>> = Vec::new();
        for &body in &forest.order {
            group[body] = match (forest.edge[body], forest.parent[body]) {
                (None, _) => {
                    floating.push(Vec::new());
                    Some(floating.len() - 1)
                }
                (Some(_), parent) => parent.and_then(|p| group[p]),
            };
            if let Some(k) = group[body] {
                floating[k].push(body);
            }
        }
        Self { loops: forest.cuts.len(), floating }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edge(ends: [BodyIndex; 2], class: u32, strength: f64) -> Edge {
        Edge { ends, class, strength }
    }

    #[test] // independent truth: Euler's count of independent cycles by hand
    fn a_four_bar_has_one_loop_and_a_free_body_is_a_component_of_its_own() {
        let (ground, a, b, c) = (None, Some(0), Some(1), Some(2));
        let shape = |loops, floating| Shape { loops, floating };
        assert_eq!(Shape::new(3, &[[ground, a], [a, b]]), shape(0, vec![vec![2]]));
        assert_eq!(Shape::new(3, &[[a, b]]), shape(0, vec![vec![0, 1], vec![2]]));
        assert_eq!(Shape::new(3, &[[ground, a], [a, b], [b, c], [c, ground]]), shape(1, vec![]));
        // Two joints between the same bodies close a loop, too.
        assert_eq!(Shape::new(1, &[[ground, a], [ground, a]]), shape(1, vec![]));
    }

    #[test] // by hand: 0 carries 1 and 2, 2 carries 3; 4 is free
    fn a_walk_reaches_what_hangs_on_a_body_right_after_it_and_few_before_many() {
        let edges = [[None, Some(0)], [Some(0), Some(2)], [Some(2), Some(3)], [Some(0), Some(1)]];
        let forest = Forest::new(&[1.0; 5], &edges.map(|ends| edge(ends, 0, 0.0)));
        assert_eq!(forest.walk(), [0, 1, 2, 3, 4]);
        let edges = [[None, Some(0)], [Some(0), Some(1)], [Some(1), Some(3)], [Some(0), Some(2)]];
        let forest = Forest::new(&[1.0; 5], &edges.map(|ends| edge(ends, 0, 0.0)));
        assert_eq!(forest.walk(), [0, 2, 1, 3, 4]);
    }

    #[test] // by hand: a four-bar with a rod between its cranks, and a second joint beside the last one
    fn joints_are_next_to_each_other_where_they_share_a_body() {
        let (ground, a, b, c) = (None, Some(0), Some(1), Some(2));
        let joints = [[ground, a], [a, b], [b, c], [c, ground], [a, c], [ground, c]];
        let expected =
            [[0, 1], [0, 4], [1, 2], [1, 4], [2, 3], [2, 4], [2, 5], [3, 4], [3, 5], [4, 5]];
        assert_eq!(sharing_a_body(3, &joints), expected);
        // Two joints that share both bodies are one pair.
        assert_eq!(sharing_a_body(2, &[[a, b], [b, a]]), [[0, 1]]);
    }

    #[test] // by hand: joints before springs, the stiffer spring first, the heavier body as root
    fn edges_are_taken_by_class_strength_and_distance_from_the_root() {
        let (a, b, c) = (Some(0), Some(1), Some(2));
        let edges = [
            edge([a, b], 9, 10.0),
            edge([a, b], 9, 20.0),
            edge([b, c], 1, 0.0),
            edge([a, c], 3, 0.0),
        ];
        let forest = Forest::new(&[1.0, 5.0, 2.0], &edges);
        assert_eq!(forest.edge, [Some(3), None, Some(2)]);
        assert_eq!(forest.order, [1, 2, 0]);
        assert_eq!(forest.cuts, [0, 1]);
        assert_eq!(
            [[a, b], [c, b], [a, c]].map(|ends| forest.outer(ends)),
            [None, Some(2), Some(0)]
        );
        let tied = Forest::new(&[1.0, 5.0, 2.0], &[edge([None, a], 9, 0.0), edges[2], edges[3]]);
        assert_eq!(tied.order, [0, 2, 1], "a tie to the ground is a root, however light");
        // A stated cut is none of the forest, though a body is left to itself.
        let cut = [edges[0], edges[1], edges[2], edge([a, c], Edge::CUT, 0.0)];
        let forest = Forest::new(&[1.0, 5.0, 2.0], &cut);
        assert_eq!((forest.edge, forest.cuts), (vec![Some(1), None, Some(2)], vec![0, 3]));
        // A chain closed at both ends is cut where both ways are equally long.
        let ring = [[None, a], [a, b], [b, c], [c, None]].map(|ends| edge(ends, 1, 0.0));
        let forest = Forest::new(&[1.0; 3], &ring);
        assert_eq!((forest.depth, forest.cuts), (vec![1, 2, 1], vec![2]));
    }
}
