//! Sizes, numbering and sparsity patterns of a system: everything that parameter values leave alone.

use super::Measure;
use crate::elements::ExtraRows;
use crate::threads::Threads;
use crate::topology::sharing_a_body;
use holonom_linalg::{BlockId, BlockMatrix, BlockPattern, Scalar};
use std::ops::Range;

/// Counts of a system.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Sizes {
    /// Moving bodies.
    pub bodies: usize,
    /// Generalized coordinates n.
    pub coordinates: usize,
    /// Coordinates per body.
    pub per_body: usize,
    /// Translations among the coordinates of a body (its first ones).
    pub translations: usize,
    /// Constraint rows m: joints, drivers, Euler-parameter normalisations.
    pub rows: usize,
    /// Rows of joints, drivers included.
    pub joint_rows: usize,
    /// Extra states.
    pub extra_states: usize,
    /// Elements that count turns.
    pub windings: usize,
}

/// The extra states of one element, which act on each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ExtraBlock {
    /// Its first state.
    pub first: usize,
    /// Number of its states.
    pub count: usize,
    /// Where its square of g_z begins.
    pub square: usize,
}

impl ExtraBlock {
    /// Its states.
    pub fn states(&self) -> Range<usize> {
        self.first..self.first + self.count
    }

    /// Its numbers of g_z, by rows.
    pub fn own(&self) -> Range<usize> {
        self.square..self.square + self.count * self.count
    }
}

/// A matrix of extra states by extra states, of which those of different elements do not couple.
#[derive(Debug, Clone)]
pub struct ExtraSquares {
    blocks: Vec<ExtraBlock>,
    /// The squares of the elements one after the other, by rows.
    pub values: Vec<f64>,
}

impl ExtraSquares {
    /// For elements with these states, in their order; all zero.
    pub(crate) fn new(blocks: &[ExtraBlock]) -> Self {
        let numbers = blocks.last().map_or(0, |block| block.own().end);
        Self { blocks: blocks.to_vec(), values: vec![0.0; numbers] }
    }

    /// Number of extra states.
    pub fn states(&self) -> usize {
        self.blocks.last().map_or(0, |block| block.states().end)
    }

    /// Entries of a row, with their columns.
    pub fn row(&self, state: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let block = self.block_of(state);
        let row = &self.values[block.square + (state - block.first) * block.count..];
        block.states().zip(row.iter().copied())
    }

    /// An entry, if its states are of one element.
    pub fn entry_mut(&mut self, row: usize, column: usize) -> Option<&mut f64> {
        let block = self.block_of(row);
        let at = block.square + (row - block.first) * block.count;
        block.states().contains(&column).then(|| &mut self.values[at + column - block.first])
    }

    fn block_of(&self, state: usize) -> ExtraBlock {
        self.blocks[self.blocks.partition_point(|block| block.first <= state) - 1]
    }
}

/// Rows of one joint or driver, and where they stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct JointRows {
    /// Its first row.
    pub row: usize,
    /// Number of its rows.
    pub rows: usize,
    /// Its bodies.
    pub bodies: [Option<usize>; 2],
    /// Its blocks of the constraint pattern, one for each body.
    pub blocks: [Option<BlockId>; 2],
}

/// Sizes and patterns; shared by all systems that differ in numbers only.
#[derive(Debug, Clone)]
pub struct Structure {
    /// Counts.
    pub sizes: Sizes,
    /// Blocks of G, A₀ and A₁ (m×n).
    pub constraint_pattern: BlockPattern,
    /// Blocks of M (n×n).
    pub mass_pattern: BlockPattern,
    /// Blocks of K and C (n×n).
    pub stiffness_pattern: BlockPattern,
    /// Bodies of each force.
    pub forces: Vec<[Option<usize>; 2]>,
    /// Bodies of each extra state: blocks of F_z (n×nz) and of g_q, g_q̇ (nz×n).
    pub extra_bodies: Vec<[Option<usize>; 2]>,
    /// Elements with extra states, in the order of these: the blocks of g_z.
    pub extra_blocks: Vec<ExtraBlock>,
    /// Joints, then drivers, in the order of their rows.
    pub joints: Vec<JointRows>,
    /// What each constraint row measures.
    pub row_measure: Vec<Measure>,
    /// Normalisation rows start here; row `normalization_start + b` belongs to body b (spatial).
    pub normalization_start: usize,
}

