//! Configurations of one step that were recovered lately, with the factors that belong to them.

/// As many as the stages that are iterated together, and the point of their linearization.
const KEPT: usize = 3;

/// A configuration, the time it was recovered at, and what it leaves for the next recovery there.
#[derive(Debug, Clone)]
struct Recent<F> {
    t: f64,
    used: u64,
    q: Vec<f64>,
    edges: Vec<[f64; 6]>,
    factors: F,
}

/// Stages that are iterated together are recovered in turn, each time near to where they were before, while
/// stages of different times are far apart. So each goes on from the configuration nearest in time.
///
/// `F` is what belongs to a configuration beside its coordinates; `exchange` swaps it for what is at hand.
#[derive(Debug, Clone)]
pub(super) struct RecentPoints<F> {
    /// Time of the configuration recovered last; NaN if none serves.
    t: f64,
    clock: u64,
    points: Vec<Recent<F>>,
    /// The point that takes over the factors at hand before they are replaced, and its time: it serves only
    /// once it has them.
    leaving: Option<(usize, f64)>,
}

impl<F: Clone> RecentPoints<F> {
    /// None, and no room for any.
    pub(super) fn none() -> Self {
        Self { t: f64::NAN, clock: 0, points: Vec::new(), leaving: None }
    }

    /// None yet; room for those of as many coordinates and edges, where recoveries iterate.
    pub(super) fn new(
        iterates: bool,
        factors: impl FnOnce() -> F,
        coordinates: usize,
        edges: usize,
    ) -> Self {
        let mut points = Vec::new();
        if iterates {
            let point = Recent {
                t: f64::NAN,
                used: 0,
                q: vec![0.0; coordinates],
                edges: vec![[0.0; 6]; edges],
                factors: factors(),
            };
            points = vec![point; KEPT];
        }
        Self { points, ..Self::none() }
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
        mut exchange: impl FnMut(&mut F),
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
            exchange(&mut point.factors);
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
    pub(super) fn keep_factors(&mut self, exchange: impl FnOnce(&mut F)) {
        if let Some((k, t)) = self.leaving.take() {
            exchange(&mut self.points[k].factors);
            self.points[k].t = t;
        }
    }
}
