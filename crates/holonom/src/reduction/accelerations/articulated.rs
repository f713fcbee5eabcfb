//! Accelerations of a tree of bodies, from the leaves inwards and out again: articulated bodies.

use super::{Known, Refusal};
use crate::reduction::chart::{BodyBlocks, Chart};
use holonom_linalg::small::{
    Square, add_own_times, add_product, add_times, add_transposed_product, add_transposed_times,
    factor, inverse, scaled, solve,
};
use holonom_linalg::{BlockForest, BlockMatrix};
use std::sync::Arc;

/// Growth of numbers in the elimination of a body that leaves ten digits; beyond it the augmented system serves.
const LARGEST_GROWTH: f64 = 1e-10 / f64::EPSILON;

/// For bodies in a plane or in space.
#[derive(Debug, Clone)]
pub(super) enum Articulated {
    Planar(Box<Recursion<3>>),
    Spatial(Box<Recursion<7>>),
}

/// With E and F the rows of [G; P] of a body b in its own and its parent's coordinates, T = −E⁻¹F, and B the
/// columns of E⁻¹ of its rows of P:
///
/// ```text
/// q̈ = T q̈_p + B ρ + g    g = E⁻¹ [τ; 0]    ρ = r − Z q̈_p
/// Ψ = BᵀHB    Z = Ψ⁻¹BᵀHT    r = Ψ⁻¹Bᵀ(φ − H g)
/// H_p = M_p + Σ TᵀH(T − B Z)    φ_p = Q_p + Σ Tᵀ(φ − H g − H B r)
/// ```
///
/// Equations: `docs/theory/reduction.md` (62)-(65). Source: Featherstone, *Rigid Body Dynamics Algorithms*, ch. 7,
/// in the coordinates of the bodies.
#[derive(Debug, Clone)]
pub(super) struct Recursion<const N: usize> {
    forest: Arc<BlockForest>,
    /// Blocks of M: body, first row and column in it, order, first value.
    masses: Vec<[usize; 4]>,
    /// First of the independent variables of each body, in a numbering of their own, and one more.
    first: Vec<usize>,
    /// First value of each body's Ψ.
    pivots: Vec<usize>,
    inverse: Vec<Square<f64, N>>,
    t: Vec<Square<f64, N>>,
    h: Vec<Square<f64, N>>,
    psi: Vec<f64>,
    exchanges: Vec<u8>,
    sizes: Vec<f64>,
    z: Vec<[f64; N]>,
    v: Vec<[f64; N]>,
    phi: Vec<[f64; N]>,
    a: Vec<[f64; N]>,
    r: Vec<f64>,
}

/// Multiplications for a body with N coordinates, per N³.
const PER_CUBE: usize = 6;

impl Articulated {
    /// For a chart.
    ///
    /// # Errors
    /// [`Refusal`] where the bodies are no tree in its coordinates.
    pub(super) fn new(chart: &Chart, mass: &BlockMatrix) -> Result<Self, Refusal> {
        let blocks = chart.body_blocks().ok_or(Refusal::Loops)?;
        let forest = blocks.forest;
        let n = forest.size();
        let mut masses = Vec::new();
        let mut offset = 0;
        for (row, column, rows, columns) in mass.shapes() {
            if (row, rows) != (column, columns) || row / n != (row + rows - 1) / n {
                return Err(Refusal::Loops);
            }
            masses.push([row / n, row % n, rows, offset]);
            offset += rows * columns;
        }
        let rank = chart.parametrization().kept.len();
        Ok(match n {
            3 => Self::Planar(Box::new(Recursion::new(forest, masses, rank))),
            _ => Self::Spatial(Box::new(Recursion::new(forest, masses, rank))),
        })
    }

    /// Multiplications of one solve.
    pub(super) fn multiplications(&self) -> usize {
        let (count, n) = match self {
            Self::Planar(recursion) => (recursion.forest.len(), 3),
            Self::Spatial(recursion) => (recursion.forest.len(), 7),
        };
        PER_CUBE * n * n * n * count
    }

