//! Columns of the coordinates, and how they change.

use super::algebra::Algebra;
use super::engine::{Engine, add, pose};
use crate::math::turn::TurnRate;
use crate::math::vector::sum;
use crate::system::EdgeScrews;

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// Columns of all coordinates at q, with the reference points of the trees and the inertias there.
    pub(super) fn evaluate_columns(&mut self, x: &[[f64; 6]], q: &[f64]) {
        for (origin, root) in self.origin.iter_mut().zip(&self.root) {
            *origin = A::center(pose(q, *root));
        }
        self.stand(q);
        for (inertia, stance) in self.inertias.iter_mut().zip(&self.stances) {
            inertia.turned = A::turned(&inertia.own, stance);
        }
        let mut screws = EdgeScrews::default();
        for (edge, turning) in self.edges.iter().zip(&mut self.turning) {
            if !self.system.edge_screws(edge.at, edge.form, &self.stances, &mut screws) {
                continue;
            }
            let sign = if edge.outward { 1.0 } else { -1.0 };
            let (center, o) = (screws.center, self.origin[edge.body]);
            self.center[edge.body] = center;
            let own = &mut self.screws[edge.range.clone()];
            let columns = &mut self.own_columns[edge.range.clone()];
            let both = own.iter_mut().zip(&mut *columns);
            for ((own, column), [linear, angular]) in both.zip(&screws.columns) {
                *own = A::screw(linear, angular).map(|x| sign * x);
                *column = *own;
            }
            if let Some(start) = edge.rotation {
                let theta = [x[edge.at][start], x[edge.at][start + 1], x[edge.at][start + 2]];
                let rate = turning.insert(TurnRate::new(&theta)).matrix();
                for (k, column) in columns[start..].iter_mut().enumerate() {
                    let mut angular = [0.0; 3];
                    for (row, [_, axis]) in rate.iter().zip(&screws.columns[start..]) {
                        add(&mut angular, sign * row[k], axis);
                    }
                    *column = A::screw(&[0.0; 3], &angular);
                }
            }
            for (out, own) in self.columns[edge.range.clone()].iter_mut().zip(columns) {
                *out = A::moved_twist(own, &center, &o);
            }
        }
    }

    /// Those of another engine of the same parametrization.
    pub(super) fn copy_columns(&mut self, other: &Self) {
        self.stood.copy_from_slice(&other.stood);
        self.stances.copy_from_slice(&other.stances);
        self.inertias.copy_from_slice(&other.inertias);
        self.turning.copy_from_slice(&other.turning);
        for (own, other) in [(&mut self.origin, &other.origin), (&mut self.center, &other.center)] {
            own.copy_from_slice(other);
        }
        for (own, other) in [
            (&mut self.screws, &other.screws),
            (&mut self.own_columns, &other.own_columns),
            (&mut self.columns, &other.columns),
        ] {
            own.copy_from_slice(other);
        }
    }

    /// Rates as the screws have them: of a rotation vector the angular velocity.
    pub(super) fn screw_rates(&self, at: usize, x_rate: &[f64]) -> [f64; 6] {
        let edge = &self.edges[at];
        let mut out = [0.0; 6];
        out[..edge.range.len()].copy_from_slice(&x_rate[edge.range.clone()]);
        if let (Some(start), Some(turning)) = (edge.rotation, &self.turning[at]) {
            let turned = turning.times(&[out[start], out[start + 1], out[start + 2]]);
            out[start..start + 3].copy_from_slice(&turned);
        }
        out
    }

    /// Rotations are about to be measured from the present configuration, where their rates are angular velocities and what
    /// these change with is zero: rates and accelerations become those. Whether there are any.
    pub(super) fn turn_rates(&mut self) -> bool {
        let mut turns = false;
        for (edge, turning) in self.edges.iter().zip(&self.turning) {
            let (Some(start), Some(turning)) = (edge.rotation, turning) else { continue };
            let range = edge.range.start + start..edge.range.start + start + 3;
            let [rates, second] = [&self.rates, &self.accelerations]
                .map(|x| std::array::from_fn(|i| x[range.start + i]));
            let (turned, bend) = (turning.times(&second), turning.first(&rates, &rates));
            self.rates[range.clone()].copy_from_slice(&turning.times(&rates));
            self.accelerations[range].copy_from_slice(&sum(&turned, &bend));
            turns = true;
        }
        turns
    }

    /// δ(B ẋ) of an edge at fixed ẋ, where bodies move by the twists `motion` and coordinates by `change`.
    pub(super) fn column_change(&self, at: usize, motion: &[[f64; W]], change: &[f64]) -> [f64; W] {
        let edge = &self.edges[at];
        let mut out = match edge.first {
            Some(carrier) => A::cross(&motion[carrier], &self.relative[edge.body]),
            None => [0.0; W],
        };
        let screws = &self.screws[edge.range.clone()];
        let (center, origin) = (&self.center[edge.body], &self.origin[edge.body]);
        if edge.nested {
            let [rates, moved] = [&self.rates[..], change].map(|x| self.screw_rates(at, x));
            let sign = if edge.outward { 1.0 } else { -1.0 };
            // What lower stages move by carries the next one.
            let (mut own, mut lower, mut k) = ([0.0; W], [0.0; W], 0);
            for stage in edge.stage[..screws.len()].chunk_by(|a, b| a == b) {
                let [mut turned, mut carried] = [[0.0; W]; 2];
                for screw in &screws[k..k + stage.len()] {
                    add(&mut turned, sign * rates[k], screw);
                    add(&mut carried, moved[k], screw);
                    k += 1;
                }
                add(&mut own, 1.0, &A::cross(&lower, &turned));
                add(&mut lower, 1.0, &carried);
            }
            add(&mut out, 1.0, &A::moved_twist(&own, center, origin));
        }
        if let (Some(start), Some(turning)) = (edge.rotation, &self.turning[at]) {
            let [change, rates] = [change, &self.rates]
                .map(|x| x[edge.range.start + start..].first_chunk().expect("three angles"));
            let own = combined(&turning.first(change, rates), &screws[start..]);
            add(&mut out, 1.0, &A::moved_twist(&own, center, origin));
        }
        out
    }
}

/// The sum of three twists, times these factors.
#[inline(always)]
fn combined<const W: usize>([x, y, z]: &[f64; 3], twists: &[[f64; W]]) -> [f64; W] {
    let [a, b, c]: &[[f64; W]; 3] = twists.first_chunk().expect("three twists");
    std::array::from_fn(|i| x * a[i] + y * b[i] + z * c[i])
}
