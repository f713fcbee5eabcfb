//! Products with the Jacobian of the first-order equations, without a matrix.

use super::blocks::ReducedBlocks;
use super::descriptor::add_force_of_extra_states;
use crate::error::EvaluationFailure;
use crate::reduction::Point;
use crate::threads::Threads;

/// J = g_w of ẇ = g(t, w), w = (v, v̇, z), at a complete point, by products:
///
/// ```text
/// δq = D δv   δq̇ = D δv̇ − G̃⁻¹Ã₀ δq   b = −G̃⁻¹(Ã₁ δq + 2Ã₀ δq̇)
/// δv̈ = −M̂⁻¹Dᵀ(K δq + C δq̇ + M b + F_z δz)     δż = g_q δq + g_q̇ δq̇ + g_z δz
/// ```
///
/// Equations: `docs/theory/reduction.md` (11)-(26).
#[derive(Debug)]
pub struct Tangent {
    blocks: ReducedBlocks,
    rows: Vec<f64>,
    rates: Vec<f64>,
    dq: Vec<f64>,
    dv: Vec<f64>,
    bend: Vec<f64>,
    force: Vec<f64>,
}

impl Tangent {
    /// At a complete point.
    pub fn new(point: &mut Point) -> Self {
        let mut blocks = ReducedBlocks::of_system(&point.manifold, &Threads::default());
        blocks.evaluate_system(&point.manifold, &point.state);
        let sizes = point.manifold.system().structure().sizes;
        let zeros = || vec![0.0; sizes.coordinates];
        Self {
            blocks,
            rows: vec![0.0; sizes.rows],
            rates: vec![0.0; point.manifold.chart().ndof()],
            dq: zeros(),
            dv: zeros(),
            bend: zeros(),
            force: zeros(),
        }
    }

    /// Entries of w.
    pub fn dimension(&self) -> usize {
        2 * self.rates.len() + self.blocks.blocks.extra_extra.states()
    }

    /// y = J x at the point of [`Tangent::new`], whose factors must be those of that state.
    ///
    /// # Errors
    /// `simulation/singular-mass`.
    pub fn multiply(
        &mut self,
        point: &mut Point,
        x: &[f64],
        y: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        let ndof = self.rates.len();
        let (p, rest) = x.split_at(ndof);
        let (v, z) = rest.split_at(ndof);
        let manifold = &mut point.manifold;
        let linear = manifold.chart().parametrization().linear();
        let (b, turning) = (&self.blocks.blocks, &self.blocks.turning);
        self.rows.fill(0.0);
        manifold.chart_mut().solve(&self.rows, p, &mut self.dq);
        self.rates.copy_from_slice(v);
        b.a0.multiply_add(-1.0, &self.dq, &mut self.rows);
        turning.multiply_many_add(-1.0, &self.dq, 1, &mut self.rates[linear..]);
        manifold.chart_mut().solve(&self.rows, &self.rates, &mut self.dv);
        self.rows.fill(0.0);
        self.rates.fill(0.0);
        b.a1.multiply_add(-1.0, &self.dq, &mut self.rows);
        b.a0.multiply_add(-2.0, &self.dv, &mut self.rows);
        let moving = &mut self.rates[linear..];
        self.blocks.turning_rate.multiply_many_add(-1.0, &self.dq, 1, moving);
        turning.multiply_many_add(-2.0, &self.dv, 1, moving);
        manifold.chart_mut().solve(&self.rows, &self.rates, &mut self.bend);
        self.force.fill(0.0);
        b.stiffness.multiply_add(-1.0, &self.dq, &mut self.force);
        b.damping.multiply_add(-1.0, &self.dv, &mut self.force);
        manifold.mass().multiply_add(-1.0, &self.bend, &mut self.force);
        let structure = manifold.system().clone();
        let structure = structure.structure();
        add_force_of_extra_states(structure, b, |k| -z[k], &mut self.force, 1);
        y[..ndof].copy_from_slice(v);
        manifold.respond(&point.state.q, &self.force, &mut y[ndof..2 * ndof])?;
        for (k, out) in y[2 * ndof..].iter_mut().enumerate() {
            let own: f64 = b.extra_extra.row(k).map(|(l, by)| by * z[l]).sum();
            *out = b.extra_rate(structure, k, &self.dq, &self.dv) + own;
        }
        Ok(())
    }
}
