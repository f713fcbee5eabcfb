//! What every representation starts from: blocks of the point, extra states, and the measure of changes.

use super::blocks::ReducedBlocks;
use super::differences::Differences;
use super::extra::Elimination;
use crate::error::EvaluationFailure;
use crate::reduction::{Chart, Manifold, Point};
use crate::system::System;
use crate::threads::Threads;
use holonom_linalg::{Arithmetic, Wide, run_wide};
use std::sync::Arc;

/// The blocks of the last linearization with the coefficients of the last factor.
#[derive(Debug, Clone)]
pub struct Linearization {
    pub(super) system: Arc<dyn System>,
    pub(super) blocks: ReducedBlocks,
    /// [G; P] at the linearization; before the first one, at the start of the step.
    pub(super) chart: Chart,
    /// Whether there has been one, and whether it was made along the tree.
    pub(super) made: bool,
    pub(super) along: bool,
    /// Where it was.
    pub(super) q: Vec<f64>,
    pub(super) v: Vec<f64>,
    /// Changes are measured with D and q̇_v at fixed v̇, where these are small enough.
    pub(super) maps: bool,
    /// q̇_v at fixed v̇, n×ndof.
    rate_map: Vec<f64>,
    /// Columns of D and of q̇_v at fixed v̇, for one variable after the other.
    columns: Vec<f64>,
    /// Variables that move each body, and where those of the next one begin.
    movers: Vec<usize>,
    mover_ends: Vec<usize>,
    /// In their order, what the columns of each are on the coordinates of the body, filled up to fours.
    moved: Vec<f64>,
    pub(super) gamma_h: f64,
    pub(super) beta_h2: f64,
    pub(super) extra: Elimination<f64>,
    /// Whether the blocks are reduced ones; otherwise those of the system alone.
    reduced: bool,
    rows: Vec<f64>,
    rates: Vec<f64>,
    /// δq and δq̇ of a change, for extra states where the blocks are not reduced.
    dq: Vec<f64>,
    dv: Vec<f64>,
}

impl Linearization {
    /// `reduced` for dense blocks of order ndof.
    pub(super) fn new(manifold: &Manifold, reduced: bool, threads: &Threads) -> Self {
        let s = manifold.system().structure().sizes;
        let ndof = manifold.chart().ndof();
        let spread = if reduced || s.extra_states == 0 { 0 } else { s.coordinates };
        Self {
            system: manifold.system().clone(),
            blocks: if reduced {
                ReducedBlocks::new(manifold, threads)
            } else {
                ReducedBlocks::of_system(manifold, threads)
            },
            chart: manifold.chart().clone(),
            made: false,
            along: false,
            q: vec![0.0; s.coordinates],
            v: vec![0.0; s.coordinates],
            maps: false,
            rate_map: vec![0.0; if reduced { s.coordinates * ndof } else { 0 }],
            columns: vec![0.0; if reduced { 2 * s.coordinates * ndof } else { 0 }],
            movers: Vec::with_capacity(if reduced { s.bodies * ndof } else { 0 }),
            mover_ends: Vec::with_capacity(if reduced { s.bodies } else { 0 }),
            moved: Vec::with_capacity(if reduced {
                2 * s.bodies * s.per_body.next_multiple_of(4) * ndof
            } else {
                0
            }),
            gamma_h: 0.0,
            beta_h2: 0.0,
            extra: Elimination::new(manifold.system().structure()),
            reduced,
            rows: vec![0.0; s.rows],
            rates: vec![0.0; ndof],
            dq: vec![0.0; spread],
            dv: vec![0.0; spread],
        }
    }

    pub(super) fn begin_step(&mut self, chart: &Chart) {
        if !self.made {
            self.chart.copy_from(chart);
        }
    }

    /// All reduced blocks and q̇_v by differences at a complete point.
    pub(super) fn take_differences(
        &mut self,
        differences: &mut Differences,
        point: &mut Point,
        w: &[f64],
    ) -> Result<(), EvaluationFailure> {
        differences.evaluate(&mut self.blocks, &mut self.rate_map, point, w)?;
        self.chart.copy_from(point.manifold.chart());
        (self.made, self.maps, self.along) = (true, true, false);
        self.keep_maps();
        Ok(())
    }

    /// q̇_v at fixed v̇ at the state of the blocks, if changes are to be measured with it.
    pub(super) fn evaluate_maps(&mut self, chart: &mut Chart) {
        self.maps = 3 * self.blocks.d.len() <= 8 * chart.fill();
        if self.maps {
            self.blocks.rate_map(chart, &mut self.rate_map);
            self.keep_maps();
        } else {
            self.chart.copy_from(chart);
        }
    }

    /// All reduced blocks along the tree; changes are measured with what the recursions find on the way.
    pub(super) fn evaluate_along(&mut self, point: &mut Point) {
        if !self.along {
            // What a variable does not move stays zero from here on.
            self.columns.fill(0.0);
        }
        self.blocks.evaluate_along(&mut point.manifold, &point.state, &mut self.columns);
        (self.maps, self.along) = (true, true);
        self.find_movers();
    }

    fn keep_maps(&mut self) {
        let ndof = self.rates.len().max(1);
        let size = (2 * self.q.len()).max(1);
        for (k, column) in self.columns.chunks_exact_mut(size).enumerate() {
            let (d, rates) = column.split_at_mut(column.len() / 2);
            for (to, from) in [(d, &self.blocks.d), (rates, &self.rate_map)] {
                let from = from[k..].iter().step_by(ndof);
                to.iter_mut().zip(from).for_each(|(to, from)| *to = *from);
            }
        }
        self.find_movers();
    }

