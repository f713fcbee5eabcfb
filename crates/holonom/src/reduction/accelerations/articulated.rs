//! Accelerations of a tree of bodies, from the leaves inwards and out again: articulated bodies.

use super::{Known, Refusal};
use crate::reduction::body_tree::BodyTree;
use crate::reduction::chart::{BodyBlocks, Chart};
use holonom_linalg::small::{
    Square, add_own_times, add_product, add_times, add_transposed_product, add_transposed_times,
    factor, inverse, scaled, solve,
};
use holonom_linalg::{BlockMatrix, BlockPattern};
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
/// in the coordinates of the bodies, which are numbered by their positions in the tree.
#[derive(Debug, Clone)]
pub(super) struct Recursion<const N: usize> {
    tree: Arc<BodyTree>,
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
    pub(super) fn new(chart: &Chart, mass: &BlockPattern) -> Result<Self, Refusal> {
        let tree = Arc::new(BodyTree::new(chart, mass).ok_or(Refusal::Loops)?);
        Ok(match tree.forest().size() {
            3 => Self::Planar(Box::new(Recursion::new(tree))),
            _ => Self::Spatial(Box::new(Recursion::new(tree))),
        })
    }

    /// Multiplications of one solve.
    pub(super) fn multiplications(&self) -> usize {
        let (count, n) = match self {
            Self::Planar(recursion) => (recursion.tree.len(), 3),
            Self::Spatial(recursion) => (recursion.tree.len(), 7),
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
    fn new(tree: Arc<BodyTree>) -> Self {
        let count = tree.len();
        let (free, pivots) = (tree.free_before(count), tree.pivots_before(count));
        let zero = [[0.0; N]; N];
        Self {
            inverse: vec![zero; count],
            t: vec![zero; count],
            h: vec![zero; count],
            psi: vec![0.0; pivots],
            exchanges: vec![0; free],
            sizes: vec![0.0; free],
            z: vec![[0.0; N]; free],
            v: vec![[0.0; N]; free],
            phi: vec![[0.0; N]; count],
            a: vec![[0.0; N]; count],
            r: vec![0.0; free],
            tree,
        }
    }

    /// Column of B of the c-th of k independent variables of the body at a position.
    fn column(&self, at: usize, k: usize, c: usize) -> [f64; N] {
        std::array::from_fn(|i| self.inverse[at][i][N - k + c])
    }

    fn accelerate(
        &mut self,
        chart: &Chart,
        mass: &BlockMatrix,
        known: &Known,
        a: &mut [f64],
    ) -> Result<(), usize> {
        let BodyBlocks { values, row_scale, column_scale, kept } =
            chart.body_blocks().ok_or(0usize)?;
        let (rows, _) = values.as_chunks::<N>();
        let tree = self.tree.clone();
        for at in 0..tree.len() {
            let body = tree.body(at);
            let of = |side: usize| -> Square<f64, N> {
                *rows[(2 * body + side) * N..].first_chunk().expect("N rows")
            };
            self.inverse[at] = inverse(&of(0)).ok_or(body)?;
            if tree.parent(at).is_some() {
                let mut t = [[0.0; N]; N];
                add_product(&mut t, &scaled(-1.0, &self.inverse[at]), &of(1));
                self.t[at] = t;
            }
            let scale: &[f64; N] = column_scale[body * N..].first_chunk().expect("N columns");
            self.phi[at] = std::array::from_fn(|i| known.force[body * N + i] * scale[i]);
            let mass: Square<f64, N> = tree.mass(at, mass);
            self.h[at] =
                std::array::from_fn(|i| std::array::from_fn(|j| mass[i][j] * scale[i] * scale[j]));
        }
        self.sizes.fill(0.0);
        for at in (0..tree.len()).rev() {
            let free = tree.free(at);
            let k = free.len();
            let mut g = [0.0; N];
            let f: [f64; N] = std::array::from_fn(|i| {
                let row = tree.rows(at)[i] as usize;
                kept.get(row).map_or(0.0, |&from| known.tau[from] * row_scale[row])
            });
            add_times(&mut g, 1.0, &self.inverse[at], &f);
            let (h, mut phi) = (self.h[at], self.phi[at]);
            add_times(&mut phi, -1.0, &h, &g);
            let parent = tree.parent(at);
            let mut ht = [[0.0; N]; N];
            if parent.is_some() {
                add_product(&mut ht, &h, &self.t[at]);
            }
            let mut sizes = [0.0; N];
            let psi = tree.pivots_before(at)..tree.pivots_before(at + 1);
            for c in 0..k {
                let b = self.column(at, k, c);
                let mut hb = [0.0; N];
                add_own_times(&mut hb, &h, &b);
                for r in 0..k {
                    let other = self.column(at, k, r);
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
            let growth = factor(psi, exchanges, k, &sizes).map_err(|_| tree.body(at))?;
            // Written so that a NaN fails.
            let good = growth <= LARGEST_GROWTH;
            if !good {
                return Err(tree.body(at));
            }
            let mut r = &mut self.r[free.clone()];
            solve(psi, exchanges, k, &mut r, |r, c| &mut r[c]);
            let mut z = &mut self.z[free.clone()];
            for j in 0..N {
                solve(psi, exchanges, k, &mut z, |z, c| &mut z[c][j]);
            }
            self.a[at] = g;
            let Some(parent) = parent else { continue };
            let mut add = [[0.0; N]; N];
            add_transposed_product(&mut add, &self.t[at], &ht);
            let above = tree.free(parent);
            for (c, k) in above.clone().enumerate() {
                self.sizes[k] += size(&self.column(parent, above.len(), c), &add);
            }
            let mut force = [0.0; N];
            add_transposed_times(&mut force, &self.t[at], &phi);
            for k in free {
                let (v, z, r) = (&self.v[k], &self.z[k], self.r[k]);
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
        for at in 0..tree.len() {
            let free = tree.free(at);
            let mut own = self.a[at];
            if let Some(parent) = tree.parent(at) {
                let above = self.a[parent];
                for k in free.clone() {
                    self.r[k] -= dot(&self.z[k], &above);
                }
                add_times(&mut own, 1.0, &self.t[at], &above);
            }
            let k = free.len();
            for (c, variable) in free.enumerate() {
                let b = self.column(at, k, c);
                for i in 0..N {
                    own[i] += b[i] * self.r[variable];
                }
            }
            self.a[at] = own;
            let first = tree.body(at) * N;
            for i in first..first + N {
                a[i] = own[i - first] * column_scale[i];
            }
        }
        Ok(())
    }

    /// λ̃ = E⁻ᵀ(φ − H q̈) in the rows of G.
    fn multipliers(&self, chart: &Chart, lambda: &mut [f64]) {
        let Some(BodyBlocks { row_scale, kept, .. }) = chart.body_blocks() else { return };
        lambda.fill(0.0);
        for at in 0..self.tree.len() {
            let mut force = self.phi[at];
            add_times(&mut force, -1.0, &self.h[at], &self.a[at]);
            let mut out = [0.0; N];
            add_transposed_times(&mut out, &self.inverse[at], &force);
            for (row, x) in self.tree.rows(at).iter().zip(out) {
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
