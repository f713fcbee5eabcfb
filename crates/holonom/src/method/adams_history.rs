//! What the steps of an Adams formula leave behind: differences of slopes, order and length of the last step.

use super::stepper::add_scaled;
use crate::formula::{ADAMS_MAX_ORDER, adams_interpolation, adams_polynomials};

/// Differences up to order k + 2.
const COLUMNS: usize = ADAMS_MAX_ORDER + 2;

/// What a step leaves behind.
#[derive(Debug, Clone)]
pub(super) struct History {
    /// Order of the next step; 0 before the first.
    pub(super) order: usize,
    /// Order and length of the last step.
    pub(super) last_order: usize,
    pub(super) last_step: f64,
    /// Number of steps taken with that length, up to the order plus 1.
    pub(super) same_steps: usize,
    /// Orders and steps are still being raised from the start.
    pub(super) starting: bool,
    /// ψᵢ of the last step.
    pub(super) psi: [f64; ADAMS_MAX_ORDER + 1],
    /// Modified divided differences φ₁ … φ_{k+2} of the slopes.
    pub(super) phi: [Vec<f64>; COLUMNS],
    /// State at the end of the last step.
    pub(super) end: Vec<f64>,
    /// Consecutive steps of order 4 or less, or whose error one correction has left.
    pub(super) suspect: u32,
}

impl History {
    /// None of a system of `n` unknowns.
    pub(super) fn new(n: usize) -> Self {
        Self {
            order: 0,
            last_order: 0,
            last_step: 0.0,
            same_steps: 0,
            starting: true,
            psi: [0.0; ADAMS_MAX_ORDER + 1],
            phi: std::array::from_fn(|_| vec![0.0; n]),
            end: vec![0.0; n],
            suspect: 0,
        }
    }

    /// Number of columns of φ in use.
    fn columns(&self) -> usize {
        (self.last_order + 2).min(COLUMNS)
    }

    /// Takes over another one, but for the state at its end.
    pub(super) fn copy_from(&mut self, other: &Self) {
        for (to, from) in self.phi.iter_mut().zip(&other.phi).take(other.columns()) {
            to.copy_from_slice(from);
        }
        self.order = other.order;
        self.last_order = other.last_order;
        self.last_step = other.last_step;
        self.same_steps = other.same_steps;
        self.starting = other.starting;
        self.psi = other.psi;
        self.suspect = other.suspect;
    }

    /// Makes it end at slope `g`. All differences contain the newest slope with
    /// coefficient 1, so a slope that the caller has changed (a projected state) is exchanged
    /// exactly, the slopes before it staying as they are.
    pub(super) fn end_at(&mut self, g: &[f64]) {
        if self.order == 0 {
            self.phi[0].copy_from_slice(g);
            self.phi[1].fill(0.0);
            (self.order, self.last_order, self.last_step) = (1, 0, 0.0);
            (self.same_steps, self.starting, self.suspect) = (0, true, 0);
        } else {
            let columns = self.columns();
            for i in 0..g.len() {
                let change = g[i] - self.phi[0][i];
                if change != 0.0 {
                    for column in self.phi.iter_mut().take(columns) {
                        column[i] += change;
                    }
                }
            }
        }
    }

    /// w at a part `theta` of the last step.
    pub(super) fn interpolate(&self, theta: f64, w: &mut [f64]) {
        let s = (theta - 1.0) * self.last_step;
        let g = adams_interpolation(self.last_order, s, &self.psi);
        w.copy_from_slice(&self.end);
        for i in 0..=self.last_order {
            add_scaled(w, s * g[i], &self.phi[i]);
        }
    }

    /// Coefficients of the powers of θ in it; returns the degree.
    pub(super) fn polynomial(&self, coefficients: &mut [f64]) -> usize {
        let (n, degree) = (self.end.len(), self.last_order + 1);
        let rows = adams_polynomials(self.last_order, self.last_step, &self.psi);
        for j in 0..=degree {
            let out = &mut coefficients[j * n..(j + 1) * n];
            if j == 0 {
                out.copy_from_slice(&self.end);
            } else {
                out.fill(0.0);
            }
            for (row, phi) in rows.iter().zip(&self.phi).take(degree) {
                add_scaled(out, row[j], phi);
            }
        }
        degree
    }

    /// It as numbers, for checkpoints.
    pub(super) fn numbers(&self) -> Vec<f64> {
        let whole = [self.order, self.last_order, self.same_steps, usize::from(self.starting)];
        let mut numbers: Vec<f64> = whole.iter().map(|&k| k as f64).collect();
        numbers.extend([f64::from(self.suspect), self.last_step]);
        numbers.extend_from_slice(&self.psi);
        for column in self.phi.iter().take(self.columns()) {
            numbers.extend_from_slice(column);
        }
        numbers
    }

    /// Becomes what [`History::numbers`] says; false where these are of no history of as many unknowns.
    pub(super) fn recall(&mut self, numbers: &[f64]) -> bool {
        let most = ADAMS_MAX_ORDER as f64;
        let Some((&[order, last_order, same_steps, starting, suspect, last_step], rest)) =
            numbers.split_first_chunk()
        else {
            return false;
        };
        let n = self.end.len();
        let Some((psi, columns)) = rest.split_first_chunk() else { return false };
        let known = (0.0..=most).contains(&order)
            && (0.0..=most).contains(&last_order)
            && order <= last_order + 1.0
            && (0.0..=most + 2.0).contains(&same_steps)
            && (order == 0.0 || last_step > 0.0)
            && numbers.iter().all(|x| x.is_finite());
        if !known {
            return false;
        }
        self.psi = *psi;
        (self.order, self.last_order) = (order as usize, last_order as usize);
        (self.same_steps, self.starting) = (same_steps as usize, starting != 0.0);
        (self.suspect, self.last_step) = (suspect as u32, last_step);
        if columns.len() != n * self.columns() {
            return false;
        }
        for (column, stored) in self.phi.iter_mut().zip(columns.chunks_exact(n.max(1))) {
            column.copy_from_slice(stored);
        }
        true
    }
}
