//! Search for the pivot of least fill in many columns.

use super::ordering::{Active, Candidate, Eliminated};

/// Columns that are looked at before the best entry is taken.
const SEARCH: usize = 256;

/// What is known of the best entry of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Known {
    /// Nothing: the column has gained or lost entries.
    Nothing,
    /// What it was before one of its rows changed.
    Before,
    /// All.
    Now,
}

/// The best entries of columns, kept from pivot to pivot: an elimination changes a few columns of many. What changes
/// their rows only is looked at when the column would be chosen, so that a wide search takes about the time of
/// a near one, which looks at the same few lines each time anew.
pub(super) struct WideSearch {
    best: Vec<Option<Candidate>>,
    known: Vec<Known>,
}

impl WideSearch {
    pub(super) fn new(n: usize) -> Self {
        Self { best: vec![None; n], known: vec![Known::Nothing; n] }
    }

    /// The best entry of the columns that are looked at.
    pub(super) fn best_pivot(&mut self, active: &mut Active) -> Option<Candidate> {
        let single = active.single_row().and_then(|i| active.best_in_row(i, None));
        if single.is_some() {
            return single;
        }
        loop {
            let found = self.look(active)?;
            match &mut self.known[found.column] {
                known @ Known::Before => *known = Known::Nothing,
                _ => return Some(found),
            }
        }
    }

    fn look(&mut self, active: &mut Active) -> Option<Candidate> {
        let mut best: Option<Candidate> = None;
        let mut looked_at = 0;
        let mut next = active.next_column(None);
        while let Some(j) = next {
            if self.known[j] == Known::Nothing {
                (self.best[j], self.known[j]) = (active.shortest_in_column(j), Known::Now);
            }
            if let Some(found) = self.best[j] {
                let leader = best.map_or(found, |b| Candidate::or_better(b, found));
                best = Some(leader);
                looked_at += 1;
                if looked_at >= SEARCH || leader.fill == 0 {
                    break;
                }
            }
            next = active.next_column(Some(j));
        }
        best
    }

    /// A pivot has been eliminated.
    pub(super) fn note(&mut self, active: &Active, eliminated: &Eliminated) {
        for &(j, _) in &eliminated.row {
            self.known[j as usize] = Known::Nothing;
        }
        let pivot_column = eliminated.column.iter();
        for j in pivot_column.flat_map(|&i| active.columns_of(i as usize)) {
            if self.known[j] == Known::Now {
                self.known[j] = Known::Before;
            }
        }
    }
}
