//! Where the entries of the inflated and of the simplified matrix come from: their patterns, found once.

use super::blocks::ReducedBlocks;
use super::extra::Elimination;
use crate::reduction::{BodyRows, Manifold, Projection, structural_nonzeros};
use holonom_linalg::{Assembly, BlockMatrix, BlockPattern, Scalar, SparsePattern, Terms};

/// Which of the two matrices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    /// (11) to (14) of `docs/theory/newton.md`.
    Inflated,
    /// (22) there, without Ã₀ and Ã₁.
    Simplified,
}

/// Matrices whose values stand in the sum.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Source {
    Constant,
    Mass,
    Jacobian,
    Moving,
    A0,
    Turning,
    A1,
    TurningRate,
    Damping,
    Stiffness,
}

/// What a value is multiplied by.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Coefficient {
    One,
    /// γh and 2γh.
    GammaH,
    TwiceGammaH,
    /// βh² and βh²/γh.
    BetaH2,
    Ratio,
}

/// One entry of F_z E⁻¹ g_q or F_z E⁻¹ g_q̇: places in F_z and in the rows of rates, slot.
#[derive(Debug, Clone, Copy)]
struct ExtraEntry {
    force: u32,
    rate: u32,
    slot: u32,
}

/// Values that do not depend on the step, and the coefficients that do.
pub(super) struct Sum<'a, T> {
    pub(super) mass: &'a BlockMatrix,
    pub(super) blocks: &'a ReducedBlocks,
    pub(super) gamma_h: T,
    pub(super) beta_h2: T,
    /// βh²/γh.
    pub(super) ratio: T,
    pub(super) extra: &'a Elimination<T>,
}

/// Which stored values of K, C, A₀, A₁ have been different from zero, by more than round-off.
#[derive(Debug, Clone)]
pub(super) struct Nonzeros {
    stiffness: Vec<bool>,
    damping: Vec<bool>,
    a0: Vec<bool>,
    a1: Vec<bool>,
}

impl Nonzeros {
    /// None yet, of those that the matrix contains.
    pub(super) fn new(shape: Shape, blocks: &ReducedBlocks) -> Self {
        let b = &blocks.blocks;
        let none = |matrix: &BlockMatrix| vec![false; matrix.values().len()];
        let turning = |matrix| if shape == Shape::Inflated { none(matrix) } else { Vec::new() };
        Self {
            stiffness: none(&b.stiffness),
            damping: none(&b.damping),
            a0: turning(&b.a0),
            a1: turning(&b.a1),
        }
    }

    /// Marks what differs from zero by more than round-off; returns whether something new does.
    pub(super) fn observe(&mut self, blocks: &ReducedBlocks) -> bool {
        let b = &blocks.blocks;
        let mut new = false;
        for (flags, matrix) in [
            (&mut self.stiffness, &b.stiffness),
            (&mut self.damping, &b.damping),
            (&mut self.a0, &b.a0),
            (&mut self.a1, &b.a1),
        ] {
            if flags.is_empty() {
                continue;
            }
            let mut at = 0;
            for (_, _, rows, columns) in matrix.shapes() {
                let range = at..at + rows * columns;
                at = range.end;
                new |= observe_block(&mut flags[range.clone()], &matrix.values()[range], columns);
            }
        }
        new
    }
}

/// Marks what differs from zero in a block by rows, except what is round-off of a sum of as many terms as others in its
/// row and in its column have: terms that cancel leave that, and it is no more to the matrix than the errors of these others.
fn observe_block(flags: &mut [bool], values: &[f64], columns: usize) -> bool {
    let is_new = |flag: &bool, x: f64| !flag && x != 0.0;
    if !flags.iter().zip(values).any(|(flag, x)| is_new(flag, *x)) {
        return false;
    }
    let round_off = columns as f64 * f64::EPSILON;
    let rows = || values.chunks_exact(columns);
    let mut new = false;
    for (flags, row) in flags.chunks_exact_mut(columns).zip(rows()) {
        let largest = row.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        for (j, (flag, x)) in flags.iter_mut().zip(row).enumerate() {
            if is_new(flag, *x) {
                let other = rows().fold(0.0f64, |m, row| m.max(row[j].abs()));
                // What is not a number counts.
                *flag = x.is_nan() || x.abs() >= round_off * largest.min(other);
                new |= *flag;
            }
        }
    }
    new
}

/// The pattern with the source of every entry.
#[derive(Debug, Clone)]
pub(super) struct SumPattern {
    pattern: SparsePattern,
    assembly: Assembly<(Source, Coefficient)>,
    constants: Vec<f64>,
    by_position: Vec<ExtraEntry>,
    by_velocity: Vec<ExtraEntry>,
}

