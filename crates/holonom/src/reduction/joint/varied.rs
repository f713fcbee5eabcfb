//! First variations with one independent variable, or time: twists and their rates outwards, wrenches inwards.

use super::algebra::Algebra;
use super::closures::{Closures, Origin};
use super::derivatives::Derivatives;
use super::engine::{BodyInertia, Edge, Engine, add, dot};
use super::interactions::{Interaction, times};
use crate::reduction::relatives::Source;

/// What a variable, or time, moves.
#[derive(Debug, Clone, Default)]
pub(super) struct Mover {
    /// The coordinate that it is.
    coordinate: Option<usize>,
    /// Clusters whose dependent coordinates follow it; of a variable with its place among the free ones there.
    clusters: Vec<(usize, usize)>,
    /// Edges that move, inner ones first.
    pub(super) edges: Vec<usize>,
    /// Edges whose forces change, outer ones first.
    felt: Vec<usize>,
    /// Variables with their coordinates among these, and clusters with dependent ones.
    reads: Vec<(usize, usize)>,
    reads_clusters: Vec<usize>,
}

/// What parts of a mechanism have to do with each other.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plan<'a> {
    pub(super) edges: &'a [Edge],
    pub(super) closures: &'a Closures,
    pub(super) sources: &'a [Source],
    /// By bodies: those that feel it.
    pub(super) felt_by: &'a [Vec<usize>],
}

impl Mover {
    /// Of an independent variable.
    pub(super) fn of(variable: usize, plan: &Plan<'_>) -> Self {
        let own = Source::Independent(variable);
        let coordinate = plan.sources.iter().position(|source| *source == own);
        let of_cluster = plan.closures.clusters.iter().enumerate().filter_map(|(at, cluster)| {
            Some((at, cluster.free.iter().position(|(p, _)| *p == variable)?))
        });
        let clusters: Vec<(usize, usize)> = of_cluster.collect();
        let follows = |k: usize| {
            let own = plan.closures.place(k).map(|(cluster, _)| cluster);
            Some(k) == coordinate || clusters.iter().any(|(cluster, _)| Some(*cluster) == own)
        };
        let mut moves = vec![false; plan.felt_by.len()];
        for edge in plan.edges {
            let carried = edge.base.is_some_and(|base| moves[base]);
            moves[edge.body] = carried || edge.range.clone().any(follows);
        }
        let all = 0..plan.edges.len();
        let edges = all.filter(|&at| moves[plan.edges[at].body]).collect();
        Self { coordinate, clusters, edges, ..Self::default() }.with_reads(plan)
    }

    /// Of time, which moves whatever drivers do.
    pub(super) fn of_time(plan: &Plan<'_>) -> Self {
        Self {
            clusters: (0..plan.closures.clusters.len()).map(|cluster| (cluster, 0)).collect(),
            edges: (0..plan.edges.len()).collect(),
            ..Self::default()
        }
        .with_reads(plan)
    }

    fn with_reads(mut self, plan: &Plan<'_>) -> Self {
        let mut feels = vec![false; plan.felt_by.len()];
        for &e in &self.edges {
            let b = plan.edges[e].body;
            feels[b] = true;
            plan.felt_by[b].iter().for_each(|&other| feels[other] = true);
        }
        for (e, edge) in plan.edges.iter().enumerate().rev() {
            if !feels[edge.body] {
                continue;
            }
            self.felt.push(e);
            if let Some(base) = edge.base {
                feels[base] = true;
            }
            for k in edge.range.clone() {
                match plan.sources[k] {
                    Source::Independent(p) => self.reads.push((p, k)),
                    _ => self.reads_clusters.extend(plan.closures.place(k).map(|(c, _)| c)),
                }
            }
        }
        self.reads_clusters.sort_unstable();
        self.reads_clusters.dedup();
        self
    }
}

/// A variation, of coordinates and of bodies: of positions, rates and accelerations.
#[derive(Debug, Clone)]
pub(super) struct Varied<const W: usize> {
    x: [Vec<f64>; 3],
    pub(super) bodies: [Vec<[f64; W]>; 3],
    /// Of accelerations with the rate of the variable.
    x_by_rate: Vec<f64>,
    by_rate: Vec<[f64; W]>,
    /// What an edge has more than its inner body: of displacements, of twists, of the level at hand.
    own: [Vec<[f64; W]>; 3],
    /// B ẋ of each edge as its carrier is displaced.
    swing: Vec<[f64; W]>,
    /// Of wrenches, and of forces along the coordinates: with accelerations, rates, positions.
    pub(super) felt: [Vec<[f64; W]>; 3],
    pub(super) along: [Vec<f64>; 3],
    rows: Vec<f64>,
}

