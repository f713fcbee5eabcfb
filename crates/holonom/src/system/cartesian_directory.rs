//! Names and channels of a Cartesian system.

use super::cartesian::Cartesian;
use super::passage::Passage;
use super::placed::PlacedForce;
use super::quantities::{Channel, Sample, evaluate_channel};
use super::space::Space;
use super::{Directory, State};
use crate::elements::row::RowKind;
use crate::elements::{ConstraintElement, ForceElement};

/// Radians, or part of the characteristic length, over which stiff forces are told for messages.
const PROBE: f64 = 1e-6;

impl<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize> Directory
    for Cartesian<S, D, N, W>
{
    fn channels(&self) -> &[Channel] {
        self.channels.all(self)
    }

    fn channel_named(&self, name: &str) -> Option<Channel> {
        self.channels.named(self, name)
    }

    fn channel(&self, channel: &Channel, sample: &Sample<'_>, out: &mut [f64]) {
        evaluate_channel(self, channel, sample, out);
    }

    fn coordinate_name(&self, coordinate: usize) -> String {
        let body = self.coordinate_item(coordinate);
        format!("{body}.{}", S::coordinate_names()[coordinate % N])
    }

    fn coordinate_item(&self, coordinate: usize) -> &str {
        &self.bodies[coordinate / N].name
    }

    fn forces_on(&self, coordinate: usize, state: &State) -> Vec<&str> {
        let (body, row) = (Some(coordinate / N), coordinate % N);
        // A stop is stiff beside the state before it is reached: a secant sees it.
        let reach = if row < D { PROBE * self.length } else { PROBE };
        let force_at = |f: &PlacedForce<S::Force>, shift: f64| {
            let mut probe = state.clone();
            probe.q[coordinate] += shift;
            let (mut wrenches, mut z_rate) = ([[0.0; W]; 2], vec![0.0; f.extra.count]);
            f.element.evaluate(&Self::input(f, &probe), &mut wrenches, &mut z_rate);
            let side = usize::from(f.bodies[1] == body);
            Self::passages(&probe, f.bodies)[side].force(&wrenches[side])[row]
        };
        let mut acting: Vec<(f64, &str)> = self
            .forces
            .iter()
            .filter(|f| f.bodies.contains(&body))
            .map(|f| ((force_at(f, reach) - force_at(f, -reach)).abs(), f.name.as_str()))
            .collect();
        acting.sort_by(|a, b| b.0.total_cmp(&a.0));
        acting.into_iter().map(|(_, name)| name).collect()
    }

    fn kinks_at(&self, t: f64) -> Vec<&str> {
        let near = |times: &[f64]| times.iter().any(|b| (b - t).abs() <= 1e-12 * t.abs().max(1e-3));
        let drivers = self.constraints.iter().filter(|c| near(&c.breakpoints)).map(|c| &c.name);
        let forces = self.forces.iter().filter(|f| near(&f.element.breakpoints())).map(|f| &f.name);
        drivers.chain(forces).map(String::as_str).collect()
    }

    fn row_name(&self, row: usize) -> String {
        let start = self.structure.normalization_start;
        if row >= start {
            return format!("Euler parameters of body `{}`", self.bodies[row - start].name);
        }
        let at = self.constraints.partition_point(|c| c.row <= row) - 1;
        let c = &self.constraints[at];
        format!("{} `{}`, {}", c.kind, c.name, c.element.row_kind(row - c.row))
    }

    fn row_item(&self, row: usize) -> (&str, RowKind) {
        let start = self.structure.normalization_start;
        if row >= start {
            return (&self.bodies[row - start].name, RowKind::Normalization);
        }
        let at = self.constraints.partition_point(|c| c.row <= row) - 1;
        let c = &self.constraints[at];
        (&c.name, c.element.row_kind(row - c.row))
    }
}