    /// Accelerations at the configuration of the chart's factors.
    ///
    /// # Errors
    /// The place of a body whose inertia is not enough.
    pub(super) fn accelerate(
        &mut self,
        chart: &Chart,
        mass: &BlockMatrix,
        at: &Known,
        a: &mut [f64],
    ) -> Result<(), usize> {
        match self {
            Self::Planar(recursion) => recursion.accelerate(chart, mass, at, a),
            Self::Spatial(recursion) => recursion.accelerate(chart, mass, at, a),
        }
    }

    /// Multipliers of the accelerations last found.
    pub(super) fn multipliers(&self, chart: &Chart, lambda: &mut [f64]) {
        match self {
            Self::Planar(recursion) => recursion.multipliers(chart, lambda),
            Self::Spatial(recursion) => recursion.multipliers(chart, lambda),
        }
    }
}

impl<const N: usize> Recursion<N> {
    fn new(forest: &Arc<BlockForest>, masses: Vec<[usize; 4]>, rank: usize) -> Self {
        let count = forest.len();
        let (mut first, mut pivots) = (vec![0], vec![0]);
        for block in 0..count {
            // Rows of a block ascend: those of P come last.
            let free = forest.rows(block).iter().filter(|row| **row as usize >= rank).count();
            first.push(first[block] + free);
            pivots.push(pivots[block] + free * free);
        }
        let free = first[count];
        let zero = [[0.0; N]; N];
        Self {
            inverse: vec![zero; count],
            t: vec![zero; count],
            h: vec![zero; count],
            psi: vec![0.0; pivots[count]],
            exchanges: vec![0; free],
            sizes: vec![0.0; free],
            z: vec![[0.0; N]; free],
            v: vec![[0.0; N]; free],
            phi: vec![[0.0; N]; count],
            a: vec![[0.0; N]; count],
            r: vec![0.0; free],
            forest: forest.clone(),
            masses,
            first,
            pivots,
        }
    }

    fn free(&self, block: usize) -> std::ops::Range<usize> {
        self.first[block]..self.first[block + 1]
    }

    /// Column of B of the c-th of k independent variables of a body.
    fn column(&self, body: usize, k: usize, c: usize) -> [f64; N] {
        std::array::from_fn(|i| self.inverse[body][i][N - k + c])
    }