impl SumPattern {
    /// For the manifold's present parametrization, with the entries of K, C, A₀, A₁ that are marked.
    pub(super) fn new(shape: Shape, manifold: &Manifold, q: &[f64], nonzeros: &Nonzeros) -> Self {
        let structure = manifold.system().structure();
        let n = structure.sizes.coordinates;
        let parametrization = manifold.chart().parametrization();
        let rank = parametrization.kept.len();
        let (g_nonzero, m_nonzero) = structural_nonzeros(manifold.system().as_ref(), q);
        let mut kept = vec![None; structure.sizes.rows];
        for (k, &row) in parametrization.kept.iter().enumerate() {
            kept[row] = Some(k);
        }
        let row_of = |(row, j): (usize, usize)| kept[row].map(|k: usize| (k, j));
        let jacobian = marked(&structure.constraint_pattern, &g_nonzero);
        let mut terms = Terms::default();
        let mut constants = Vec::new();
        // Where forces and, of them, those by δq, δq̇, δq̈ and δλ stand.
        let (size, force, columns) = match shape {
            Shape::Inflated => (4 * n, 3 * n, [0, n, 2 * n, 3 * n]),
            Shape::Simplified => (n + rank, 0, [0, 0, 0, n]),
        };
        match shape {
            Shape::Inflated => {
                let curvature = [&nonzeros.a0, &nonzeros.a1]
                    .map(|nonzero| marked(&structure.constraint_pattern, nonzero));
                constants = add_levels(&mut terms, manifold, &jacobian, curvature, row_of);
            }
            Shape::Simplified => {
                let row = |e| row_of(e).map(|(k, j)| (n + k, j));
                terms.add((Source::Jacobian, Coefficient::One), placed(&jacobian, row));
            }
        }
        let mass = marked(&structure.mass_pattern, &m_nonzero);
        let damping = marked(&structure.stiffness_pattern, &nonzeros.damping);
        let stiffness = marked(&structure.stiffness_pattern, &nonzeros.stiffness);
        for (source, coefficient, entries, column) in [
            (Source::Stiffness, Coefficient::BetaH2, &stiffness, columns[0]),
            (Source::Damping, Coefficient::GammaH, &damping, columns[1]),
            (Source::Mass, Coefficient::One, &mass, columns[2]),
        ] {
            let place = |(i, j)| Some((force + i, column + j));
            terms.add((source, coefficient), placed(entries, place));
        }
        let transposed = |e| row_of(e).map(|(k, j)| (force + j, columns[3] + k));
        terms.add((Source::Jacobian, Coefficient::One), placed(&jacobian, transposed));
        let mut extra = Vec::new();
        for state in 0..structure.sizes.extra_states {
            for (by, i) in structure.extra_entries(state) {
                for (rate, j) in structure.extra_entries(state) {
                    extra.push((by, rate, (force + i, j)));
                }
            }
        }
        let by_position = terms.keep(extra.iter().map(|(.., place)| *place));
        let by_velocity = terms.keep(extra.iter().map(|(.., (i, j))| (*i, columns[1] + j)));
        let (pattern, slots) = SparsePattern::new(size, size, terms.places());
        let made = |kept: std::ops::Range<usize>| {
            let entries = extra.iter().zip(&slots[kept]).map(|(&(force, rate, _), &slot)| {
                let [force, rate, slot] = [force, rate, slot].map(|x| x as u32);
                ExtraEntry { force, rate, slot }
            });
            entries.collect()
        };
        let (by_position, by_velocity) = (made(by_position), made(by_velocity));
        Self { assembly: terms.in_slots(&slots), pattern, constants, by_position, by_velocity }
    }

    /// Where entries stand.
    pub(super) fn pattern(&self) -> &SparsePattern {
        &self.pattern
    }

    /// Number of entries.
    pub(super) fn len(&self) -> usize {
        self.pattern.len()
    }

