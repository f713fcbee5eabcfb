//! Square matrices whose blocks hang on each other like the bodies of a forest.
//!
//! Every block row has a diagonal block E and, unless it is a root, one block F in the columns of its
//! parent. With parents first the matrix is block lower triangular:
//!
//! ```text
//! E_b x_b + F_b x_parent(b) = r_b        Eᵀ_b y_b = c_b − Σ Fᵀ_child y_child
//! ```
//!
//! so that nothing fills, and the blocks of 3 or 7 rows are factored by kernels of that size.

use crate::condition::condition_estimate;
use crate::error::SingularMatrix;
use crate::lanes::{Arithmetic, LaneKernel, MOST_LANES, Plain, lanes, lanes_mut, run_lanes};
use crate::sparse::parity;
use std::sync::Arc;

/// A pivot below this part of the largest number its row holds is cancellation noise.
const NEGLIGIBLE: f64 = 32.0 * f64::EPSILON;
const NONE: u32 = u32::MAX;

/// Which rows belong to which block, and the parent of each block. Columns are numbered block after block.
#[derive(Debug, PartialEq)]
pub struct BlockForest {
    size: usize,
    /// Parent of each block, and the blocks with parents first.
    parent: Vec<u32>,
    order: Vec<u32>,
    /// Rows of each block, ascending.
    rows: Vec<u32>,
    /// Block and place in it of each row.
    place: Vec<u32>,
    /// Sign of the permutation of rows.
    sign: f64,
}

impl BlockForest {
    /// The forest of a matrix with entries at these places, if it has that shape: with blocks of `size`
    /// (3 or 7) columns, hanging on the given parents, every row has entries in a block and its parent only,
    /// and as many rows belong to each block as it has columns. `order` has parents before children.
    pub fn find(
        size: usize,
        parents: &[Option<usize>],
        order: &[usize],
        entries: impl Iterator<Item = (usize, usize)>,
    ) -> Option<Self> {
        let count = parents.len();
        if ![3, 7].contains(&size) {
            return None;
        }
        let mut owner = vec![NONE; count * size];
        let is_parent = |above: usize, below: usize| parents[below] == Some(above);
        for (row, column) in entries {
            let block = column / size;
            let owner = &mut owner[row];
            if *owner == NONE || is_parent(*owner as usize, block) {
                *owner = block as u32;
            } else if *owner as usize != block && !is_parent(block, *owner as usize) {
                return None;
            }
        }
        let mut rows = vec![NONE; count * size];
        let mut place = vec![0; count * size];
        let mut filled = vec![0; count];
        for (row, &block) in owner.iter().enumerate() {
            let at = *filled.get(block as usize)?;
            if at == size {
                return None;
            }
            filled[block as usize] += 1;
            rows[block as usize * size + at] = row as u32;
            place[row] = (block as usize * size + at) as u32;
        }
        let permutation: Vec<usize> = place.iter().map(|&p: &u32| p as usize).collect();
        Some(Self {
            size,
            sign: parity(&permutation),
            parent: parents.iter().map(|p| p.map_or(NONE, |p| p as u32)).collect(),
            order: order.iter().map(|&b| b as u32).collect(),
            rows,
            place,
        })
    }

    /// Rows and columns of a block.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Number of blocks.
    #[allow(clippy::len_without_is_empty, reason = "a number of blocks, not a collection")]
    pub fn len(&self) -> usize {
        self.parent.len()
    }

    /// Parent of a block.
    pub fn parent(&self, block: usize) -> Option<usize> {
        Some(self.parent[block] as usize).filter(|_| self.parent[block] != NONE)
    }

    /// Blocks, parents before children.
    pub fn order(&self) -> impl DoubleEndedIterator<Item = usize> + '_ {
        self.order.iter().map(|&b| b as usize)
    }

    /// Rows of a block, in the order of its own rows.
    pub fn rows(&self, block: usize) -> &[u32] {
        &self.rows[block * self.size..(block + 1) * self.size]
    }

    /// Block and place in it of a row.
    pub fn place(&self, row: usize) -> (usize, usize) {
        (self.place[row] as usize / self.size, self.place[row] as usize % self.size)
    }

    /// Where the entry of a row and column stands among the values: per block E, then F, both by rows.
    pub fn slot(&self, row: usize, column: usize) -> usize {
        let (block, at) = self.place(row);
        let square = self.size * self.size;
        let side = usize::from(column / self.size != block);
        (2 * block + side) * square + at * self.size + column % self.size
    }

    /// Number of values: E and F of every block.
    pub fn values(&self) -> usize {
        2 * self.size * self.size * self.parent.len()
    }
}