impl<const W: usize> Varied<W> {
    pub(super) fn new(coordinates: usize, bodies: usize, rows: usize) -> Self {
        let (of_x, of_bodies) = (|| vec![0.0; coordinates], || vec![[0.0; W]; bodies]);
        Self {
            x: [of_x(), of_x(), of_x()],
            bodies: [of_bodies(), of_bodies(), of_bodies()],
            x_by_rate: of_x(),
            by_rate: of_bodies(),
            own: [of_bodies(), of_bodies(), of_bodies()],
            swing: of_bodies(),
            felt: [of_bodies(), of_bodies(), of_bodies()],
            along: [of_x(), of_x(), of_x()],
            rows: vec![0.0; rows],
        }
    }
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// Each edge adds its own to what its inner body has.
    fn carry_out(&self, mover: &Mover, own: &[[f64; W]], bodies: &mut [[f64; W]]) {
        for &e in &mover.edges {
            let edge = &self.edges[e];
            let mut sum = own[edge.body];
            if let Some(base) = edge.base {
                add(&mut sum, 1.0, &bodies[base]);
            }
            bodies[edge.body] = sum;
        }
    }

    /// Changes of dependent coordinates that make up for what the rows of their closures are changed by.
    fn close(
        &mut self,
        mover: &Mover,
        rows: &mut [f64],
        x: &mut [f64],
        change: impl Fn(usize) -> f64,
    ) {
        for &(c, _) in &mover.clusters {
            for &row in &self.closures.clusters[c].rows {
                rows[row] += change(row);
            }
            self.closures.solve_cluster(c, rows, x);
        }
    }

    /// Adds columns times the coordinates that follow others.
    fn add_dependent(&self, mover: &Mover, x: &[f64], own: &mut [[f64; W]]) {
        for &(c, _) in &mover.clusters {
            for &at in &self.closures.clusters[c].dependent {
                let k = self.closures.dependent[at];
                add(&mut own[self.moves[at]], x[k], &self.columns[k]);
            }
        }
    }

    /// Derivative number `level` of what drivers prescribe: of coordinates into `x`, of closures off `rows`.
    fn tell_drives(&self, t: f64, level: usize, x: &mut [f64], rows: &mut [f64]) {
        for (x, source) in x.iter_mut().zip(&*self.sources) {
            if let Source::Driven(row, sign, _) = *source {
                *x = sign * self.system.drive(row, t)[level];
            }
        }
        rows.fill(0.0);
        for closure in &self.closures.all {
            let Origin::Joint(joint) = closure.origin else { continue };
            let Some(drive) = self.system.joint_drive(joint, t) else { continue };
            for (out, (row, _)) in rows[closure.first..].iter_mut().zip(&closure.rows) {
                *out = if *row == 0 { -drive[level] } else { 0.0 };
            }
        }
    }

    /// What a mover has moved is at rest again, as everything is between two of them.
    pub(super) fn rest(&self, mover: &Mover, at: &mut Derivatives<W>) {
        let Varied { x, bodies, by_rate, along, .. } = &mut at.varied;
        for &e in &mover.edges {
            let Edge { body, range, .. } = &self.edges[e];
            x.iter_mut().for_each(|x| x[range.clone()].fill(0.0));
            bodies.iter_mut().for_each(|bodies| bodies[*body] = [0.0; W]);
            by_rate[*body] = [0.0; W];
        }
        for &e in &mover.felt {
            let range = &self.edges[e].range;
            along.iter_mut().for_each(|along| along[range.clone()].fill(0.0));
        }
    }

    /// (13) of a variable.
    pub(super) fn vary_positions(&mut self, mover: &Mover, at: &mut Derivatives<W>) {
        let Varied { x: [x, ..], own: [own, ..], bodies: [bodies, ..], .. } = &mut at.varied;
        if let Some(k) = mover.coordinate {
            x[k] = 1.0;
        }
        for &(c, place) in &mover.clusters {
            let cluster = &self.closures.clusters[c];
            for (&dependent, row) in cluster.dependent.iter().zip(cluster.map_rows()) {
                x[self.closures.dependent[dependent]] = row[place];
            }
        }
        self.step_by(mover, x, own);
        self.carry_out(mover, own, bodies);
    }

    /// (13) of time: what drivers move, and what follows that.
    pub(super) fn vary_positions_with_time(
        &mut self,
        mover: &Mover,
        t: f64,
        at: &mut Derivatives<W>,
    ) {
        let Varied { x: [x, ..], own: [own, ..], bodies: [bodies, ..], rows, .. } = &mut at.varied;
        self.tell_drives(t, 1, x, rows);
        self.step_by(mover, x, own);
        self.carry_out(mover, own, bodies);
        let (ends, end_rows) = (&at.ends, &at.end_rows);
        self.close(mover, rows, x, |row| {
            let change = |b: usize, side: usize| dot(&end_rows[row][side].rate[1], &bodies[b]);
            both(ends[row], change)
        });
        self.add_dependent(mover, x, own);
        self.carry_out(mover, own, bodies);
    }

