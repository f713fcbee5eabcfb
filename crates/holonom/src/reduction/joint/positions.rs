//! Positions: coordinates of the edges whose closures hold.

use super::JointForm;
use super::algebra::Algebra;
use super::closures::Origin;
use super::clusters::Free;
use super::engine::Engine;
use super::residuals::counts_turns;
use crate::error::EvaluationFailure;
use crate::math::vector::larger;
use crate::reduction::parametrization::Parametrization;
use crate::reduction::recovery::{
    CONTRACTION_LIMIT, FARTHEST, MAX_CORRECTIONS, MAX_FACTORIZATIONS, NOISY_CORRECTION, Unclosed,
    another_branch, round_off, turned_too_far,
};
use crate::reduction::relatives::Relatives;
use crate::system::System;
use std::f64::consts::{PI, TAU};

/// Contraction from which the closures are factored anew.
const SLOW: f64 = 0.05;
/// What the second correction by the same factors may be larger than the first one lets expect.
const FIRST_CAUTION: f64 = 64.0;

/// What the last digit of places makes of coordinates of edges: far from the origin residuals have no more digits than places.
fn noise_of_places(system: &dyn System, q: &[f64]) -> f64 {
    let places = system.structure().sizes.by_body(q).flat_map(|[places, _]| places);
    let farthest = places.fold(0.0f64, |most, x| most.max(x.abs()));
    8.0 * f64::EPSILON * farthest / system.characteristic_length()
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    pub(super) fn follow(
        &mut self,
        parametrization: &Parametrization,
        t: f64,
        p: &[f64],
        x: &mut [[f64; 6]],
        q: &mut [f64],
    ) -> Result<u64, EvaluationFailure> {
        let relatives = Self::relatives(parametrization);
        if self.closures.rows() == 0 {
            self.tell_coordinates(t, p, x)?;
            self.place_all(relatives, x, q);
            self.stood.copy_from_slice(q);
            return Ok(0);
        }
        self.keep_coordinates(x);
        self.tell_coordinates(t, p, x)?;
        // The tangent at the configuration last factored.
        let mut change = std::mem::take(&mut self.change);
        for edge in &*self.edges {
            let of_edge = change[edge.range.clone()].iter_mut();
            let both = of_edge.zip(&mut self.before[edge.range.clone()]);
            for ((change, before), x) in both.zip(&x[edge.at]) {
                *change = x - *before;
                *before = *x;
            }
        }
        // What deformations and drivers have moved by since.
        self.stand(q);
        self.closures.open();
        self.evaluate_residual(parametrization, t, p, q);
        let allowed = round_off(q);
        let is_round_off = |residual: f64| residual <= allowed;
        if is_round_off(self.closures.keep_residuals(&self.rows)) {
            // Next to a dead point it would move the mechanism by far more than round-off.
            self.rows.fill(0.0);
        }
        self.complete(&mut change);
        for (&k, &(edge, place)) in self.closures.dependent.iter().zip(&self.places) {
            x[edge][place] += change[k];
            self.before[k] = x[edge][place];
        }
        let predicted = self.size_of(&change);
        let turned = self.closures.angles.iter().map(|&k| change[k].abs());
        let turned = turned.fold(0.0, larger);
        if turned > PI {
            self.change = change;
            return Err(turned_too_far(turned));
        }
        self.keep_movements(&change);
        self.change = change;
        let noise = 8.0 * f64::EPSILON * self.size_of(&self.before).max(1.0);
        self.keep_noise();
        self.place_all(relatives, x, q);
        self.closures.open();
        let (mut factored, mut first, mut last) = (0, (0.0, 0.0), noise);
        // Corrections by the present factors: a first one tells nothing of how they contract.
        let mut served = 0;
        for count in 1..=MAX_CORRECTIONS {
            self.evaluate_residual(parametrization, t, p, q);
            let residual = self.closures.keep_residuals(&self.rows);
            if count == 1 && predicted <= noise && is_round_off(residual) {
                // Closed where it stands. Next to a dead point a correction would be noise.
                self.stood.copy_from_slice(q);
                return Ok(0);
            }
            let size = self.correct(x);
            self.place_corrected(relatives, x, q);
            if count == 1 {
                first = (residual, size);
            }
            if !size.is_finite() {
                return Err(self.failure(t, q, size));
            }
            // Clusters have no dependent coordinate in common: each is closed for itself.
            let (mut is_slow, mut stalled, mut is_open) = (false, false, false);
            for cluster in self.closures.clusters.iter_mut().filter(|cluster| cluster.is_open) {
                let (size, before) = (cluster.size, cluster.before);
                let rate = size / before;
                // Or the next one would be. The first rate is that of a correction to the movement predicted, which is of second
                // order in it, or to one by other factors: less is known of it.
                let caution = if served > 0 { 4.0 } else { FIRST_CAUTION };
                let ends = size.min(caution * rate * size) <= cluster.noise;
                let stalls = served > 0 && rate > CONTRACTION_LIMIT;
                let is_noise = || {
                    let noisy = || NOISY_CORRECTION.max(1e3 * noise_of_places(&*self.system, q));
                    before <= 1e3 * noise || (is_round_off(cluster.residual) && size <= noisy())
                };
                if ends || (stalls && is_noise()) {
                    (cluster.is_open, last) = (false, last.max(size));
                    continue;
                }
                if stalls && factored == MAX_FACTORIZATIONS {
                    return Err(self.failure(t, q, size));
                }
                is_slow |= served > 0 && rate > SLOW;
                stalled |= stalls;
                (is_open, cluster.before) = (true, size);
            }
            if !is_open {
                let moved = self.corrections(x).fold(0.0, larger);
                // What few digits of far places leave is no way to another branch.
                let left = last.min(NOISY_CORRECTION.max(1e3 * noise));
                let near = (0.5 * predicted).min(FARTHEST) + 1e3 * left;
                // Next to a dead point round-off of the residuals alone moves by more than a short step.
                if moved <= near || (is_round_off(first.0) && moved <= near + first.1) {
                    self.stood.copy_from_slice(q);
                    return Ok(count.into());
                }
                return Err(self.another_branch(x));
            }
            served += 1;
            if (is_slow && factored == 0) || (stalled && factored < MAX_FACTORIZATIONS) {
                self.factor(parametrization, x, q)?;
                self.forget_stand();
                (factored, served) = (factored + 1, 0);
            }
        }
        let sizes = self.closures.clusters.iter().filter(|cluster| cluster.is_open);
        let size = sizes.map(|cluster| cluster.size).fold(0.0, larger);
        Err(self.failure(t, q, size))
    }

    /// Coordinates of the edges that are independent variables, or told by drivers.
    ///
    /// # Errors
    /// `simulation/chart-reach`.
    fn tell_coordinates(
        &self,
        t: f64,
        p: &[f64],
        x: &mut [[f64; 6]],
    ) -> Result<(), EvaluationFailure> {
        for &(k, variable) in &*self.independent {
            let (edge, place) = self.at[k];
            x[edge][place] = p[variable];
        }
        let system = self.system.as_ref();
        for &(k, row, sign, constant) in &*self.driven {
            let (edge, place) = self.at[k];
            x[edge][place] = sign * system.prescribed(row, t) + constant;
        }
        let groups = system.relative_groups();
        for &(group, edge, first) in &*self.reaching {
            let info = &groups[group];
            Relatives::reaches(info, group, &x[edge][first..first + info.rows])?;
        }
        Ok(())
    }

    /// How bodies stand is not known.
    fn forget_stand(&mut self) {
        if let Some(first) = self.stood.first_mut() {
            *first = f64::NAN;
        }
    }

    /// Places all bodies. How they stand is known when the configuration is.
    fn place_all(&mut self, relatives: &Relatives, x: &[[f64; 6]], q: &mut [f64]) {
        self.forget_stand();
        for edge in &*self.edges {
            let stances = Some(&mut self.stances[..]);
            relatives.place_edge(self.system.as_ref(), edge.at, x, q, stances);
        }
    }

    /// Places the bodies that open clusters move.
    fn place_corrected(&mut self, relatives: &Relatives, x: &[[f64; 6]], q: &mut [f64]) {
        let clusters = &self.closures.clusters;
        for edge in &*self.edges {
            if edge.moved_by.iter().any(|&cluster| clusters[cluster].is_open) {
                let stances = Some(&mut self.stances[..]);
                relatives.place_edge(self.system.as_ref(), edge.at, x, q, stances);
            }
        }
    }

    pub(super) fn read_coordinates(
        &self,
        parametrization: &Parametrization,
        q: &[f64],
        x: &mut [[f64; 6]],
    ) {
        let (system, relatives) = (self.system.as_ref(), Self::relatives(parametrization));
        for edge in &*self.edges {
            let mut at = 0;
            for group in system.tree().edges[edge.at].forms[edge.form].clone() {
                let rows = system.relative_groups()[group].rows;
                let mut value = [0.0; 3];
                let reference = &relatives.references[group];
                system.relative_value(group, reference, q, &mut value[..rows]);
                for (x, value) in x[edge.at][at..at + rows].iter_mut().zip(value) {
                    let counted = if counts_turns(system, group) { *x } else { value };
                    *x = value + TAU * ((counted - value) / TAU).round();
                }
                at += rows;
            }
        }
    }

    /// Moves the dependent coordinates of open clusters by what the closures' residuals ask for; returns the largest change,
    /// lengths over the characteristic length.
    fn correct(&mut self, x: &mut [[f64; 6]]) -> f64 {
        self.closures.solve_open(&mut self.rows);
        let mut largest = 0.0f64;
        for cluster in self.closures.clusters.iter_mut().filter(|cluster| cluster.is_open) {
            let mut size = 0.0;
            for ((at, change), scale) in cluster.changes(&self.rows).zip(&cluster.column_scale) {
                let (edge, place) = self.places[at];
                size = larger(size, (change / scale).abs());
                x[edge][place] += change;
            }
            cluster.size = size;
            largest = larger(largest, size);
        }
        if largest.is_finite() { largest } else { f64::INFINITY }
    }

    /// Largest of changes of all coordinates, lengths over the characteristic length.
    fn size_of(&self, change: &[f64]) -> f64 {
        // On bits, so that NaN is larger than every number.
        let bits = |(x, scale): (&f64, &f64)| (x / scale).abs().to_bits();
        let scaled = change.iter().zip(&self.closures.column_scale).map(bits);
        f64::from_bits(scaled.fold(0, u64::max))
    }

    /// How far dependent coordinates are from those in `before`.
    fn corrections<'a>(&'a self, x: &'a [[f64; 6]]) -> impl Iterator<Item = f64> + 'a {
        self.places.iter().zip(&self.closures.dependent).map(|(&(edge, place), &k)| {
            ((x[edge][place] - self.before[k]) / self.closures.column_scale[k]).abs()
        })
    }

    /// How far the prediction moves the dependent coordinates of each cluster, in place of a correction before the first.
    fn keep_movements(&mut self, change: &[f64]) {
        let closures = &mut self.closures;
        for cluster in &mut closures.clusters {
            cluster.before = 0.0;
            for (&at, scale) in cluster.dependent.iter().zip(&cluster.column_scale) {
                let change = change[closures.dependent[at]] / scale;
                cluster.before = larger(cluster.before, change.abs());
            }
        }
    }

    /// What is round-off of the coordinates in `before` of each cluster: what has turned far elsewhere makes none of it.
    fn keep_noise(&mut self) {
        let closures = &mut self.closures;
        for cluster in &mut closures.clusters {
            let dependent = cluster.dependent.iter().map(|&at| closures.dependent[at]);
            let free = cluster.free.iter().filter_map(|(_, free)| match free {
                Free::Coordinate(k) => Some(*k),
                Free::Row(_) => None,
            });
            let size = |k: usize| (self.before[k] / closures.column_scale[k]).abs();
            let largest = dependent.chain(free).map(size).fold(1.0, f64::max);
            cluster.noise = 8.0 * f64::EPSILON * largest;
        }
    }

    fn keep_coordinates(&mut self, x: &[[f64; 6]]) {
        for edge in &*self.edges {
            let own = &mut self.before[edge.range.clone()];
            own.copy_from_slice(&x[edge.at][..own.len()]);
        }
    }

    /// The corrections left the neighbourhood of what was predicted.
    fn another_branch(&self, x: &[[f64; 6]]) -> EvaluationFailure {
        let (name, coordinate) = self.largest(self.corrections(x).enumerate());
        another_branch((&name, coordinate))
    }

    /// Name of the dependent coordinate with the largest change, and a coordinate of the body that it moves.
    fn largest(&self, changes: impl Iterator<Item = (usize, f64)>) -> (String, usize) {
        let largest = changes.reduce(|a, b| if b.1 > a.1 { b } else { a });
        let k = largest.map_or(0, |(at, _)| self.closures.dependent[at]);
        let (group, row) = self.names[k];
        let info = &self.system.relative_groups()[group];
        let sizes = self.system.structure().sizes;
        let body = self.edges.iter().find(|edge| edge.range.contains(&k)).map_or(0, |e| e.body);
        let own = [sizes.translations_of(body), sizes.rotations_of(body)];
        let coordinate = own[usize::from(info.kind.turns())].start;
        (Relatives::name_of(self.system.as_ref(), group, row), coordinate)
    }

    /// The last corrections of size `correction` do not fall: nothing is left of the residuals, or they cannot be closed.
    fn failure(&self, t: f64, q: &[f64], correction: f64) -> EvaluationFailure {
        let system = self.system.as_ref();
        let mut worst: Option<(usize, f64)> = None;
        let mut value = [0.0; 6];
        for closure in &self.closures.all {
            let Origin::Joint(joint) = closure.origin else { continue };
            system.joint_value(joint, t, q, &mut value);
            for &(k, row) in &closure.rows {
                let size = value[k].abs();
                if size.is_nan() || worst.is_none_or(|(_, worst)| size > worst) {
                    worst = Some((row, size));
                }
            }
        }
        let scaled = self.rows.iter().zip(&self.closures.dependent).enumerate();
        let changes = scaled.map(|(at, (x, &k))| (at, (x / self.closures.column_scale[k]).abs()));
        let (name, coordinate) = self.largest(changes);
        let unclosed = Unclosed { t, worst, correction, moved: (&name, coordinate) };
        if worst.is_none_or(|(_, size)| size <= round_off(q)) {
            unclosed.undetermined()
        } else {
            unclosed.open(system)
        }
    }
}