/// The factored matrix. Of F its values serve, which solves are given once more.
#[derive(Debug, Clone)]
pub struct ForestLu {
    forest: Arc<BlockForest>,
    /// L and U of E with rows exchanged, block after block, by rows.
    factors: Vec<f64>,
    /// Row of E at each position of its factors.
    pivots: Vec<u8>,
    sign: f64,
    work: Vec<f64>,
    probe: Vec<f64>,
}

impl ForestLu {
    /// Room for the factors of a matrix of this shape.
    pub fn new(forest: Arc<BlockForest>) -> Self {
        let n = forest.size * forest.len();
        Self {
            factors: vec![0.0; n * forest.size],
            pivots: vec![0; n],
            sign: 1.0,
            work: vec![0.0; n],
            probe: vec![0.0; n],
            forest,
        }
    }

    /// Its shape.
    pub fn forest(&self) -> &Arc<BlockForest> {
        &self.forest
    }

    /// Makes room for several right-hand sides at a time; else the first solve for several does.
    pub fn reserve_lanes(&mut self) {
        self.work.resize(self.pivots.len() * MOST_LANES, 0.0);
    }

    /// Factors the matrix with these values, at [`BlockForest::slot`].
    ///
    /// # Errors
    /// [`SingularMatrix`] where a block is singular; the factors must not be used then.
    pub fn factor(&mut self, values: &[f64]) -> Result<(), SingularMatrix> {
        assert_eq!(values.len(), self.forest.values(), "E and F of every block");
        self.factors.resize(self.pivots.len() * self.forest.size, 0.0);
        match self.forest.size {
            3 => self.eliminate::<3>(values),
            _ => self.eliminate::<7>(values),
        }
    }

    fn eliminate<const N: usize>(&mut self, values: &[f64]) -> Result<(), SingularMatrix> {
        self.sign = 1.0;
        let (rows, _) = values.as_chunks::<N>();
        let (factors, _) = self.factors.as_chunks_mut::<N>();
        let (factors, _) = factors.as_chunks_mut::<N>();
        let (pivots, _) = self.pivots.as_chunks_mut::<N>();
        let blocks = rows.chunks_exact(2 * N).zip(factors).zip(pivots).enumerate();
        for (block, ((rows, e), pivots)) in blocks {
            e.copy_from_slice(&rows[..N]);
            match factor_block(e, pivots) {
                Ok(sign) => self.sign *= sign,
                Err((at, pivot)) => {
                    return Err(SingularMatrix {
                        row: self.forest.rows(block)[usize::from(pivots[at])] as usize,
                        column: block * N + at,
                        pivot,
                    });
                }
            }
        }
        self.sign *= self.forest.sign;
        Ok(())
    }

    /// Gives up the room for factors until the next factorisation.
    pub fn release(&mut self) {
        (self.factors, self.work, self.probe) = (Vec::new(), Vec::new(), Vec::new());
    }

    /// Takes over the factors of a matrix of the same shape.
    pub fn copy_from(&mut self, other: &Self) {
        self.factors.copy_from_slice(&other.factors);
        self.pivots.copy_from_slice(&other.pivots);
        self.sign = other.sign;
    }

    /// Estimate of the condition number ‖A‖₁‖A⁻¹‖₁ of the matrix of these values, which was factored last:
    /// never above the true number (but for round-off), seldom below a third of it.
    pub fn condition_estimate(&mut self, values: &[f64]) -> f64 {
        let forest = self.forest.clone();
        let size = forest.size;
        let mut x = std::mem::take(&mut self.probe);
        x.clear();
        x.resize(self.pivots.len(), 0.0);
        for (at, value) in values.iter().enumerate() {
            let (block, side) = (at / (size * size) / 2, at / (size * size) % 2);
            let block = if side == 0 { Some(block) } else { forest.parent(block) };
            if let Some(block) = block {
                x[block * size + at % size] += value.abs();
            }
        }
        let estimate =
            condition_estimate(&mut x, |x, transposed| self.substitute(values, x, 1, transposed));
        self.probe = x;
        estimate
    }

