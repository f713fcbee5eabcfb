//! The reduced matrix B = G M⁻¹ Gᵀ by blocks of joints, planar and spatial.
//!
//! Per body the accelerations that its own coordinates allow are q̈ = T y + β p with TᵀMT = 1: in the
//! plane T = diag(m, m, J)^-½, in space the rotational part is T = ½ Gᵀ J'^-½, G the 3×4 matrix of
//! ω' = 2 G ṗ, and β = −ṗᵀṗ/pᵀp keeps the Euler parameters normalized. With H = Φ_q T
//!
//! ```text
//! B = H Hᵀ    B λ = H Tᵀ Q − τ + Φ_p p β    y = TᵀQ − Hᵀλ
//! ```
//!
//! Source: thesis (3.108) to (3.122), Algorithms 1 and 2; `docs/theory/reduction.md` (52) to (59).

use super::IndexOneEquations;
use super::products::{
    Product, Side, add_products, by_rows, multiply, part_mut, subtract_reactions,
};
use crate::error::EvaluationFailure;
use crate::reduction::refinement::largest;
use crate::system::{Structure, System};
use holonom_linalg::{BlockGraph, BlockMatrix, LARGEST_BLOCK};
use std::sync::Arc;

/// Why accelerations cannot come from there.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// A body has no mass, or no inertia about some axis: M has no inverse.
    #[error("body number {body} has no mass or no inertia about some axis")]
    Massless {
        /// Its index.
        body: usize,
    },
    /// The Euler parameters of a body are kept normalized by joints: a normalization row was dropped.
    #[error("the normalization of body number {body} is not among the kept rows")]
    Normalization {
        /// Its index.
        body: usize,
    },
    /// Bodies and joints form loops, or drivers and redundant joints leave a body more or fewer rows than it has
    /// coordinates.
    #[error("the bodies do not form a tree whose coordinates are independent or driven")]
    Loops,
    /// So many joints share a body that the matrix is nearly full.
    #[error("{numbers:.2e} numbers would have to be stored")]
    Large {
        /// How many, at least.
        numbers: f64,
    },
}

/// Inertia below this part of the greatest is none.
const NO_INERTIA: f64 = 1e-14;

/// T of a body, as far as it does not move.
#[derive(Debug, Clone, Copy)]
struct Inertia {
    /// m^-½.
    translation: f64,
    /// U with U Uᵀ = J'⁻¹, upper triangular; planar: J^-½ at [2][2].
    rotation: [[f64; 3]; 3],
}

/// G M⁻¹ Gᵀ of a system.
#[derive(Debug, Clone)]
pub struct ReducedMatrix {
    planar: bool,
    graph: Arc<BlockGraph>,
    /// Row of G of each reduced row.
    rows: Arc<[usize]>,
    sides: Arc<[Side]>,
    /// First value of G of each row of H: there is one for each reduced row and body of its joint.
    places: Arc<[u32]>,
    products: Arc<[Product]>,
    inertia: Arc<[Inertia]>,
    numbers: Numbers,
    normalization_start: usize,
}

/// What belongs to a configuration. There is room for it from the first assembly on, in copies too: many of them never
/// come to one.
#[derive(Debug, Default)]
struct Numbers {
    /// Rotational part of T of each body (spatial).
    maps: Vec<[[f64; 3]; 4]>,
    /// H, side by side.
    h: Vec<f64>,
    /// Φ_p p of its rows (spatial).
    stretch: Vec<f64>,
    /// TᵀQ, then y.
    y: Vec<f64>,
    beta: Vec<f64>,
}

