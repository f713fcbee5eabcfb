//! The carried error where independent variables get another meaning.

use super::Run;
use crate::simulation::carried_error::Carried;

/// Largest change of a coordinate or velocity by which new variables are told.
const SHIFT: f64 = 1e-6;

impl Run<'_> {
    /// Keeps the carried error on coordinates and velocities before other variables are chosen.
    pub(super) fn spread_error(&mut self) {
        if let Some(carried) = &mut self.carried {
            carried.spread(self.form.as_mut());
        }
    }

    /// Expresses the carried error in new independent variables, which are w by now, by those of a state that is off by a
    /// small part of what [`Run::spread_error`] has kept.
    pub(super) fn express_error(&mut self) {
        let carried = self.carried.as_mut().filter(|carried| !carried.is_beyond());
        let Some(carried) = carried else { return };
        let ndof = self.form.second_order_split();
        let (row, state, shifted) = (&mut self.row, &self.state, &mut self.scratch[0]);
        row.t = state.t;
        row.z.copy_from_slice(&state.z);
        row.winding.copy_from_slice(&state.winding);
        for Carried { error, spread } in &mut carried.sums {
            let (before, after) = (error.len(), self.w.len());
            let extra = after - 2 * ndof;
            error.resize(before.max(after), 0.0);
            error.copy_within(before - extra..before, after - extra);
            error.truncate(after);
            let error = &mut error[..2 * ndof];
            let size = spread.iter().flatten().fold(0.0f64, |most, x| most.max(x.abs()));
            if size == 0.0 || !size.is_finite() {
                error.fill(0.0);
                continue;
            }
            let part = SHIFT / size;
            let shift = |to: &mut [f64], from: &[f64], by: &[f64]| {
                for ((to, from), by) in to.iter_mut().zip(from).zip(by) {
                    *to = from + part * by;
                }
            };
            shift(&mut row.q, &state.q, &spread[0]);
            shift(&mut row.v, &state.v, &spread[1]);
            self.form.pack(row, shifted);
            for ((e, shifted), w) in error.iter_mut().zip(&*shifted).zip(&self.w) {
                *e = (shifted - w) / part;
            }
        }
    }
}