    /// B x of each edge that moves.
    fn step_by(&self, mover: &Mover, x: &[f64], own: &mut [[f64; W]]) {
        for &e in &mover.edges {
            let edge = &self.edges[e];
            let out = &mut own[edge.body];
            *out = [0.0; W];
            for k in edge.range.clone() {
                if x[k] != 0.0 {
                    add(out, x[k], &self.columns[k]);
                }
            }
        }
    }

    /// (14) with (16): twists at fixed rates of the variables.
    pub(super) fn vary_rates(&mut self, mover: &Mover, time: Option<f64>, at: &mut Derivatives<W>) {
        let Varied { x, own, bodies, swing, rows, .. } = &mut at.varied;
        let ([x, rates, _], [_, own, _], [displaced, moved, _]) = (x, own, bodies);
        rows.fill(0.0);
        if let Some(t) = time {
            self.tell_drives(t, 2, rates, rows);
        }
        self.step_by(mover, rates, own);
        for &e in &mover.edges {
            let edge = &self.edges[e];
            let b = edge.body;
            if let Some(carrier) = edge.first {
                swing[b] = A::cross(&displaced[carrier], &self.relative[b]);
                add(&mut own[b], 1.0, &swing[b]);
            }
            if edge.bends() {
                for k in edge.range.clone() {
                    add(&mut own[b], x[k], &at.motions[k].rate);
                }
            }
        }
        self.carry_out(mover, own, moved);
        if mover.clusters.is_empty() {
            return;
        }
        let (ends, end_rows) = (&at.ends, &at.end_rows);
        self.close(mover, rows, rates, |row| {
            both(ends[row], |b, side| {
                let [by_x, by_rate] = &end_rows[row][side].rate;
                dot(by_x, &displaced[b]) + dot(by_rate, &moved[b])
            })
        });
        self.add_dependent(mover, rates, own);
        self.carry_out(mover, own, moved);
    }

    /// (15) with (17): rates of twists at fixed rates and accelerations of the variables.
    pub(super) fn vary_accelerations(
        &mut self,
        mover: &Mover,
        time: Option<f64>,
        at: &mut Derivatives<W>,
    ) {
        let Varied { x, own, bodies, rows, .. } = &mut at.varied;
        let ([x, rates, second], [_, own, level], [displaced, moved, accelerated]) =
            (x, own, bodies);
        rows.fill(0.0);
        if let Some(t) = time {
            self.tell_drives(t, 3, second, rows);
        }
        self.step_by(mover, second, level);
        for &e in &mover.edges {
            let edge = &self.edges[e];
            let b = edge.body;
            let out = &mut level[b];
            if let Some(carrier) = edge.first {
                add(out, 1.0, &A::cross(&moved[carrier], &self.relative[b]));
                add(out, 1.0, &A::cross(&self.twist[carrier], &own[b]));
                add(out, 1.0, &A::cross(&displaced[carrier], &at.accelerations[b]));
            }
            if edge.bends() {
                for k in edge.range.clone() {
                    let [by_x, by_rate] = &at.motions[k].acceleration;
                    add(out, x[k], by_x);
                    add(out, rates[k], by_rate);
                }
            }
        }
        self.carry_out(mover, level, accelerated);
        if mover.clusters.is_empty() {
            return;
        }
        let (ends, end_rows) = (&at.ends, &at.end_rows);
        self.close(mover, rows, second, |row| {
            both(ends[row], |b, side| {
                let [by_x, by_rate, along] = &end_rows[row][side].second;
                dot(by_x, &displaced[b]) + dot(by_rate, &moved[b]) + dot(along, &accelerated[b])
            })
        });
        self.add_dependent(mover, second, level);
        self.carry_out(mover, level, accelerated);
    }

    /// The same with a unit of the rate of the variable, by which twists change as positions do with the variable.
    pub(super) fn vary_accelerations_by_rate(&mut self, mover: &Mover, at: &mut Derivatives<W>) {
        let Varied { x, x_by_rate, own, bodies, by_rate, swing, rows, .. } = &mut at.varied;
        let ([rates, ..], [own, _, level], [moved, ..]) = (x, own, bodies);
        for &e in &mover.edges {
            let edge = &self.edges[e];
            let b = edge.body;
            let mut out = [0.0; W];
            if let Some(carrier) = edge.first {
                out = swing[b];
                add(&mut out, 1.0, &A::cross(&self.twist[carrier], &own[b]));
            }
            if edge.bends() {
                for k in edge.range.clone() {
                    add(&mut out, rates[k], &at.motions[k].acceleration[1]);
                }
            }
            level[b] = out;
        }
        self.carry_out(mover, level, by_rate);
        if mover.clusters.is_empty() {
            return;
        }
        rows.fill(0.0);
        let (ends, end_rows) = (&at.ends, &at.end_rows);
        self.close(mover, rows, x_by_rate, |row| {
            both(ends[row], |b, side| {
                let [_, on_twist, along] = &end_rows[row][side].second;
                dot(on_twist, &moved[b]) + dot(along, &by_rate[b])
            })
        });
        self.add_dependent(mover, x_by_rate, level);
        self.carry_out(mover, level, by_rate);
    }

