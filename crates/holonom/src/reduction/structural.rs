//! Which entries of matrices can differ from zero, found at generic configurations.

use super::chart::Chart;
use super::parametrization::Projection;
use crate::system::System;
use std::sync::Arc;

/// Which entries of D (n×ndof, by rows) can differ from zero, found at a few generic configurations
/// near `q`; for a tangent plane all of them.
pub fn structural_null_space(system: &dyn System, chart: &Chart, q: &[f64]) -> Vec<bool> {
    let (n, ndof) = (q.len(), chart.ndof());
    if let Projection::Basis(_) = chart.parametrization().projection {
        return vec![true; n * ndof];
    }
    let mut chart = chart.clone();
    let mut g = system.structure().constraint_pattern.zeros();
    let mut d = vec![0.0; n * ndof];
    let mut nonzero = vec![false; n * ndof];
    let mut probe = q.to_vec();
    for round in 0..=3 {
        if round > 0 {
            disturb(q, round, &mut probe);
        }
        system.constraint_jacobian(&probe, &mut g);
        if chart.refactor(system, &probe, &g).is_ok() {
            chart.null_space(&mut d);
            for (flag, x) in nonzero.iter_mut().zip(&d) {
                *flag |= *x != 0.0;
            }
        }
    }
    nonzero
}

/// A fixed irrational walk around q: what vanishes at three such places vanishes everywhere.
pub fn disturb(q: &[f64], round: u32, probe: &mut [f64]) {
    for (i, (x, q)) in probe.iter_mut().zip(q).enumerate() {
        let phase = f64::from(round) * 0.618_033_988_749_895 * (i as f64 + 1.0);
        *x = q + 0.7 * (phase.fract() - 0.5) + 0.11;
    }
}

/// Which stored values of G and M can differ from zero, found at a few generic configurations.
pub fn structural_nonzeros(system: &dyn System, q: &[f64]) -> (Arc<[bool]>, Arc<[bool]>) {
    let structure = system.structure();
    let mut g = structure.constraint_pattern.zeros();
    let mut m = structure.mass_pattern.zeros();
    let mut probe = q.to_vec();
    let (mut g_nonzero, mut m_nonzero) =
        (vec![false; g.values().len()], vec![false; m.values().len()]);
    for round in 1..=3 {
        disturb(q, round, &mut probe);
        system.constraint_jacobian(&probe, &mut g);
        system.mass_matrix(&probe, &mut m);
        for (flag, x) in g_nonzero.iter_mut().zip(g.values()) {
            *flag |= *x != 0.0;
        }
        for (flag, x) in m_nonzero.iter_mut().zip(m.values()) {
            *flag |= *x != 0.0;
        }
    }
    (g_nonzero.into(), m_nonzero.into())
}