impl Clone for Numbers {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Numbers {
    fn make_room(&mut self, planar: bool, h_rows: usize, bodies: usize) {
        let (free, turning) = if planar { (3, 0) } else { (6, 1) };
        self.maps.resize(turning * bodies, [[0.0; 3]; 4]);
        self.h.resize(h_rows * free, 0.0);
        self.stretch.resize(turning * h_rows, 0.0);
        self.y.resize(bodies * free, 0.0);
        self.beta.resize(turning * bodies, 0.0);
    }
}

impl ReducedMatrix {
    /// Finds the joints that have kept rows and which of them share bodies.
    ///
    /// # Errors
    /// [`Refusal`] when M has no inverse.
    pub fn new(system: &dyn System, kept: &[usize]) -> Result<Self, Refusal> {
        let structure = system.structure();
        let planar = structure.sizes.is_planar();
        Self::check(system, kept)?;
        let inertia = inverse_roots(system)?;
        let (mut joints, mut begin) = (Vec::new(), vec![0]);
        let mut rows = Vec::new();
        for k in 0..structure.joints.len() {
            rows.extend(kept_rows(structure, k, kept));
            if rows.len() > begin[begin.len() - 1] {
                joints.push(k);
                begin.push(rows.len());
            }
        }
        let (mut sides, mut places) = (Vec::new(), Vec::new());
        for (joint, range) in joints.iter().zip(begin.windows(2)) {
            let joint = &structure.joints[*joint];
            for (body, block) in joint.bodies.iter().zip(joint.blocks) {
                let (Some(body), Some(block)) = (*body, block) else { continue };
                let (begin, count) = (range[0], range[1] - range[0]);
                sides.push(Side { body, begin, rows: count, h: places.len() });
                let first = structure.constraint_pattern.place(block).start;
                let own = rows[begin..range[1]].iter().map(|row| row - joint.row);
                places.extend(own.map(|row| (first + row * structure.sizes.per_body) as u32));
            }
        }
        let heights: Vec<usize> = begin.windows(2).map(|w| w[1] - w[0]).collect();
        debug_assert!(heights.iter().all(|&rows| rows <= LARGEST_BLOCK), "rows of a joint");
        Ok(Self {
            planar,
            graph: Arc::new(BlockGraph::new(&heights, &structure.joint_pairs(&joints))),
            rows: rows.into(),
            sides: sides.into(),
            places: places.into(),
            products: Arc::new([]),
            inertia,
            numbers: Numbers::default(),
            normalization_start: structure.normalization_start,
        })
    }

    /// Whether M has an inverse and every normalization is kept.
    ///
    /// # Errors
    /// [`Refusal`].
    pub fn check(system: &dyn System, kept: &[usize]) -> Result<(), Refusal> {
        inverse_roots(system)?;
        let structure = system.structure();
        let planar = structure.sizes.is_planar();
        let mut normalized = 0..if planar { 0 } else { structure.sizes.bodies };
        let is_dropped =
            |body: &usize| kept.binary_search(&(structure.normalization_start + body)).is_err();
        normalized.find(is_dropped).map_or(Ok(()), |body| Err(Refusal::Normalization { body }))
    }

    /// A copy with the places of this matrix for other numbers of the same structure.
    ///
    /// # Errors
    /// [`Refusal::Massless`].
    pub fn with_values(&self, system: &dyn System) -> Result<Self, Refusal> {
        Ok(Self { inertia: inverse_roots(system)?, ..self.clone() })
    }

    /// Numbers of B that can differ from zero, multiplications that make them, and bodies of joints, for the
    /// kept rows: joints that share both bodies are counted twice. Nothing of that size is built.
    pub fn least_size(system: &dyn System, kept: &[usize]) -> [f64; 3] {
        let structure = system.structure();
        let free = if structure.sizes.is_planar() { 3.0 } else { 6.0 };
        let mut rows_of_body = vec![0.0; structure.sizes.bodies];
        let mut sides = 0;
        for (k, joint) in structure.joints.iter().enumerate() {
            let rows = kept_rows(structure, k, kept).len() as f64;
            for &body in joint.bodies.iter().flatten() {
                rows_of_body[body] += rows;
                sides += 1;
            }
        }
        let numbers = rows_of_body.iter().map(|rows| 0.5 * rows * (rows + 1.0)).sum::<f64>();
        [numbers, free * numbers, f64::from(sides)]
    }