    fn find_movers(&mut self) {
        let (n, sizes) = (self.q.len(), self.system.structure().sizes);
        self.movers.clear();
        self.mover_ends.clear();
        self.moved.clear();
        for b in 0..sizes.bodies {
            let own = sizes.of_body(b);
            for (k, column) in self.columns.chunks_exact(2 * n).enumerate() {
                let (d, rates) = (&column[own.clone()], &column[n..][own.clone()]);
                if d.iter().chain(rates).any(|x| *x != 0.0) {
                    self.movers.push(k);
                    for own in [d, rates] {
                        self.moved.extend_from_slice(own);
                        self.moved.resize(self.moved.len().next_multiple_of(4), 0.0);
                    }
                }
            }
            self.mover_ends.push(self.movers.len());
        }
    }

    pub(super) fn set_coefficients(&mut self, gamma_h: f64, beta_h2: f64) {
        (self.gamma_h, self.beta_h2) = (gamma_h, beta_h2);
        if !self.extra.is_empty() {
            let (reduced, system) = (&self.blocks, &self.blocks.blocks);
            let rates = if self.reduced {
                [&reduced.extra_position, &reduced.extra_velocity]
            } else {
                [&system.extra_position, &system.extra_velocity]
            };
            self.extra.factor(gamma_h, &reduced.extra_extra, rates.map(|rows| &rows[..]));
        }
    }

    /// z ← z + E⁻¹ γh (ż_v δv + ż_v̇ δv̇).
    pub(super) fn add_effect_on_extra_states(&mut self, p: &[f64], v: &[f64], z: &mut [f64]) {
        if z.is_empty() {
            return;
        }
        if self.reduced {
            for (k, z) in z.iter_mut().enumerate() {
                *z += self.gamma_h * self.extra.reduced_rate(k, p, v);
            }
            return;
        }
        let (mut dq, mut dv) = (std::mem::take(&mut self.dq), std::mem::take(&mut self.dv));
        self.spread(p, v, &mut dq, &mut dv);
        let structure = self.system.structure();
        for (k, z) in z.iter_mut().enumerate() {
            *z += self.gamma_h * self.extra.rate(structure, k, &dq, &dv);
        }
        (self.dq, self.dv) = (dq, dv);
    }

    /// What δv̈ does to w: βh² δv̈, γh δv̈, and the rest of δz.
    pub(super) fn effect(&mut self, rate: &[f64], change: &mut [f64]) {
        let (head, z) = change.split_at_mut(2 * rate.len());
        let (p, v) = head.split_at_mut(rate.len());
        for ((p, v), a) in p.iter_mut().zip(&mut *v).zip(rate) {
            *p = self.beta_h2 * a;
            *v = self.gamma_h * a;
        }
        self.add_effect_on_extra_states(p, v, z);
    }

    /// Changes of v and v̇ on all coordinates.
    pub(super) fn spread(&mut self, p: &[f64], v: &[f64], dq: &mut [f64], dv: &mut [f64]) {
        if self.made && self.maps {
            if self.system.structure().sizes.is_planar() {
                run_wide(Spread::<3, 4> { by: self, change: [p, v], to: [dq, dv] });
            } else {
                run_wide(Spread::<7, 8> { by: self, change: [p, v], to: [dq, dv] });
            }
            return;
        }
        self.rows.fill(0.0);
        self.chart.solve(&self.rows, p, dq);
        self.rates.copy_from_slice(v);
        if self.made {
            self.blocks.blocks.a0.multiply_add(-1.0, dq, &mut self.rows);
            let moving = &mut self.rates[self.chart.parametrization().linear()..];
            self.blocks.turning.multiply_many_add(-1.0, dq, 1, moving);
        }
        self.chart.solve(&self.rows, &self.rates, dv);
    }
}

/// Changes of N coordinates of each body and of their rates, by the columns of M numbers of what moves it.
struct Spread<'a, const N: usize, const M: usize> {
    by: &'a Linearization,
    change: [&'a [f64]; 2],
    to: [&'a mut [f64]; 2],
}

impl<const N: usize, const M: usize> Wide for Spread<'_, N, M> {
    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        let Self { by, change: [p, v], to: [dq, dv] } = self;
        let (columns, _) = by.moved.as_chunks::<M>();
        let (columns, _) = columns.as_chunks::<2>();
        let mut first = 0;
        let bodies = dq.as_chunks_mut::<N>().0.iter_mut().zip(dv.as_chunks_mut::<N>().0);
        for ((dq, dv), &end) in bodies.zip(&by.mover_ends) {
            let (mut change, mut rate_change) = ([0.0; M], [0.0; M]);
            for ([d, rates], &k) in columns[first..end].iter().zip(&by.movers[first..end]) {
                let (p, v) = (p[k], v[k]);
                for i in 0..M {
                    change[i] = A::multiply_add(p, d[i], change[i]);
                    let moved = A::multiply_add(v, d[i], rate_change[i]);
                    rate_change[i] = A::multiply_add(p, rates[i], moved);
                }
            }
            dq.copy_from_slice(&change[..N]);
            dv.copy_from_slice(&rate_change[..N]);
            first = end;
        }
    }
}
