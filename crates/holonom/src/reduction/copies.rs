//! Scaled values of one matrix in another.

use std::sync::Arc;

/// Which value goes where, and times what. Scales of lengths and angles are few, so that entries are kept scale by scale.
#[derive(Debug, Clone)]
pub(super) struct Copies {
    /// (value, slot).
    entries: Arc<[(u32, u32)]>,
    /// Scales, each with the end of its entries.
    scales: Arc<[(f64, usize)]>,
}

impl Copies {
    /// From (value, slot, scale) of entries with a slot each of their own.
    pub(super) fn new(entries: impl IntoIterator<Item = (usize, usize, f64)>) -> Self {
        let mut all: Vec<(usize, usize, f64)> = entries.into_iter().collect();
        all.sort_by(|one, other| one.2.total_cmp(&other.2));
        let mut scales: Vec<(f64, usize)> = Vec::new();
        for (k, &(_, _, scale)) in all.iter().enumerate() {
            match scales.last_mut() {
                Some(last) if last.0 == scale => last.1 = k + 1,
                _ => scales.push((scale, k + 1)),
            }
        }
        let entries = all.iter().map(|&(at, slot, _)| (at as u32, slot as u32)).collect();
        Self { entries, scales: scales.into() }
    }

    /// Writes the values that `value` gives.
    pub(super) fn write(&self, value: impl Fn(usize) -> f64, out: &mut [f64]) {
        let mut start = 0;
        for &(scale, end) in &*self.scales {
            for &(at, slot) in &self.entries[start..end] {
                out[slot as usize] = value(at as usize) * scale;
            }
            start = end;
        }
    }
}