    /// Gives up its numbers until the next assembly.
    pub(super) fn release(&mut self) {
        self.numbers = Numbers::default();
    }

    /// Joints with kept rows as vertices; those that share a body are neighbours.
    pub fn graph(&self) -> &BlockGraph {
        &self.graph
    }

    /// Number of reduced rows: joint by joint in the order of the graph's vertices.
    pub fn n(&self) -> usize {
        self.rows.len()
    }

    /// Row of G of a reduced row.
    pub fn row(&self, reduced: usize) -> usize {
        self.rows[reduced]
    }

    /// First reduced row of each joint, and their number.
    pub fn begins(&self) -> Vec<usize> {
        let mut begin = vec![0];
        begin.extend(self.graph.sizes().iter().scan(0, |sum, size| {
            *sum += size;
            Some(*sum)
        }));
        begin
    }

    /// Numbers the joints anew: joint `order[k]` is number k from now on. Places of blocks are forgotten.
    pub fn renumber(&mut self, order: &[usize]) {
        let old = self.begins();
        self.graph = Arc::new(self.graph.renumbered(order));
        self.products = Arc::new([]);
        self.rows = order
            .iter()
            .flat_map(|&joint| &self.rows[old[joint]..old[joint + 1]])
            .copied()
            .collect();
        let mut begin = vec![0; self.rows.len()];
        for (&joint, new) in order.iter().zip(self.begins()) {
            begin[old[joint]] = new;
        }
        let mut sides = self.sides.to_vec();
        sides.iter_mut().for_each(|side| side.begin = begin[side.begin]);
        sides.sort_by_key(|side| side.begin);
        self.sides = sides.into();
    }

    /// Where blocks go from now on: of two joints the one that is earlier is told by `in_order`, and
    /// `place` gives the first value of their block and how far its rows are apart. Of diagonal blocks
    /// everything is written.
    pub fn place(
        &mut self,
        in_order: impl Fn(usize, usize) -> bool,
        place: impl Fn(usize, usize) -> (usize, usize),
    ) {
        let begin = self.begins();
        let joint_of = |side: &Side| begin.partition_point(|&b| b <= side.begin) - 1;
        let bodies = self.inertia.len();
        let mut at: Vec<Vec<(usize, Side)>> = vec![Vec::new(); bodies];
        for side in self.sides.iter() {
            at[side.body].push((joint_of(side), *side));
        }
        let mut products: Vec<Product> = Vec::new();
        for list in &at {
            for (n, &(i, left)) in list.iter().enumerate() {
                for &(j, right) in &list[n..] {
                    let ((i, left), (j, right)) = if in_order(i, j) {
                        ((i, left), (j, right))
                    } else {
                        ((j, right), (i, left))
                    };
                    let (target, stride) = place(i, j);
                    products.push(Product {
                        left: left.h as u32,
                        right: right.h as u32,
                        rows: left.rows as u16,
                        columns: right.rows as u16,
                        target: target as u32,
                        stride: stride as u32,
                        diagonal: i == j,
                        first: false,
                    });
                }
            }
        }
        products.sort_by_key(|p| (p.target, p.left));
        let mut last = None;
        for product in &mut products {
            product.first = last != Some(product.target);
            last = Some(product.target);
        }
        self.products = products.into();
    }

    /// Multiplications of H, T, right-hand side, correction and recovery; those of B = H Hᵀ are told by
    /// [`ReducedMatrix::least_size`].
    pub fn multiplications_beside_products(&self) -> usize {
        let free = if self.planar { 3 } else { 6 };
        let (h, maps) = if self.planar { (3, 0) } else { (3 + 12, 24 + 24) };
        self.places.len() * (h + 4 * free) + self.inertia.len() * (2 * free + maps)
    }

