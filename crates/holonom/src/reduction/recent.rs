//! Configurations of one step that were recovered lately, with the factors that belong to them.

use super::chart::{Chart, Factors};

/// As many as the stages that are iterated together, and the point of their linearization.
const KEPT: usize = 3;

/// A configuration, the time it was recovered at, and what it leaves for the next recovery there.
#[derive(Debug, Clone)]
struct Recent {
    t: f64,
    used: u64,
    q: Vec<f64>,
    edges: Vec<[f64; 6]>,
    factors: Factors,
}

/// Stages that are iterated together are recovered in turn, each time near to where they were before, while
/// stages of different times are far apart. So each goes on from the configuration nearest in time.
#[derive(Debug, Clone)]
pub(super) struct RecentPoints {
    /// Time of the configuration recovered last; NaN if none serves.
    t: f64,
    clock: u64,
    points: Vec<Recent>,
    /// The point that takes over the factors at hand before they are replaced, and its time: it serves only
    /// once it has them.
    leaving: Option<(usize, f64)>,
}

impl RecentPoints {
    /// None yet; room for those of a chart, where recoveries iterate.
    pub(super) fn new(chart: &Chart, coordinates: usize, edges: usize) -> Self {
        let exact = chart.parametrization().relatives().is_some_and(|relatives| relatives.exact);
        let point = || Recent {
            t: f64::NAN,
            used: 0,
            q: vec![0.0; coordinates],
            edges: vec![[0.0; 6]; edges],
            factors: chart.factors(),
        };
        let points = (0..if exact { 0 } else { KEPT }).map(|_| point()).collect();
        Self { t: f64::NAN, clock: 0, points, leaving: None }
    }

    /// No configuration serves any longer.
    pub(super) fn forget(&mut self) {
        self.t = f64::NAN;
        self.leaving = None;
        for point in &mut self.points {
            (point.t, point.used) = (f64::NAN, 0);
        }
    }

    /// Exchanges the configuration at hand for the one nearest to time t, and keeps it.
    pub(super) fn go_near(
        &mut self,
        t: f64,
        chart: &mut Chart,
        q: &mut [f64],
        edges: &mut [[f64; 6]],
    ) {
        self.clock += 1;
        let distance = |other: f64| (other - t).abs();
        let mut nearest = None;
        let mut least = distance(self.t);
        for (k, point) in self.points.iter().enumerate() {
            // Not one that is not a number.
            if distance(point.t) < least {
                (least, nearest) = (distance(point.t), Some(k));
            }
        }
        if let Some(k) = nearest {
            let point = &mut self.points[k];
            point.q.swap_with_slice(q);
            point.edges.swap_with_slice(edges);
            chart.exchange(&mut point.factors);
            std::mem::swap(&mut point.t, &mut self.t);
            point.used = self.clock;
        }
        self.leaving = None;
        if self.t.is_nan() || self.t == t {
            self.t = t;
            return;
        }
        let oldest = self.points.iter_mut().enumerate().min_by_key(|(_, point)| point.used);
        if let Some((k, point)) = oldest {
            point.q.copy_from_slice(q);
            point.edges.copy_from_slice(edges);
            (point.t, point.used) = (f64::NAN, self.clock);
            self.leaving = Some((k, self.t));
        }
        self.t = t;
    }

    /// The factors at hand are about to be replaced.
    pub(super) fn keep_factors(&mut self, chart: &mut Chart) {
        if let Some((k, t)) = self.leaving.take() {
            chart.exchange(&mut self.points[k].factors);
            self.points[k].t = t;
        }
    }
}