impl Sizes {
    /// Whether bodies move in a plane.
    pub fn is_planar(&self) -> bool {
        self.translations == 2
    }

    /// Angle, rad, of a change by 1 of the coordinates that say how a body is turned: Euler parameters turn by half the angle.
    pub fn angle_factor(&self) -> f64 {
        if self.is_planar() { 1.0 } else { 2.0 }
    }

    /// The coordinates of a body: its translations, then its angle or Euler parameters.
    pub fn of_body(&self, body: usize) -> Range<usize> {
        body * self.per_body..(body + 1) * self.per_body
    }

    /// Those that say where it stands.
    pub fn translations_of(&self, body: usize) -> Range<usize> {
        let own = self.of_body(body);
        own.start..own.start + self.translations
    }

    /// Those that say how it is turned.
    pub fn rotations_of(&self, body: usize) -> Range<usize> {
        let own = self.of_body(body);
        own.start + self.translations..own.end
    }

    /// The parts of a vector over all coordinates that belong to single bodies: of their translations and of their rotations.
    pub fn by_body<'a>(&self, x: &'a [f64]) -> impl Iterator<Item = [&'a [f64]; 2]> + use<'a> {
        let translations = self.translations;
        x.chunks_exact(self.per_body).map(move |own| own.split_at(translations).into())
    }

    /// The body that a coordinate belongs to, and its place there.
    pub fn place_of(&self, coordinate: usize) -> (usize, usize) {
        (coordinate / self.per_body, coordinate % self.per_body)
    }

    /// Numbers of a twist.
    fn per_twist(&self) -> usize {
        self.translations * (self.translations + 1) / 2
    }
}

impl Structure {
    /// What a coordinate measures.
    pub fn coordinate_measure(&self, coordinate: usize) -> Measure {
        if self.sizes.place_of(coordinate).1 < self.sizes.translations {
            Measure::Length
        } else {
            Measure::Angle
        }
    }

    /// Entries of extra state `k` in F_z, g_q and g_q̇ that are not zero for good, with the coordinates that they belong to.
    pub fn extra_entries(&self, k: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        let n = self.sizes.per_body;
        let ends = self.extra_bodies[k].iter().enumerate();
        ends.filter_map(|(side, body)| body.map(|b| (side, self.sizes.of_body(b))))
            .flat_map(move |(side, own)| ((2 * k + side) * n..).zip(own))
    }

    /// Pairs of joints (by their place in `among`) that share a body: places of the blocks of G M⁻¹ Gᵀ off
    /// the diagonal.
    pub fn joint_pairs(&self, among: &[usize]) -> Vec<[usize; 2]> {
        let ends: Vec<_> = among.iter().map(|&joint| self.joints[joint].bodies).collect();
        sharing_a_body(self.sizes.bodies, &ends)
    }

    /// Buffers for the derivative blocks, which `threads` share the work of where there is enough of it.
    pub fn derivative_blocks(&self, threads: &Threads) -> DerivativeBlocks {
        let s = &self.sizes;
        let work = (s.bodies + self.joints.len()) * s.per_body * s.per_body;
        let threads = if work >= SHARED { threads.clone() } else { Threads::default() };
        DerivativeBlocks {
            time: vec![0.0; s.coordinates],
            threads,
            stiffness: self.stiffness_pattern.zeros(),
            damping: self.stiffness_pattern.zeros(),
            a0: self.constraint_pattern.zeros(),
            a1: self.constraint_pattern.zeros(),
            force_time: vec![0.0; s.coordinates],
            velocity_rhs_time: vec![0.0; s.rows],
            acceleration_rhs_time: vec![0.0; s.rows],
            force_extra: vec![0.0; s.extra_states * 2 * s.per_body],
            extra_position: vec![0.0; s.extra_states * 2 * s.per_body],
            extra_velocity: vec![0.0; s.extra_states * 2 * s.per_body],
            extra_extra: ExtraSquares::new(&self.extra_blocks),
            extra_motion: std::array::from_fn(|_| vec![0.0; s.extra_states * 2 * s.per_twist()]),
            extra_time: vec![0.0; s.extra_states],
        }
    }
}