    /// Multiplications of one assembly, right-hand side, correction and recovery.
    pub fn multiplications(&self) -> usize {
        let free = if self.planar { 3 } else { 6 };
        let block = |p: &Product| {
            let (r, c) = (p.rows as usize, p.columns as usize);
            free * if p.diagonal { r * (r + 1) / 2 } else { r * c }
        };
        self.products.iter().map(block).sum::<usize>() + self.multiplications_beside_products()
    }

    /// B at a configuration with Jacobian `g`, into the places given before.
    pub fn assemble(&mut self, q: &[f64], g: &BlockMatrix, values: &mut [f64]) {
        self.numbers.make_room(self.planar, self.places.len(), self.inertia.len());
        if self.planar {
            let Self { sides, places, inertia, numbers, .. } = self;
            for side in sides.iter() {
                let own = (side, &**places, &inertia[side.body]);
                by_rows!(side.rows, turn_planar(own, g.values(), &mut numbers.h));
            }
            multiply::<3>(&self.products, &self.numbers.h, values);
        } else {
            self.turn_spatial(q, g);
            multiply::<6>(&self.products, &self.numbers.h, values);
        }
    }

    /// T and H in space.
    fn turn_spatial(&mut self, q: &[f64], g: &BlockMatrix) {
        for ((map, body), q) in
            self.numbers.maps.iter_mut().zip(&*self.inertia).zip(q.chunks_exact(7))
        {
            let [e0, e1, e2, e3] = [q[3], q[4], q[5], q[6]];
            let half = 0.5 / (e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3);
            let u = &body.rotation;
            // Rows of Gᵀ.
            let rows = [[-e1, -e2, -e3], [e0, -e3, e2], [e3, e0, -e1], [-e2, e1, e0]];
            for (out, row) in map.iter_mut().zip(rows) {
                let [x, y, z] = row.map(|x| half * x);
                *out = [
                    x * u[0][0],
                    x * u[0][1] + y * u[1][1],
                    x * u[0][2] + y * u[1][2] + z * u[2][2],
                ];
            }
        }
        let Self { sides, places, inertia, numbers, .. } = self;
        for side in sides.iter() {
            let p = &q[side.body * 7 + 3..side.body * 7 + 7];
            let own = (side, &**places, &inertia[side.body]);
            by_rows!(side.rows, turn_spatial(own, p, g.values(), numbers));
        }
    }

    /// The right-hand side of B λ at the configuration of the last [`ReducedMatrix::assemble`]; returns the
    /// largest entry of TᵀQ.
    pub fn right_side(&mut self, equations: &IndexOneEquations, b: &mut [f64]) -> f64 {
        self.weigh_forces(equations);
        self.residual(equations, b);
        largest(&self.numbers.y, &self.numbers.y, |y, _| y.abs())
    }

    /// y = TᵀQ, and β.
    fn weigh_forces(&mut self, equations: &IndexOneEquations) {
        let IndexOneEquations { q, force, tau, .. } = equations;
        if self.planar {
            let bodies = self.numbers.y.chunks_exact_mut(3).zip(force.chunks_exact(3));
            for ((y, f), body) in bodies.zip(&*self.inertia) {
                y[0] = f[0] * body.translation;
                y[1] = f[1] * body.translation;
                y[2] = f[2] * body.rotation[2][2];
            }
            return;
        }
        let tau = &tau[self.normalization_start..];
        let bodies =
            self.numbers.y.chunks_exact_mut(6).zip(force.chunks_exact(7)).zip(&*self.inertia);
        let rest =
            self.numbers.maps.iter().zip(&mut self.numbers.beta).zip(q.chunks_exact(7).zip(tau));
        for (((y, f), body), ((map, beta), (q, tau))) in bodies.zip(rest) {
            for k in 0..3 {
                y[k] = f[k] * body.translation;
                y[3 + k] =
                    (map[0][k] * f[3] + map[1][k] * f[4]) + (map[2][k] * f[5] + map[3][k] * f[6]);
            }
            *beta = 0.5 * tau / square(&q[3..]);
        }
    }

