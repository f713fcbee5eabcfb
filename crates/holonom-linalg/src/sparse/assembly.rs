//! Matrices that are sums of scaled values of others: which value goes where.

use crate::scalar::Scalar;
use crate::watch::checkpoint;
use std::sync::Arc;

/// Numbers that could be computed in the time that an entry is listed in; for checkpoints.
const PER_ENTRY: usize = 4;

/// What a matrix is assembled from, kind by kind, while it is listed. What a kind is, is the caller's: a source, a
/// coefficient, a scale. Kinds are few: each is looked for among all.
#[derive(Debug)]
pub struct Terms<K> {
    places: Vec<(usize, usize)>,
    /// Of each kind (value of the source, which of the places).
    terms: Vec<(K, Vec<(u32, u32)>)>,
}

impl<K> Default for Terms<K> {
    fn default() -> Self {
        Self { places: Vec::new(), terms: Vec::new() }
    }
}

impl<K: Copy + PartialEq> Terms<K> {
    /// Lists values of a source with the places (row, column) where they are added.
    pub fn add(&mut self, kind: K, entries: impl IntoIterator<Item = (usize, (usize, usize))>) {
        let term = match self.terms.iter().position(|(listed, _)| *listed == kind) {
            Some(at) => at,
            None => {
                self.terms.push((kind, Vec::new()));
                self.terms.len() - 1
            }
        };
        let term = &mut self.terms[term].1;
        let before = self.places.len();
        for (at, place) in entries {
            term.push((at as u32, self.places.len() as u32));
            self.places.push(place);
        }
        checkpoint(PER_ENTRY * (self.places.len() - before));
    }

    /// Lists places of entries that others compute; returns which ones.
    pub fn keep(
        &mut self,
        places: impl IntoIterator<Item = (usize, usize)>,
    ) -> std::ops::Range<usize> {
        let before = self.places.len();
        self.places.extend(places);
        before..self.places.len()
    }

    /// All places (row, column) in the order in which they were listed.
    pub fn places(&self) -> &[(usize, usize)] {
        &self.places
    }

    /// The assembly into a matrix whose value `slots[e]` stands in the e-th place.
    pub fn in_slots(self, slots: &[usize]) -> Assembly<K> {
        let placed = |(kind, term): (K, Vec<(u32, u32)>)| Term {
            kind,
            entries: term.iter().map(|&(at, e)| (at, slots[e as usize] as u32)).collect(),
        };
        Assembly { terms: self.terms.into_iter().map(placed).collect() }
    }
}

/// Which values of which sources make the values of a matrix, and times what.
#[derive(Debug, Clone)]
pub struct Assembly<K> {
    terms: Arc<[Term<K>]>,
}

/// Entries of one kind: (value of the source, slot).
#[derive(Debug)]
struct Term<K> {
    kind: K,
    entries: Box<[(u32, u32)]>,
}

impl<K: Copy> Assembly<K> {
    /// Of nothing.
    pub fn none() -> Self {
        Self { terms: Arc::new([]) }
    }

    /// Adds up the matrix: `of` gives source and coefficient of each kind.
    pub fn sum<'a, T: Scalar>(&self, of: impl Fn(K) -> (&'a [f64], T), values: &mut [T]) {
        values.fill(T::ZERO);
        for Term { kind, entries } in &*self.terms {
            let (source, coefficient) = of(*kind);
            for &(at, slot) in entries {
                let value = &mut values[slot as usize];
                *value = *value + coefficient.scaled(source[at as usize]);
            }
        }
    }

    /// Writes a matrix to each of whose slots one value goes; what is not listed stays.
    pub fn write<'a>(&self, of: impl Fn(K) -> (&'a [f64], f64), values: &mut [f64]) {
        for Term { kind, entries } in &*self.terms {
            let (source, scale) = of(*kind);
            for &(at, slot) in entries {
                values[slot as usize] = source[at as usize] * scale;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sparse::SparsePattern;

    #[test] // truth: the definition, entry by entry
    fn a_sum_has_the_values_of_its_terms() {
        let (mass, stiffness) = ([2.0, 3.0], [5.0, 7.0, 11.0]);
        let mut terms = Terms::default();
        terms.add('m', [(0, (0, 0)), (1, (1, 1))]);
        terms.add('k', [(0, (0, 0)), (1, (0, 2)), (2, (2, 0))]);
        let kept = terms.keep([(2, 2)]);
        terms.add('m', [(1, (2, 0))]);
        let (pattern, slots) = SparsePattern::new(3, 3, terms.places());
        let own = slots[kept.start];
        let assembly = terms.in_slots(&slots);
        let mut values = vec![1.0; pattern.len()];
        let of = |kind| if kind == 'm' { (&mass[..], 1.0) } else { (&stiffness[..], 10.0) };
        assembly.sum(of, &mut values);
        assert_eq!(values[own], 0.0);
        let mut dense = [[0.0; 3]; 3];
        for (i, row) in dense.iter_mut().enumerate() {
            pattern.row(i).for_each(|(slot, j)| row[j] = values[slot]);
        }
        assert_eq!(dense, [[52.0, 0.0, 70.0], [0.0, 3.0, 0.0], [113.0, 0.0, 0.0]]);
    }

    #[test] // truth: the definition
    fn what_is_written_leaves_the_rest() {
        let mut terms = Terms::default();
        terms.add(2.0, [(1, (0, 0))]);
        terms.add(3.0, [(0, (1, 0))]);
        let (_, slots) = SparsePattern::new(2, 1, terms.places());
        let mut values = [0.0, 0.0, 9.0];
        terms.in_slots(&slots).write(|scale| (&[5.0, 7.0][..], scale), &mut values);
        assert_eq!(values, [14.0, 15.0, 9.0]);
    }
}
