//! What each independent variable moves, and the reduced mass matrix of it.

use super::algebra::Algebra;
use super::closures::Closures;
use super::engine::{BodyInertia, Edge, Engine, add, dot, pose};
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

/// The variables that move a body, ascending.
#[derive(Debug, Clone)]
struct Moved {
    variables: Vec<usize>,
    /// Column of each of the base's directions.
    from_base: Vec<usize>,
    parts: Vec<Part>,
    /// Its first direction among all.
    first: usize,
}

/// Twists of the bodies for unit rates of the independent variables, where these are not zero, and M̂ made of them.
#[derive(Debug, Clone)]
pub(super) struct Directions<const W: usize> {
    moved: Vec<Moved>,
    columns: Vec<[f64; W]>,
    /// Those of one body about its own place.
    own: Vec<[f64; W]>,
    mass: Vec<f64>,
    factors: Cholesky,
    rate: Vec<f64>,
}

impl<const W: usize> Directions<W> {
    pub(super) fn new(
        edges: &[Edge],
        closures: &Closures,
        sources: &[Source],
        bodies: usize,
        ndof: usize,
    ) -> Self {
        let none = Moved { variables: vec![], from_base: vec![], parts: vec![], first: 0 };
        let mut moved = vec![none; bodies];
        let mut count = 0;
        for edge in edges {
            let base = edge.base.map(|base| moved[base].variables.clone()).unwrap_or_default();
            let mut variables = base.clone();
            for k in edge.range.clone() {
                match sources[k] {
                    Source::Independent(p) => variables.push(p),
                    Source::Dependent => {
                        let cluster = closures.place(k).map(|(cluster, _)| cluster);
                        let free = cluster.map(|c| &closures.clusters[c].free[..]);
                        variables.extend(free.unwrap_or_default().iter().map(|(p, _)| *p));
                    }
                    Source::Driven(..) => {}
                }
            }
            variables.sort_unstable();
            variables.dedup();
            let column = |p: usize| variables.binary_search(&p).unwrap_or_default();
            let mut parts = Vec::new();
            for coordinate in edge.range.clone() {
                match (sources[coordinate], closures.place(coordinate)) {
                    (Source::Independent(p), _) => {
                        parts.push(Part::Own { column: column(p), coordinate });
                    }
                    (Source::Dependent, Some((cluster, row))) => {
                        let free = &closures.clusters[cluster].free;
                        for (at, (p, _)) in free.iter().enumerate() {
                            let (column, place) = (column(*p), row * free.len() + at);
                            parts.push(Part::Dependent { column, coordinate, cluster, place });
                        }
                    }
                    _ => {}
                }
            }
            let from_base = base.iter().map(|&p| column(p)).collect();
            let first = count;
            count += variables.len();
            moved[edge.body] = Moved { variables, from_base, parts, first };
        }
        Self {
            moved,
            columns: vec![[0.0; W]; count],
            own: vec![[0.0; W]; ndof],
            mass: vec![0.0; ndof * ndof],
            factors: Cholesky::new(ndof),
            rate: vec![0.0; ndof],
        }
    }

    /// Multiplications of one evaluation and factorization of M̂.
    pub(super) fn operations(&self) -> f64 {
        let n = self.rate.len() as f64;
        let of = |moved: &Moved| {
            let s = moved.variables.len() as f64;
            s * (W * W) as f64 + 0.5 * s * s * W as f64
        };
        self.moved.iter().map(of).sum::<f64>() + n * n * n / 6.0
    }
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// Twists for unit rates, and M̂, at the configuration last factored.
    pub(super) fn evaluate_directions(&mut self, q: &[f64]) -> bool {
        let Some(mut at) = self.directions.take() else { return false };
        self.closures.evaluate_maps();
        let n = at.rate.len();
        at.mass.fill(0.0);
        for edge in &self.edges {
            let b = edge.body;
            let own = &at.moved[b];
            let (known, rest) = at.columns.split_at_mut(own.first);
            let columns = &mut rest[..own.variables.len()];
            columns.fill([0.0; W]);
            if let Some(base) = edge.base {
                let base = &known[at.moved[base].first..];
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
            let BodyInertia { mass, turned, .. } = &self.inertias[b];
            // About its own place: about O the inertia of what is light and far out is a small difference.
            let (place, columns) = (A::center(pose(q, b)), &mut at.own[..own.variables.len()]);
            for (about, column) in columns.iter_mut().zip(&rest[..own.variables.len()]) {
                *about = A::moved_twist(column, &self.origin[b], &place);
            }
            for (i, column) in columns.iter().enumerate() {
                let felt = A::inertia_times(*mass, turned, pose(q, b), &place, column);
                // Ascending: the upper triangle, which is all that is read.
                let row = &mut at.mass[own.variables[i] * n..][..n];
                for (variable, other) in own.variables[i..].iter().zip(&columns[i..]) {
                    row[*variable] += dot(&felt, other);
                }
            }
        }
        let served = at.factors.factor(&at.mass).is_ok();
        self.directions = Some(at);
        served
    }

    /// v̈ = −M̂⁻¹ψ, ψ in `psi`; the accelerations of the coordinates grow by D v̈.
    pub(super) fn accelerate_along(&mut self) {
        let Some(mut at) = self.directions.take() else { return };
        let mut rate = std::mem::take(&mut at.rate);
        self.project(&mut rate);
        rate.iter_mut().for_each(|x| *x = -*x);
        at.factors.solve(&mut rate);
        let mut change = std::mem::take(&mut self.change);
        self.multiply_null_space(&rate, &mut change);
        for (out, x) in self.accelerations.iter_mut().zip(&change) {
            *out += x;
        }
        (self.change, at.rate) = (change, rate);
        self.directions = Some(at);
    }
}