    fn accelerate(
        &mut self,
        chart: &Chart,
        mass: &BlockMatrix,
        at: &Known,
        a: &mut [f64],
    ) -> Result<(), usize> {
        let BodyBlocks { values, row_scale, column_scale, kept, .. } =
            chart.body_blocks().ok_or(0usize)?;
        let (rows, _) = values.as_chunks::<N>();
        let forest = self.forest.clone();
        for body in 0..forest.len() {
            let of = |side: usize| -> Square<f64, N> {
                *rows[(2 * body + side) * N..].first_chunk().expect("N rows")
            };
            self.inverse[body] = inverse(&of(0)).ok_or(body)?;
            if forest.parent(body).is_some() {
                let mut t = [[0.0; N]; N];
                add_product(&mut t, &scaled(-1.0, &self.inverse[body]), &of(1));
                self.t[body] = t;
            }
            let scale = &column_scale[body * N..][..N];
            self.phi[body] = std::array::from_fn(|i| at.force[body * N + i] * scale[i]);
            self.h[body] = [[0.0; N]; N];
        }
        for &[body, first, order, at] in &self.masses {
            let scale = &column_scale[body * N + first..][..order];
            let values = mass.values()[at..at + order * order].chunks_exact(order);
            for (i, row) in values.enumerate() {
                for (j, x) in row.iter().enumerate() {
                    self.h[body][first + i][first + j] = x * scale[i] * scale[j];
                }
            }
        }
        self.sizes.fill(0.0);
        for body in forest.order().rev() {
            let free = self.free(body);
            let k = free.len();
            let mut g = [0.0; N];
            let f: [f64; N] = std::array::from_fn(|i| {
                let row = forest.rows(body)[i] as usize;
                kept.get(row).map_or(0.0, |&from| at.tau[from] * row_scale[row])
            });
            add_times(&mut g, 1.0, &self.inverse[body], &f);
            let (h, mut phi) = (self.h[body], self.phi[body]);
            add_times(&mut phi, -1.0, &h, &g);
            let parent = forest.parent(body);
            let mut ht = [[0.0; N]; N];
            if parent.is_some() {
                add_product(&mut ht, &h, &self.t[body]);
            }
            let mut sizes = [0.0; N];
            let psi = self.pivots[body]..self.pivots[body + 1];
            for c in 0..k {
                let b = self.column(body, k, c);
                let mut hb = [0.0; N];
                add_own_times(&mut hb, &h, &b);
                for r in 0..k {
                    let other = self.column(body, k, r);
                    self.psi[psi.start + r * k + c] = dot(&other, &hb);
                }
                sizes[c] = self.sizes[free.start + c] + size(&b, &h);
                let mut z = [0.0; N];
                add_transposed_times(&mut z, &ht, &b);
                self.z[free.start + c] = z;
                self.v[free.start + c] = z;
                self.r[free.start + c] = dot(&b, &phi);
            }
            let (psi, exchanges) = (&mut self.psi[psi], &mut self.exchanges[free.clone()]);
            let growth = factor(psi, exchanges, k, &sizes).map_err(|_| body)?;
            // Written so that a NaN fails.
            let good = growth <= LARGEST_GROWTH;
            if !good {
                return Err(body);
            }
            let mut r = &mut self.r[free.clone()];
            solve(psi, exchanges, k, &mut r, |r, c| &mut r[c]);
            let mut z = &mut self.z[free.clone()];
            for j in 0..N {
                solve(psi, exchanges, k, &mut z, |z, c| &mut z[c][j]);
            }
            self.a[body] = g;
            let Some(parent) = parent else { continue };
            let mut add = [[0.0; N]; N];
            add_transposed_product(&mut add, &self.t[body], &ht);
            let above = self.free(parent);
            for (c, at) in above.clone().enumerate() {
                self.sizes[at] += size(&self.column(parent, above.len(), c), &add);
            }
            let mut force = [0.0; N];
            add_transposed_times(&mut force, &self.t[body], &phi);
            for at in free {
                let (v, z, r) = (&self.v[at], &self.z[at], self.r[at]);
                for i in 0..N {
                    for j in 0..N {
                        add[i][j] -= v[i] * z[j];
                    }
                    force[i] -= v[i] * r;
                }
            }
            for i in 0..N {
                for j in 0..N {
                    self.h[parent][i][j] += add[i][j];
                }
                self.phi[parent][i] += force[i];
            }
        }
        for body in forest.order() {
            let free = self.free(body);
            let mut own = self.a[body];
            if let Some(parent) = forest.parent(body) {
                let above = self.a[parent];
                for at in free.clone() {
                    self.r[at] -= dot(&self.z[at], &above);
                }
                add_times(&mut own, 1.0, &self.t[body], &above);
            }
            let k = free.len();
            for (c, at) in free.enumerate() {
                let b = self.column(body, k, c);
                for i in 0..N {
                    own[i] += b[i] * self.r[at];
                }
            }
            self.a[body] = own;
            for i in 0..N {
                a[body * N + i] = own[i] * column_scale[body * N + i];
            }
        }
        Ok(())
    }

    /// λ̃ = E⁻ᵀ(φ − H q̈) in the rows of G.
    fn multipliers(&self, chart: &Chart, lambda: &mut [f64]) {
        let Some(BodyBlocks { row_scale, kept, .. }) = chart.body_blocks() else { return };
        lambda.fill(0.0);
        for body in 0..self.forest.len() {
            let mut force = self.phi[body];
            add_times(&mut force, -1.0, &self.h[body], &self.a[body]);
            let mut out = [0.0; N];
            add_transposed_times(&mut out, &self.inverse[body], &force);
            for (row, x) in self.forest.rows(body).iter().zip(out) {
                if let Some(&row_of_g) = kept.get(*row as usize) {
                    lambda[row_of_g] = x * row_scale[*row as usize];
                }
            }
        }
    }
}

fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// |b|ᵀ|H||b|.
fn size<const N: usize>(b: &[f64; N], h: &Square<f64, N>) -> f64 {
    let row = |i: usize| (0..N).map(|j| h[i][j].abs() * b[j].abs()).sum::<f64>();
    (0..N).map(|i| b[i].abs() * row(i)).sum()
}
