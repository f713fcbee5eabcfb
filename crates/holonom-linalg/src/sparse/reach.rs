//! Where solutions are zero, as the pattern of the factors tells.

use super::{Order, SparseLu};
use crate::scalar::Scalar;
use std::ops::Range;
use std::sync::Arc;

/// A choice of pivots, which is equal to itself and its copies only.
#[derive(Debug, Clone)]
pub struct Pivots(Arc<Order>);

impl PartialEq for Pivots {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl<T: Scalar> SparseLu<T> {
    /// The present pivots.
    pub fn pivots(&self) -> Pivots {
        Pivots(self.order.clone())
    }

    /// Of up to 32 right-hand sides `columns` have a bit for each that can differ from zero in a row. They become those of the
    /// solutions, with the transpose or not, which are exactly zero elsewhere with these pivots, whatever finite values they have.
    ///
    /// # Panics
    /// If there are not columns for every row.
    pub fn reach(&self, transposed: bool, columns: &mut [u32], room: &mut Vec<u32>) {
        assert_eq!(columns.len(), self.n, "columns for every row");
        let (plan, order) = (&self.factors.plan, &self.order);
        let (rows, places) = (&order.row_at, &order.column_at);
        let [source, target] = if transposed { [places, rows] } else { [rows, places] };
        room.clear();
        room.extend(source.iter().map(|&i| columns[i]));
        let mut pass = |row: u32, side: Range<u32>| {
            for &j in &plan.columns[side.start as usize..side.end as usize] {
                let [from, to] = if transposed { [row, j] } else { [j, row] };
                room[to as usize] |= room[from as usize];
            }
        };
        let [first, second] =
            if transposed { [&plan.right, &plan.left] } else { [&plan.left, &plan.right] };
        first.iter().for_each(|side| pass(side.row, side.start..side.end));
        second.iter().rev().for_each(|side| pass(side.row, side.start..side.end));
        target.iter().zip(&*room).for_each(|(&i, reached)| columns[i] = *reached);
    }
}