    /// What y leaves of the constraints, H y − τ + Φ_p p β.
    pub fn residual(&self, equations: &IndexOneEquations, b: &mut [f64]) {
        for (b, &row) in b.iter_mut().zip(self.rows.iter()) {
            *b = -equations.tau[row];
        }
        if self.planar {
            return add_products::<3>(&self.sides, &self.numbers.h, &self.numbers.y, b);
        }
        add_products::<6>(&self.sides, &self.numbers.h, &self.numbers.y, b);
        for side in self.sides.iter() {
            let beta = self.numbers.beta[side.body];
            for (b, stretch) in
                b[side.begin..][..side.rows].iter_mut().zip(&self.numbers.stretch[side.h..])
            {
                *b += stretch * beta;
            }
        }
    }

    /// y −= Hᵀ b.
    pub fn subtract_reactions(&mut self, b: &[f64]) {
        if self.planar {
            subtract_reactions::<3>(&self.sides, &self.numbers.h, b, &mut self.numbers.y);
        } else {
            subtract_reactions::<6>(&self.sides, &self.numbers.h, b, &mut self.numbers.y);
        }
    }

    /// Accelerations from y and all multipliers from λ of the reduced rows.
    pub fn recover(
        &self,
        equations: &IndexOneEquations,
        b: &[f64],
        a: &mut [f64],
        lambda: &mut [f64],
    ) {
        lambda.fill(0.0);
        for (b, &row) in b.iter().zip(self.rows.iter()) {
            lambda[row] = *b;
        }
        if self.planar {
            let bodies = a.chunks_exact_mut(3).zip(self.numbers.y.chunks_exact(3));
            for ((a, y), body) in bodies.zip(&*self.inertia) {
                a[0] = y[0] * body.translation;
                a[1] = y[1] * body.translation;
                a[2] = y[2] * body.rotation[2][2];
            }
            return;
        }
        let normalization = &mut lambda[self.normalization_start..];
        let bodies = equations.q.chunks_exact(7).zip(equations.force.chunks_exact(7));
        for (l, (q, f)) in normalization.iter_mut().zip(bodies) {
            *l = q[3..].iter().zip(&f[3..]).map(|(p, f)| p * f).sum();
        }
        for side in self.sides.iter() {
            let rows = b[side.begin..][..side.rows].iter().zip(&self.numbers.stretch[side.h..]);
            normalization[side.body] -= rows.map(|(l, stretch)| l * stretch).sum::<f64>();
        }
        let bodies = a.chunks_exact_mut(7).zip(self.numbers.y.chunks_exact(6)).zip(&*self.inertia);
        let rest =
            self.numbers.maps.iter().zip(&self.numbers.beta).zip(equations.q.chunks_exact(7));
        for ((((a, y), body), ((map, beta), q)), l) in bodies.zip(rest).zip(normalization) {
            for k in 0..3 {
                a[k] = y[k] * body.translation;
            }
            for k in 0..4 {
                let turn = map[k][0] * y[3] + map[k][1] * y[4] + map[k][2] * y[5];
                a[3 + k] = turn + beta * q[3 + k];
            }
            *l *= 0.5 / square(&q[3..]);
        }
    }

    /// What to say where a pivot of B vanished.
    pub fn singular(&self, system: &dyn System, reduced: usize) -> EvaluationFailure {
        let row = self.row(reduced);
        let message = format!(
            "the accelerations are not determined: {} depends on other constraints here",
            system.row_name(row)
        );
        EvaluationFailure::new("simulation/singular-configuration", message).of_row(Some(row))
    }
}

/// Kept rows of a joint.
fn kept_rows<'a>(structure: &Structure, joint: usize, kept: &'a [usize]) -> &'a [usize] {
    let joint = &structure.joints[joint];
    let from = kept.partition_point(|&row| row < joint.row);
    let until = kept.partition_point(|&row| row < joint.row + joint.rows);
    &kept[from..until]
}

