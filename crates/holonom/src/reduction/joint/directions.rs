//! What each independent variable moves, and the reduced mass matrix of it.

use super::algebra::Algebra;
use super::closures::Closures;
use super::engine::{BodyInertia, Edge, Engine, add, dot, pose};
use super::inertia::Inertia;
use crate::reduction::relatives::Source;
use holonom_linalg::Cholesky;

/// Where a number of a body's directions comes from.
#[derive(Debug, Clone, Copy)]
enum Part {
    /// The coordinate is the variable.
    Own { column: usize, coordinate: usize },
    /// The coordinate depends on it: cluster, and place in its map.
    Dependent { column: usize, coordinate: usize, cluster: usize, place: usize },
}

/// The variables of loops that move a body, ascending.
#[derive(Debug, Clone, Default)]
struct Moved {
    variables: Vec<usize>,
    /// Column of each of the base's directions.
    from_base: Vec<usize>,
    parts: Vec<Part>,
    /// Place in M̂ of each variable with the first one of all; with variable p, not behind it, it is by p smaller.
    places: Vec<usize>,
    /// Its first direction among all.
    first: usize,
}

/// A variable of no loop: it moves a body with all that hangs on it as one.
#[derive(Debug, Clone)]
struct Alone {
    coordinate: usize,
    /// Place of its edge.
    edge: usize,
    body: usize,
    base: Option<usize>,
    /// Places in M̂ with variables of no loop, itself among them, that move the body, and their coordinates; with those of
    /// loops that move the base; with those of loops among what hangs on the body, and these.
    above: Vec<(usize, usize)>,
    with_base: Vec<usize>,
    below: Vec<(usize, usize)>,
}

/// Twists of the bodies for unit rates of the independent variables, where these are not zero, and M̂ made of them.
#[derive(Debug, Clone)]
pub(super) struct Directions<const W: usize> {
    moved: Vec<Moved>,
    alone: Vec<Alone>,
    columns: Vec<[f64; W]>,
    /// Those of one body about its own place.
    own: Vec<[f64; W]>,
    /// By variables of loops: what accelerates all that they move.
    felt: Vec<[f64; W]>,
    mass: ReducedMass,
    rate: Vec<f64>,
}

/// M̂ with the last variable first: what is far from the root is eliminated before what it hangs on, so that branches do
/// not fill each other's places.
#[derive(Debug, Clone)]
struct ReducedMass {
    entries: Vec<f64>,
    factors: Cholesky,
}

impl ReducedMass {
    /// Place of the entry of two of n variables.
    fn place(n: usize, i: usize, j: usize) -> usize {
        (n - 1 - i.max(j)) * n + n - 1 - i.min(j)
    }

    fn solve(&self, x: &mut [f64]) {
        x.reverse();
        self.factors.solve(x);
        x.reverse();
    }
}

impl<const W: usize> Directions<W> {
    pub(super) fn new(
        edges: &[Edge],
        closures: &Closures,
        sources: &[Source],
        bodies: usize,
        ndof: usize,
    ) -> Self {
        let mut is_looped = vec![false; ndof];
        let free = |cluster: usize| &closures.clusters[cluster].free;
        for cluster in 0..closures.clusters.len() {
            free(cluster).iter().for_each(|(p, _)| is_looped[*p] = true);
        }
        let mut moved = vec![Moved::default(); bodies];
        // By bodies: variables of no loop that move them, with their coordinates.
        let mut above: Vec<Vec<(usize, usize)>> = vec![vec![]; bodies];
        let mut alone = Vec::new();
        let mut count = 0;
        for (at, edge) in edges.iter().enumerate() {
            let (body, base) = (edge.body, edge.base);
            let from_base = base.map(|base| moved[base].variables.clone()).unwrap_or_default();
            let mut variables = from_base.clone();
            let mut own = base.map(|base| above[base].clone()).unwrap_or_default();
            for coordinate in edge.range.clone() {
                match (sources[coordinate], closures.place(coordinate)) {
                    (Source::Independent(p), _) if is_looped[p] => variables.push(p),
                    (Source::Independent(variable), _) => {
                        own.push((variable, coordinate));
                        let place = |p: usize| ReducedMass::place(ndof, variable, p);
                        let above = own.iter().map(|&(p, k)| (place(p), k)).collect();
                        let with_base = from_base.iter().map(|&p| place(p)).collect();
                        let (edge, below) = (at, Vec::new());
                        let one = Alone { coordinate, edge, body, base, above, with_base, below };
                        alone.push((variable, one));
                    }
                    (Source::Dependent, Some((cluster, _))) => {
                        variables.extend(free(cluster).iter().map(|(p, _)| *p));
                    }
                    _ => {}
                }
            }
            above[body] = own;
            variables.sort_unstable();
            variables.dedup();
            let column = |p: usize| variables.binary_search(&p).unwrap_or_default();
            let mut parts = Vec::new();
            for coordinate in edge.range.clone() {
                match (sources[coordinate], closures.place(coordinate)) {
                    (Source::Independent(p), _) if is_looped[p] => {
                        parts.push(Part::Own { column: column(p), coordinate });
                    }
                    (Source::Dependent, Some((cluster, row))) => {
                        let free = free(cluster);
                        for (at, (p, _)) in free.iter().enumerate() {
                            let (column, place) = (column(*p), row * free.len() + at);
                            parts.push(Part::Dependent { column, coordinate, cluster, place });
                        }
                    }
                    _ => {}
                }
            }
            let from_base = from_base.iter().map(|&p| column(p)).collect();
            let first = count;
            count += variables.len();
            let places = variables.iter().map(|&p| ReducedMass::place(ndof, p, 0)).collect();
            moved[body] = Moved { variables, from_base, parts, places, first };
        }
        // Variables of loops that move a body or something that hangs on it.
        let mut below: Vec<Vec<usize>> = moved.iter().map(|own| own.variables.clone()).collect();
        for edge in edges.iter().rev() {
            below[edge.body].sort_unstable();
            below[edge.body].dedup();
            if let Some(base) = edge.base {
                let own = below[edge.body].clone();
                below[base].extend(own);
            }
        }
        for (variable, one) in &mut alone {
            let known = one.base.map_or(&[][..], |base| &moved[base].variables);
            let new = below[one.body].iter().filter(|p| known.binary_search(p).is_err());
            one.below = new.map(|&p| (ReducedMass::place(ndof, *variable, p), p)).collect();
        }
        Self {
            moved,
            alone: alone.into_iter().map(|(_, one)| one).collect(),
            columns: vec![[0.0; W]; count],
            own: vec![[0.0; W]; ndof],
            felt: vec![[0.0; W]; ndof],
            mass: ReducedMass { entries: vec![0.0; ndof * ndof], factors: Cholesky::new(ndof) },
            rate: vec![0.0; ndof],
        }
    }