    /// (20): changes of the wrenches on all bodies, with accelerations, rates and positions.
    pub(super) fn vary_wrenches(&self, mover: &Mover, at: &mut Derivatives<W>) {
        let Varied { bodies: [displaced, moved, accelerated], by_rate, felt, .. } = &mut at.varied;
        for &e in &mover.felt {
            felt.iter_mut().for_each(|felt| felt[self.edges[e].body] = [0.0; W]);
        }
        for &e in &mover.edges {
            let b = self.edges[e].body;
            let (own, o) = (&at.own[b], &self.origin[b]);
            let BodyInertia { mass, turned, .. } = &self.inertias[b];
            let inertia = |y: &[f64; W]| A::inertia_about_center(*mass, turned, y);
            // About its own place: about O the inertia of what is light and far out is a small difference.
            let [x, y, yd, by_rate] = [&displaced[b], &moved[b], &accelerated[b], &by_rate[b]]
                .map(|y| A::moved_twist(y, o, &own.place));
            let back = |w: &[f64; W]| A::moved(w, &own.place, o);
            add(&mut felt[0][b], 1.0, &back(&inertia(&x)));
            let mut wrench = times(&own.damping, &x);
            add(&mut wrench, 1.0, &inertia(&by_rate));
            add(&mut felt[1][b], 1.0, &back(&wrench));
            wrench = times(&own.stiffness, &x);
            add(&mut wrench, 1.0, &times(&own.damping, &y));
            add(&mut wrench, 1.0, &inertia(&yd));
            add(&mut felt[2][b], 1.0, &back(&wrench));
            for &i in &at.by_moved[b] {
                let Interaction { bodies: [a, _], acts, by: [by_x, by_twist] } =
                    &at.interactions[i];
                if !acts {
                    continue;
                }
                let back = |w: &[f64; W]| A::moved(w, &at.own[*a].place, &self.origin[*a]);
                add(&mut felt[1][*a], 1.0, &back(&times(by_twist, &x)));
                let mut wrench = times(by_x, &x);
                add(&mut wrench, 1.0, &times(by_twist, &y));
                add(&mut felt[2][*a], 1.0, &back(&wrench));
            }
        }
    }

    /// (18): changes of the wrenches become those of all that hangs on the bodies, and of the forces along the coordinates.
    pub(super) fn gather_changes(&self, mover: &Mover, at: &mut Derivatives<W>) {
        let Varied { x: [x, ..], bodies: [displaced, ..], felt, along, .. } = &mut at.varied;
        for &e in &mover.felt {
            let edge = &self.edges[e];
            for (felt, along) in felt.iter_mut().zip(&mut *along) {
                let wrench = felt[edge.body];
                for k in edge.range.clone() {
                    along[k] = dot(&self.columns[k], &wrench);
                }
                if let Some(base) = edge.base {
                    add(&mut felt[base], 1.0, &wrench);
                }
            }
        }
        for &e in &mover.edges {
            let edge = &self.edges[e];
            if let Some(carrier) = edge.first {
                for k in edge.range.clone() {
                    along[2][k] += dot(&at.motions[k].tilt, &displaced[carrier]);
                }
            }
            if edge.bends() {
                for m in edge.range.clone() {
                    for (k, force) in edge.range.clone().zip(&at.motions[m].force) {
                        along[2][k] += x[m] * force;
                    }
                }
            }
        }
    }

    /// (22): Dᵀ of changes of the forces along the coordinates, by the maps of the clusters.
    #[inline(always)]
    pub(super) fn project_by_maps(
        &self,
        mover: &Mover,
        along: &[f64],
        mut out: impl FnMut(usize, f64),
    ) {
        for &(p, k) in &mover.reads {
            out(p, along[k]);
        }
        for &c in &mover.reads_clusters {
            let cluster = &self.closures.clusters[c];
            for (&at, row) in cluster.dependent.iter().zip(cluster.map_rows()) {
                let force = along[self.closures.dependent[at]];
                for (map, (p, _)) in row.iter().zip(&cluster.free) {
                    out(*p, map * force);
                }
            }
        }
    }
}

/// The sum over the ends that are bodies.
fn both(ends: [Option<usize>; 2], change: impl Fn(usize, usize) -> f64) -> f64 {
    ends.into_iter().enumerate().filter_map(|(side, end)| Some(change(end?, side))).sum()
}