/// Derivatives of the equations of motion at one state.
#[derive(Debug, Clone)]
pub struct DerivativeBlocks {
    /// K = F_q, with (M q̈)_q and (Gᵀλ)_q.
    pub stiffness: BlockMatrix,
    /// C = F_q̇.
    pub damping: BlockMatrix,
    /// A₀ = (G q̇ − ν)_q.
    pub a0: BlockMatrix,
    /// A₁ = (G q̈ − τ)_q.
    pub a1: BlockMatrix,
    /// F_t.
    pub force_time: Vec<f64>,
    /// ν_t.
    pub velocity_rhs_time: Vec<f64>,
    /// τ_t.
    pub acceleration_rhs_time: Vec<f64>,
    /// F_z: per extra state, the coordinates of its first and its second body.
    pub force_extra: Vec<f64>,
    /// g_q, in the same layout.
    pub extra_position: Vec<f64>,
    /// g_q̇, in the same layout.
    pub extra_velocity: Vec<f64>,
    /// g_z.
    pub extra_extra: ExtraSquares,
    /// g_t.
    pub extra_time: Vec<f64>,
    /// Per extra state and body, on motions as in [`WrenchBlocks`]: −w_z, and ż by displacements and by twists.
    pub extra_motion: [Vec<f64>; 3],
    pub(super) threads: Threads,
    /// F_t in another order.
    pub(super) time: Vec<f64>,
}

/// Derivatives of one force on the motions of its bodies. Per body W numbers of a displacement or twist, of the centre of mass
/// and angular, or of a wrench, force and moment about it, ground axes: three in the plane, six in space. Those of wrenches are
/// of −w, and of twists and displacements each is varied with the components of the other one fixed.
#[derive(Debug, Clone, Copy)]
pub struct WrenchBlocks<'a> {
    /// By displacements, `[felt][moved][row][column]`.
    pub stiffness: &'a [f64],
    /// By twists; none where they do not count.
    pub damping: Option<&'a [f64]>,
    /// By time, for both bodies.
    pub time: &'a [f64],
}

/// Bodies and joints times the square of a body's coordinates from which threads share the work: see the same of the
/// elimination of trees, which these blocks go before.
const SHARED: usize = 20_000;

impl DerivativeBlocks {
    /// Who shares the work.
    pub fn threads(&self) -> &Threads {
        &self.threads
    }

    /// Where one element's rows of `extra_motion`, g_z and g_t go.
    pub(super) fn extra_rows<const W: usize>(
        &mut self,
        block: ExtraBlock,
    ) -> ExtraRows<'_, f64, W> {
        let [force, by_displacement, by_twist] = self.extra_motion.each_mut().map(|all| {
            let rows = all.as_chunks_mut::<W>().0.as_chunks_mut::<2>().0;
            &mut rows[block.states()]
        });
        let own = &mut self.extra_extra.values[block.own()];
        let time = &mut self.extra_time[block.states()];
        ExtraRows { force, by_displacement, by_twist, own, time }
    }

    /// g_q δq + g_q̇ δq̇ of extra state `k`.
    pub fn extra_rate<T: Scalar>(&self, structure: &Structure, k: usize, dq: &[T], dv: &[T]) -> T {
        structure.extra_entries(k).fold(T::ZERO, |sum, (at, j)| {
            sum + dq[j].scaled(self.extra_position[at]) + dv[j].scaled(self.extra_velocity[at])
        })
    }
}