    /// Sign of det A: 1 or −1.
    pub fn determinant_sign(&self) -> f64 {
        self.sign
    }

    /// Entries that a solve reads.
    pub fn fill(&self) -> usize {
        self.forest.values()
    }

    /// Solves A X = B in place with the values that were factored; `b` is n×k by rows.
    ///
    /// # Panics
    /// If `b` has not n·k entries.
    pub fn solve_many(&mut self, values: &[f64], b: &mut [f64], k: usize) {
        self.substitute(values, b, k, false);
    }

    /// Solves Aᵀ X = B in place with the values that were factored; `b` is n×k by rows.
    ///
    /// # Panics
    /// If `b` has not n·k entries.
    pub fn solve_transposed_many(&mut self, values: &[f64], b: &mut [f64], k: usize) {
        self.substitute(values, b, k, true);
    }

    fn substitute(&mut self, values: &[f64], b: &mut [f64], k: usize, transposed: bool) {
        let n = self.pivots.len();
        assert_eq!(b.len(), n * k, "right-hand sides of a matrix of {n} rows");
        let room = n * k.min(MOST_LANES);
        if self.work.len() < room {
            self.work.resize(room, 0.0);
        }
        let mut kernel = Substitution {
            forest: &self.forest,
            values,
            factors: &self.factors,
            pivots: &self.pivots,
            transposed,
            b,
            k,
            work: &mut self.work,
        };
        if k == 1 {
            kernel.run::<Plain, 1>(0);
        } else {
            run_lanes(k, &mut kernel);
        }
    }
}

/// LU of one block with the rows exchanged so that pivots are large in their rows; the diagonal of U holds
/// inverse pivots. Returns the sign of the determinant, or where it stopped.
#[inline(always)]
fn factor_block<const N: usize>(
    a: &mut [[f64; N]; N],
    pivots: &mut [u8; N],
) -> Result<f64, (usize, f64)> {
    let mut size: [f64; N] = std::array::from_fn(|i| a[i].iter().fold(0.0, |m, x| x.abs().max(m)));
    *pivots = std::array::from_fn(|i| i as u8);
    let mut sign = 1.0;
    for k in 0..N {
        let (mut best, mut ratio) = (k, 0.0);
        for i in k..N {
            let here = a[i][k].abs() / size[i];
            if here > ratio {
                (best, ratio) = (i, here);
            }
        }
        if best != k {
            a.swap(best, k);
            size.swap(best, k);
            pivots.swap(best, k);
            sign = -sign;
        }
        let pivot = a[k][k];
        // Written so that a NaN fails.
        let good = ratio > NEGLIGIBLE && pivot.is_finite();
        if !good {
            return Err((k, pivot));
        }
        sign *= pivot.signum();
        let inverse = 1.0 / pivot;
        let row = a[k];
        for other in &mut a[k + 1..] {
            let l = other[k] * inverse;
            other[k] = l;
            for j in k + 1..N {
                other[j] -= l * row[j];
            }
        }
        a[k][k] = inverse;
    }
    Ok(sign)
}

struct Substitution<'a> {
    forest: &'a BlockForest,
    values: &'a [f64],
    factors: &'a [f64],
    pivots: &'a [u8],
    transposed: bool,
    b: &'a mut [f64],
    k: usize,
    work: &'a mut [f64],
}

impl LaneKernel for Substitution<'_> {
    #[inline(always)]
    fn run<A: Arithmetic, const W: usize>(&mut self, from: usize) {
        match (self.forest.size, self.transposed) {
            (3, false) => self.forward::<A, 3, W>(from),
            (3, true) => self.backward::<A, 3, W>(from),
            (_, false) => self.forward::<A, 7, W>(from),
            (_, true) => self.backward::<A, 7, W>(from),
        }
    }
}

