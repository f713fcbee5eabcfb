//! What made a run take many steps: the coordinate with the largest part of the estimated error, step by
//! step, and the force behind rejected ones. Only counts are kept; no step depends on them.

use crate::model::Tolerance;
use crate::reduction::Parametrization;
use crate::system::{Measure, State, System};
use serde::{Deserialize, Serialize};

/// Errors below this part of the tolerance did not limit a step.
const LIMITING: f64 = 0.01;

/// What limited most steps of a run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LimitedBy {
    /// Coordinate with the largest part of the error in most accepted steps, and in how many.
    pub coordinate: Option<(String, u64)>,
    /// Accepted steps that the error limited at all.
    pub steps: u64,
    /// Coordinate with the largest part of the error or last correction in most rejected steps, the
    /// stiffest force on its body, if there is one, and in how many.
    pub rejected: Option<(String, Option<String>, u64)>,
    /// Rejected steps of which that is known.
    pub rejected_steps: u64,
}

/// The counts of a run with its last chart: names are found when they are asked for, since that allocates.
#[derive(Debug, Clone, PartialEq)]
pub struct Limits {
    pub(super) counts: Slowness,
    pub(super) chart: Parametrization,
}

impl Limits {
    /// What limited most steps of a run of `system` that ended in `state`.
    pub fn named(&self, system: &dyn System, state: &State) -> LimitedBy {
        self.counts.clone().named(system, &self.chart, state)
    }
}

/// Counts by coordinate: those of the present chart by place, those of former charts by name.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Slowness {
    absolute: Vec<f64>,
    relative: f64,
    accepted: Vec<u64>,
    rejected: Vec<u64>,
    named: Vec<Named>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Named {
    name: String,
    force: Option<String>,
    accepted: u64,
    rejected: u64,
}

impl Slowness {
    /// Counts by the coordinates of a chart from now on.
    pub(super) fn set_chart(
        &mut self,
        system: &dyn System,
        former: Option<(&Parametrization, &State)>,
        chart: &Parametrization,
        tolerance: &Tolerance,
    ) {
        if let Some((former, state)) = former {
            self.name(system, former, state);
        }
        self.relative = tolerance.relative;
        let absolute = (0..chart.ndof).map(|k| match chart.measure(system, k) {
            Measure::Length => tolerance.translation,
            Measure::Angle => tolerance.rotation,
        });
        self.absolute = absolute.collect();
        self.accepted = vec![0; chart.ndof];
        self.rejected = vec![0; chart.ndof];
    }

    /// The counts so far, by name; `chart` and `state` are the present ones.
    pub(super) fn by_name(
        &mut self,
        system: &dyn System,
        chart: &Parametrization,
        state: &State,
    ) -> &[Named] {
        self.name(system, chart, state);
        &self.named
    }

    /// Goes on from counts by name.
    pub(super) fn after(named: Vec<Named>) -> Self {
        Self { named, ..Self::default() }
    }

    /// Counts an attempt from `w` by the error `change` of its coordinates and rates; `error` is its size
    /// against the tolerance.
    pub(super) fn count(&mut self, accepted: bool, error: f64, change: &[f64], w: &[f64]) {
        let n = self.absolute.len();
        if change.len() < 2 * n || w.len() < 2 * n || (accepted && error < LIMITING) {
            return;
        }
        let (mut largest, mut at) = (0.0, None);
        for (k, absolute) in self.absolute.iter().enumerate() {
            let rate = absolute + self.relative * w[n + k].abs();
            let size = (change[k] / absolute).abs().max((change[n + k] / rate).abs());
            if size > largest {
                (largest, at) = (size, Some(k));
            }
        }
        let counts = if accepted { &mut self.accepted } else { &mut self.rejected };
        if let Some(k) = at {
            counts[k] += 1;
        }
    }

    /// Moves the counts of a chart to the names of its coordinates.
    fn name(&mut self, system: &dyn System, chart: &Parametrization, state: &State) {
        for k in 0..self.absolute.len().min(chart.ndof) {
            let (accepted, rejected) =
                (std::mem::take(&mut self.accepted[k]), std::mem::take(&mut self.rejected[k]));
            if accepted + rejected == 0 {
                continue;
            }
            let name = chart.name(system, k);
            let at = self.named.iter().position(|named| named.name == name);
            let at = at.unwrap_or_else(|| {
                self.named.push(Named { name, force: None, accepted: 0, rejected: 0 });
                self.named.len() - 1
            });
            let named = &mut self.named[at];
            named.accepted += accepted;
            named.rejected += rejected;
            if rejected > 0 && named.force.is_none() {
                let forces = system.forces_on(chart.coordinate(system, k), state);
                named.force = forces.first().map(|force| (*force).to_owned());
            }
        }
    }

    /// What limited most steps; `chart` and `state` are the last ones.
    fn named(mut self, system: &dyn System, chart: &Parametrization, state: &State) -> LimitedBy {
        self.name(system, chart, state);
        let most = |count: fn(&Named) -> u64| {
            self.named.iter().filter(|n| count(n) > 0).max_by_key(|n| count(n))
        };
        LimitedBy {
            coordinate: most(|n| n.accepted).map(|n| (n.name.clone(), n.accepted)),
            steps: self.named.iter().map(|n| n.accepted).sum(),
            rejected: most(|n| n.rejected).map(|n| (n.name.clone(), n.force.clone(), n.rejected)),
            rejected_steps: self.named.iter().map(|n| n.rejected).sum(),
        }
    }
}