    /// Sums the entries, with these values of G and of the moving rows of P.
    pub(super) fn fill<T: Scalar>(
        &self,
        sum: &Sum<'_, T>,
        jacobian: &[f64],
        moving: &BodyRows,
        values: &mut [T],
    ) {
        let b = &sum.blocks.blocks;
        let of = |(source, coefficient)| {
            let source = match source {
                Source::Constant => &self.constants[..],
                Source::Mass => sum.mass.values(),
                Source::Jacobian => jacobian,
                Source::Moving => moving.values(),
                Source::A0 => b.a0.values(),
                Source::Turning => sum.blocks.turning.values(),
                Source::A1 => b.a1.values(),
                Source::TurningRate => sum.blocks.turning_rate.values(),
                Source::Damping => b.damping.values(),
                Source::Stiffness => b.stiffness.values(),
            };
            let coefficient = match coefficient {
                Coefficient::One => T::from(1.0),
                Coefficient::GammaH => sum.gamma_h,
                Coefficient::TwiceGammaH => sum.gamma_h.scaled(2.0),
                Coefficient::BetaH2 => sum.beta_h2,
                Coefficient::Ratio => sum.ratio,
            };
            (source, coefficient)
        };
        self.assembly.sum(of, values);
        for (entries, rates, power) in [
            (&self.by_position, &sum.extra.by_position, sum.beta_h2),
            (&self.by_velocity, &sum.extra.by_velocity, sum.gamma_h),
        ] {
            let scale = sum.gamma_h * power;
            for e in entries {
                let product = rates[e.rate as usize].scaled(b.force_extra[e.force as usize]);
                let value = &mut values[e.slot as usize];
                *value = *value + scale * product;
            }
        }
    }
}

/// Entries of a matrix of blocks that can differ from zero, with their places among the values.
fn marked(matrix: &BlockPattern, nonzero: &[bool]) -> Vec<(usize, (usize, usize))> {
    let all = matrix.entries(0, 0).into_iter().enumerate();
    all.filter(|(at, _)| nonzero[*at]).collect()
}

/// Entries with a place in the sum.
fn placed(
    entries: &[(usize, (usize, usize))],
    place: impl Fn((usize, usize)) -> Option<(usize, usize)>,
) -> impl Iterator<Item = (usize, (usize, usize))> {
    entries.iter().filter_map(move |&(at, entry)| place(entry).map(|place| (at, place)))
}

/// (11) to (13): three levels of G̃, and Ã₀ and Ã₁ between them. Returns the constants.
fn add_levels(
    terms: &mut Terms<(Source, Coefficient)>,
    manifold: &Manifold,
    jacobian: &[(usize, (usize, usize))],
    [a0, a1]: [Vec<(usize, (usize, usize))>; 2],
    row_of: impl Fn((usize, usize)) -> Option<(usize, usize)>,
) -> Vec<f64> {
    let n = manifold.system().structure().sizes.coordinates;
    let parametrization = manifold.chart().parametrization();
    let (rank, linear) = (parametrization.kept.len(), parametrization.linear());
    let moving = manifold.chart().moving().entries();
    let moving: Vec<_> = moving.map(|(at, row, j)| (at, (rank + linear + row, j))).collect();
    let mut constants = Vec::new();
    let mut constant_entries = Vec::new();
    match &parametrization.projection {
        Projection::Selection(independent) => {
            for (k, &i) in independent.iter().enumerate() {
                constant_entries.push((constants.len(), (rank + k, i)));
                constants.push(1.0);
            }
        }
        Projection::Basis(rows) => {
            for (k, row) in rows.chunks_exact(n).enumerate() {
                for (i, &x) in row.iter().enumerate().filter(|(_, x)| **x != 0.0) {
                    constant_entries.push((constants.len(), (rank + k, i)));
                    constants.push(x);
                }
            }
        }
        Projection::Relative(_) => {}
    }
    let minus_one = constants.len();
    constants.push(-1.0);
    let own = 3 * n + rank;
    let minus: Vec<_> =
        (0..parametrization.ndof).map(|k| (minus_one, (rank + k, own + k))).collect();
    for level in 0..3 {
        let place = |(i, j): (usize, usize)| Some((level * n + i, level * n + j));
        let row = |e| row_of(e).and_then(place);
        terms.add((Source::Jacobian, Coefficient::One), placed(jacobian, row));
        terms.add((Source::Moving, Coefficient::One), placed(&moving, place));
        terms.add((Source::Constant, Coefficient::One), placed(&constant_entries, place));
        let rate = |(i, j)| Some((level * n + i, j));
        terms.add((Source::Constant, Coefficient::One), placed(&minus, rate));
    }
    for (level, column, source, turning, rows, coefficient) in [
        (1, 0, Source::A0, Source::Turning, &a0, Coefficient::Ratio),
        (2, 0, Source::A1, Source::TurningRate, &a1, Coefficient::BetaH2),
        (2, 1, Source::A0, Source::Turning, &a0, Coefficient::TwiceGammaH),
    ] {
        let place = |(i, j): (usize, usize)| Some((level * n + i, column * n + j));
        let row = |e| row_of(e).and_then(place);
        terms.add((source, coefficient), placed(rows, row));
        terms.add((turning, coefficient), placed(&moving, place));
    }
    constants
}