impl Substitution<'_> {
    /// x_b = E⁻¹(r_b − F x_parent), parents first.
    #[inline(always)]
    fn forward<A: Arithmetic, const N: usize, const W: usize>(&mut self, from: usize) {
        let (values, _) = self.values.as_chunks::<N>();
        let (factors, _) = self.factors.as_chunks::<N>();
        let (pivots, _) = self.pivots.as_chunks::<N>();
        let (rows, _) = self.forest.rows.as_chunks::<N>();
        let (x, _) = self.work.as_chunks_mut::<W>();
        for &block in &self.forest.order {
            let block = block as usize;
            let e = &factors[N * block..N * (block + 1)];
            let f = &values[2 * N * block + N..2 * N * (block + 1)];
            let mut r: [[f64; W]; N] =
                std::array::from_fn(|i| *lanes(self.b, self.k, rows[block][i] as usize, from));
            let parent = self.forest.parent[block];
            if parent != NONE {
                let above = &x[parent as usize * N..][..N];
                for i in 0..N {
                    for j in 0..N {
                        for w in 0..W {
                            r[i][w] = A::multiply_add(-f[i][j], above[j][w], r[i][w]);
                        }
                    }
                }
            }
            let mut y: [[f64; W]; N] = std::array::from_fn(|i| r[usize::from(pivots[block][i])]);
            for i in 1..N {
                for j in 0..i {
                    for w in 0..W {
                        y[i][w] = A::multiply_add(-e[i][j], y[j][w], y[i][w]);
                    }
                }
            }
            for i in (0..N).rev() {
                for j in i + 1..N {
                    for w in 0..W {
                        y[i][w] = A::multiply_add(-e[i][j], y[j][w], y[i][w]);
                    }
                }
                for w in 0..W {
                    y[i][w] *= e[i][i];
                }
            }
            x[block * N..][..N].copy_from_slice(&y);
        }
        for (i, x) in x[..self.pivots.len()].iter().enumerate() {
            *lanes_mut(self.b, self.k, i, from) = *x;
        }
    }

    /// y_b = E⁻ᵀ c_b, then c_parent −= Fᵀ y_b, children first.
    #[inline(always)]
    fn backward<A: Arithmetic, const N: usize, const W: usize>(&mut self, from: usize) {
        let (values, _) = self.values.as_chunks::<N>();
        let (factors, _) = self.factors.as_chunks::<N>();
        let (pivots, _) = self.pivots.as_chunks::<N>();
        let (rows, _) = self.forest.rows.as_chunks::<N>();
        let (c, _) = self.work.as_chunks_mut::<W>();
        for (i, c) in c[..self.pivots.len()].iter_mut().enumerate() {
            *c = *lanes(self.b, self.k, i, from);
        }
        for &block in self.forest.order.iter().rev() {
            let block = block as usize;
            let e = &factors[N * block..N * (block + 1)];
            let f = &values[2 * N * block + N..2 * N * (block + 1)];
            let mut y: [[f64; W]; N] = std::array::from_fn(|i| c[block * N + i]);
            for i in 0..N {
                for j in 0..i {
                    for w in 0..W {
                        y[i][w] = A::multiply_add(-e[j][i], y[j][w], y[i][w]);
                    }
                }
                for w in 0..W {
                    y[i][w] *= e[i][i];
                }
            }
            for i in (0..N).rev() {
                for j in i + 1..N {
                    for w in 0..W {
                        y[i][w] = A::multiply_add(-e[j][i], y[j][w], y[i][w]);
                    }
                }
            }
            let mut out = [[0.0; W]; N];
            for i in 0..N {
                out[usize::from(pivots[block][i])] = y[i];
            }
            let parent = self.forest.parent[block];
            if parent != NONE {
                let above = &mut c[parent as usize * N..][..N];
                for i in 0..N {
                    for j in 0..N {
                        for w in 0..W {
                            above[j][w] = A::multiply_add(-f[i][j], out[i][w], above[j][w]);
                        }
                    }
                }
            }
            for i in 0..N {
                *lanes_mut(self.b, self.k, rows[block][i] as usize, from) = out[i];
            }
        }
    }
}