    /// Multiplications of one evaluation and factorization of M̂.
    pub(super) fn operations(&self) -> f64 {
        let (n, square, w) = (self.rate.len() as f64, (W * W) as f64, W as f64);
        let of_body = |moved: &Moved| {
            let s = moved.variables.len() as f64;
            (s + 1.0) * square + 0.5 * s * s * w
        };
        let of_alone = |one: &Alone| {
            square + (one.with_base.len() + one.above.len() + one.below.len()) as f64 * w
        };
        let bodies = self.moved.iter().map(of_body).sum::<f64>();
        bodies + self.alone.iter().map(of_alone).sum::<f64>() + n * n * n / 6.0
    }
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// Twists for unit rates, and M̂, at the configuration last factored.
    pub(super) fn evaluate_directions(&mut self, q: &[f64]) -> bool {
        let Some(mut at) = self.directions.take() else { return false };
        self.closures.evaluate_maps();
        let Directions { moved, alone, columns: all, own: about, felt, mass, .. } = &mut *at;
        mass.entries.fill(0.0);
        felt.fill([0.0; W]);
        for edge in &*self.edges {
            let b = edge.body;
            let own = &moved[b];
            let (known, rest) = all.split_at_mut(own.first);
            let columns = &mut rest[..own.variables.len()];
            columns.fill([0.0; W]);
            if let Some(base) = edge.base {
                let base = &known[moved[base].first..];
                for (column, from) in own.from_base.iter().zip(base) {
                    columns[*column] = *from;
                }
            }
            for part in &own.parts {
                match *part {
                    Part::Own { column, coordinate } => {
                        add(&mut columns[column], 1.0, &self.columns[coordinate]);
                    }
                    Part::Dependent { column, coordinate, cluster, place } => {
                        let by = self.closures.clusters[cluster].map[place];
                        add(&mut columns[column], by, &self.columns[coordinate]);
                    }
                }
            }
            // About its own place: about O the inertia of what is light and far out is a small difference.
            let place = A::center(pose(q, b));
            let columns = &mut about[..own.variables.len()];
            for (about, column) in columns.iter_mut().zip(&rest[..own.variables.len()]) {
                *about = A::moved_twist(column, &self.origin[b], &place);
            }
            let BodyInertia { mass: m, turned, .. } = &self.inertias[b];
            for (i, (&p, column)) in own.variables.iter().zip(&*columns).enumerate() {
                let own_felt = A::inertia_about_center(*m, turned, column);
                add(&mut felt[p], 1.0, &A::moved(&own_felt, &place, &self.origin[b]));
                for (column, &place) in columns[i..].iter().zip(&own.places[i..]) {
                    mass.entries[place - p] += dot(&own_felt, column);
                }
            }
        }
        if !alone.is_empty() {
            self.gather_inertias(q);
        }
        for one in &*alone {
            let column = &self.columns[one.coordinate];
            let b = one.body;
            let own = self.articulated[one.edge].inertia.times(&self.own_columns[one.coordinate]);
            let own = A::moved(&own, &self.center[b], &self.origin[b]);
            for &(at, coordinate) in &one.above {
                mass.entries[at] += dot(&own, &self.columns[coordinate]);
            }
            if let Some(base) = one.base {
                for (&at, column) in one.with_base.iter().zip(&all[moved[base].first..]) {
                    mass.entries[at] += dot(&own, column);
                }
            }
            for &(at, variable) in &one.below {
                mass.entries[at] += dot(column, &felt[variable]);
            }
        }
        let served = mass.factors.factor(&mass.entries).is_ok();
        self.directions = Some(at);
        served
    }

    /// v̈ = −M̂⁻¹ψ, ψ in `psi`; the accelerations of the coordinates grow by D v̈.
    pub(super) fn accelerate_along(&mut self) {
        let Some(mut at) = self.directions.take() else { return };
        let Directions { rate, mass, .. } = &mut *at;
        rate.fill(0.0);
        self.independent.iter().for_each(|&(k, p)| rate[p] = self.along[k]);
        self.closures.follow_transposed(&self.along, rate);
        rate.iter_mut().for_each(|x| *x = -*x);
        mass.solve(rate);
        let mut change = std::mem::take(&mut self.change);
        self.tell(0.0, None, rate, &mut change);
        self.closures.follow(rate, &mut change);
        for (out, x) in self.accelerations.iter_mut().zip(&change) {
            *out += x;
        }
        self.change = change;
        self.directions = Some(at);
    }
}