/// The inertia of every body, as far as it does not move.
fn inverse_roots(system: &dyn System) -> Result<Arc<[Inertia]>, Refusal> {
    let sizes = &system.structure().sizes;
    let planar = sizes.is_planar();
    (0..sizes.bodies)
        .map(|body| {
            let own = inverse_root(planar, system.mass(body), &system.inertia(body));
            own.ok_or(Refusal::Massless { body })
        })
        .collect()
}

fn square(p: &[f64]) -> f64 {
    p.iter().map(|e| e * e).sum()
}

/// m^-½ and J^-½ as U with U Uᵀ = J⁻¹; none where a pivot vanishes.
fn inverse_root(planar: bool, mass: f64, inertia: &[[f64; 3]; 3]) -> Option<Inertia> {
    let mut rotation = [[0.0; 3]; 3];
    let good = |x: f64, of: f64| x > NO_INERTIA * of && x.is_finite();
    let largest = (0..3).fold(0.0f64, |m, k| m.max(inertia[k][k]));
    if !good(mass, 0.0) {
        return None;
    }
    if planar {
        if !good(inertia[2][2], 0.0) {
            return None;
        }
        rotation[2][2] = 1.0 / inertia[2][2].sqrt();
        return Some(Inertia { translation: 1.0 / mass.sqrt(), rotation });
    }
    // J = L Lᵀ, then U = L⁻ᵀ.
    let mut l = [[0.0f64; 3]; 3];
    for i in 0..3 {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            let rest = inertia[i][j] - sum;
            if i == j {
                if !good(rest, largest) {
                    return None;
                }
                l[i][i] = rest.sqrt();
            } else {
                l[i][j] = rest / l[j][j];
            }
        }
    }
    for column in 0..3 {
        // Column of L⁻¹ is a row of U.
        for i in column..3 {
            let unit = if i == column { 1.0 } else { 0.0 };
            let sum: f64 = (column..i).map(|k| l[i][k] * rotation[column][k]).sum();
            rotation[column][i] = (unit - sum) / l[i][i];
        }
    }
    Some(Inertia { translation: 1.0 / mass.sqrt(), rotation })
}

/// H of one body of a joint in the plane.
#[inline(always)]
fn turn_planar<const W: usize>(
    (side, places, inertia): (&Side, &[u32], &Inertia),
    g: &[f64],
    h: &mut [f64],
) {
    let h = part_mut::<3, W>(h, side.h);
    let places: &[u32; W] = places[side.h..].first_chunk().expect("rows of the joint");
    for w in 0..W {
        let g: &[f64; 3] = g[places[w] as usize..].first_chunk().expect("three coordinates");
        h[0][w] = g[0] * inertia.translation;
        h[1][w] = g[1] * inertia.translation;
        h[2][w] = g[2] * inertia.rotation[2][2];
    }
}

/// H and Φ_p p of one body of a joint in space.
#[inline(always)]
fn turn_spatial<const W: usize>(
    (side, places, inertia): (&Side, &[u32], &Inertia),
    p: &[f64],
    g: &[f64],
    numbers: &mut Numbers,
) {
    let (map, p) = (&numbers.maps[side.body], [p[0], p[1], p[2], p[3]]);
    let h = part_mut::<6, W>(&mut numbers.h, side.h);
    let stretch = &mut numbers.stretch[side.h..][..W];
    let places: &[u32; W] = places[side.h..].first_chunk().expect("rows of the joint");
    for w in 0..W {
        let g: &[f64; 7] = g[places[w] as usize..].first_chunk().expect("seven coordinates");
        for k in 0..3 {
            h[k][w] = g[k] * inertia.translation;
            h[3 + k][w] =
                (g[3] * map[0][k] + g[4] * map[1][k]) + (g[5] * map[2][k] + g[6] * map[3][k]);
        }
        stretch[w] = (g[3] * p[0] + g[4] * p[1]) + (g[5] * p[2] + g[6] * p[3]);
    }
}
