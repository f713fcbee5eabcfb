//! Where D, Y and W are zero at any state: a variable moves some of the bodies, and loads some of the joints.

use crate::reduction::{BodyRows, Chart, Manifold};
use crate::system::DerivativeBlocks;
use holonom_linalg::{GRAM_ROWS, Pivots, Span};

/// Columns that can differ from zero, as the factors of [G; P] tell by their pattern, for the products that take them. There
/// are none where all columns are taken: the factors are those of a forest, their solutions are refined, or variables are many.
#[derive(Debug, Clone, Default)]
pub(super) struct Zeros {
    /// Of the factors that told.
    pivots: Option<Pivots>,
    /// Of D for blocks of M, and of K and C.
    pub(super) mass: Vec<Span>,
    pub(super) forces: Vec<Span>,
    /// Of Y and W for blocks of A₀ and A₁.
    pub(super) y: Vec<Span>,
    pub(super) w: Vec<Span>,
    /// Of D for [`GRAM_ROWS`] rows each.
    pub(super) d: Vec<Span>,
    room: Room,
}

/// By a bit for each column: of D, of a product with it, and of all rows of a solution.
#[derive(Debug, Clone, Default)]
struct Room {
    d: Vec<u32>,
    x: Vec<u32>,
    rows: Vec<u32>,
    work: Vec<u32>,
}

impl Room {
    /// Of X those of SᵀX, and below them those of DᵀX for rows of P that move, whose part of the next X is added to it.
    fn solve(&mut self, chart: &Chart, turning: &BodyRows) {
        let parametrization = chart.parametrization();
        chart.reach(true, &mut self.x, &mut self.work);
        self.rows.fill(0);
        for (&row, columns) in parametrization.kept.iter().zip(&self.x) {
            self.rows[row] = *columns;
        }
        let below = parametrization.kept.len() + parametrization.linear();
        self.work.clear();
        self.work.extend(&self.x[below..]);
        self.x.fill(0);
        turning.entries().for_each(|(_, row, j)| self.x[j] |= self.work[row]);
    }
}

impl Zeros {
    /// Finds them anew if the factors have other pivots than before.
    pub(super) fn update(
        &mut self,
        manifold: &Manifold,
        blocks: &DerivativeBlocks,
        turning: &BodyRows,
    ) {
        let chart = manifold.chart();
        let (pivots, ndof) = (chart.pivots(), chart.ndof());
        if ndof > Span::MOST || self.pivots == pivots {
            return;
        }
        let Self { mass, forces, y, w, d, room, .. } = self;
        for spans in [&mut *mass, forces, y, w, d] {
            spans.clear();
        }
        self.pivots = pivots;
        if self.pivots.is_none() {
            return;
        }
        let n = blocks.a0.n_cols();
        room.d.resize(n, 0);
        room.d.fill(0);
        room.d[n - ndof..].iter_mut().enumerate().for_each(|(k, x)| *x = 1 << k);
        chart.reach(false, &mut room.d, &mut room.work);
        let parts = room.d.chunks(GRAM_ROWS).map(|rows| rows.iter().fold(0, |all, x| all | x));
        d.extend(parts.map(Span::of));
        room.rows.resize(blocks.a0.n_rows(), 0);
        room.x.resize(n, 0);
        room.x.fill(0);
        manifold.mass().pattern().transposed_spans(&room.d, &mut room.x, mass);
        room.solve(chart, turning);
        blocks.stiffness.pattern().transposed_spans(&room.d, &mut room.x, forces);
        blocks.a0.pattern().transposed_spans(&room.rows, &mut room.x, y);
        room.solve(chart, turning);
        blocks.a0.pattern().transposed_spans(&room.rows, &mut room.x, w);
    }
}
