//! Recursions along the tree.

use super::algebra::Algebra;
use super::articulated::{Articulated, Pivot};
use super::branched::Branched;
use super::closures::{Closures, Numbers, Origin};
use super::derivatives::Derivatives;
use super::directions::Directions;
use super::inertia::Inertia;
use super::subtrees::Subtrees;
use crate::math::turn::TurnRate;
use crate::math::vector::difference;
use crate::reduction::parametrization::Parametrization;
use crate::reduction::recent::RecentPoints;
use crate::reduction::relatives::{Relatives, Source};
use crate::system::{EdgeScrews, EdgeSource, Measure, Motion, Stance, State, System};
use crate::threads::Threads;
use std::collections::BTreeMap;
use std::marker::PhantomData;
use std::ops::Range;
use std::sync::Arc;

/// An edge of the tree, without numbers that change.
#[derive(Debug, Clone)]
pub(super) struct Edge {
    /// Place among the edges of the forest, and the form in use.
    pub(super) at: usize,
    pub(super) form: usize,
    pub(super) body: usize,
    pub(super) base: Option<usize>,
    /// The edge of its base, by its place among all.
    pub(super) carrier: Option<usize>,
    pub(super) first: Option<usize>,
    pub(super) outward: bool,
    /// Its coordinates among all.
    pub(super) range: Range<usize>,
    /// Those that a driver moves, a bit for each.
    pub(super) driven: u8,
    pub(super) stage: [u8; 6],
    /// Whether a column is carried along by another one.
    pub(super) nested: bool,
    pub(super) rotation: Option<usize>,
    /// Clusters of closures whose dependent coordinates move its body.
    pub(super) moved_by: Vec<usize>,
    /// The joint that it is and the driver on it, by their places in the structure.
    pub(super) joint: Option<usize>,
    pub(super) driver: Option<usize>,
}

impl Edge {
    /// Whether its coordinates are those of any rotation about a point.
    pub(super) fn turns_freely(&self) -> bool {
        self.rotation == Some(0)
    }
}

/// Mass, kg, and inertia about the centre of mass, kg m², in axes of the body and in axes of the ground.
#[derive(Debug, Clone, Copy)]
pub(super) struct BodyInertia {
    pub(super) mass: f64,
    pub(super) own: [[f64; 3]; 3],
    pub(super) turned: [[f64; 3]; 3],
}

/// Joint coordinates with twists and wrenches of `W` numbers.
#[derive(Debug, Clone)]
pub(super) struct Engine<A: Algebra<N, W>, const N: usize, const W: usize> {
    pub(super) system: Arc<dyn System>,
    /// In the order of a walk: those of the bodies that hang on one stand right behind its own.
    pub(super) edges: Arc<[Edge]>,
    /// Where several threads share the work, what each of them may take.
    pub(super) subtrees: Option<(Threads, Arc<Subtrees>)>,
    /// Per coordinate: where it comes from, and the row of the driver that tells it.
    pub(super) sources: Arc<[Source]>,
    /// Of these the independent ones, each with its variable, and those of drivers on the tree with row, sign and constant.
    pub(super) independent: Arc<[(usize, usize)]>,
    pub(super) driven: Arc<[(usize, usize, f64, f64)]>,
    /// Edge of the forest of each coordinate, and place among its own.
    pub(super) at: Arc<[(usize, usize)]>,
    /// Groups that reach no farther than so far from their references, with their edges and first places.
    pub(super) reaching: Arc<[(usize, usize, usize)]>,
    /// Group of each coordinate, and place in it.
    pub(super) names: Arc<[(usize, usize)]>,
    pub(super) closures: Closures,
    /// Configurations recovered before, within this step.
    pub(super) recent: RecentPoints<Numbers>,
    /// Edge of the forest, and place among its coordinates, of each dependent coordinate.
    pub(super) places: Vec<(usize, usize)>,
    /// Body that each of them moves against its base.
    pub(super) moves: Vec<usize>,
    /// Root of each body's tree.
    pub(super) root: Vec<usize>,
    /// Reference point of each body.
    pub(super) origin: Vec<[f64; 3]>,
    /// The point that the rotations of each body's edge are about.
    pub(super) center: Vec<[f64; 3]>,
    /// Columns for rates as in [`EdgeScrews`](crate::system::EdgeScrews) about that point, and for the coordinates' own
    /// about it and about the reference point.
    pub(super) screws: Vec<[f64; W]>,
    pub(super) own_columns: Vec<[f64; W]>,
    pub(super) columns: Vec<[f64; W]>,
    pub(super) turning: Vec<Option<TurnRate>>,
    pub(super) rates: Vec<f64>,
    pub(super) accelerations: Vec<f64>,
    /// B ẋ of each edge.
    pub(super) relative: Vec<[f64; W]>,
    pub(super) twist: Vec<[f64; W]>,
    pub(super) twist_rate: Vec<[f64; W]>,
    /// Ḃ ẋ of each edge.
    pub(super) bias: Vec<[f64; W]>,
    /// Wrenches of the forces on each body, with what its turning exerts.
    pub(super) applied: Vec<[f64; W]>,
    /// Of each body, or of all that hangs on it, and the sizes of what they are summed from.
    pub(super) wrench_size: Vec<[f64; 2]>,
    pub(super) wrench: Vec<[f64; W]>,
    pub(super) inertias: Vec<BodyInertia>,
    /// By the places of the edges.
    pub(super) articulated: Vec<Articulated<A::Inertia, W>>,
    pub(super) pivots: Vec<Pivot>,
    /// Articulated or composite inertia times the columns.
    pub(super) felt: Vec<[f64; W]>,
    pub(super) branched: Option<Box<Branched>>,
    pub(super) directions: Option<Box<Directions<W>>>,
    /// Made where derivatives are asked for.
    pub(super) derivatives: Option<Box<Derivatives<W>>>,
    /// Whether nothing closes loops and no driver stands on the tree.
    pub(super) is_plain_tree: bool,
    /// How each body stands, and the configuration that this belongs to; see [`Engine::stand`].
    pub(super) stances: Vec<Stance>,
    pub(super) stood: Vec<f64>,
    /// Bodies at the ends of closures, and how they move; see [`Engine::evaluate_motions`].
    pub(super) ends: Vec<usize>,
    pub(super) motions: Vec<Motion>,
    /// Gradients over the coordinates of their bodies, of closures that do not follow from how bodies stand.
    pub(super) gradients: Vec<f64>,
    /// Scratch: rows of the closures, coordinates, motions of bodies.
    pub(super) rows: Vec<f64>,
    pub(super) along: Vec<f64>,
    /// Scratch: what joints exert along the Euler parameters of each body.
    pub(super) normal: Vec<f64>,
    pub(super) zero_rates: Vec<f64>,
    pub(super) before: Vec<f64>,
    pub(super) change: Vec<f64>,
    pub(super) motion: Vec<[f64; W]>,
    pub(super) rate_change: Vec<f64>,
    pub(super) bias_change: Vec<[f64; W]>,
    pub(super) twist_change: Vec<[f64; W]>,
    algebra: PhantomData<A>,
}

/// aᵀb, every other product in a sum of its own: two that a processor takes at once.
#[inline(always)]
pub(super) fn dot<const W: usize>(a: &[f64; W], b: &[f64; W]) -> f64 {
    let mut sums = [a[0] * b[0], a[1] * b[1]];
    for k in 1..W / 2 {
        sums[0] += a[2 * k] * b[2 * k];
        sums[1] += a[2 * k + 1] * b[2 * k + 1];
    }
    let last = W / 2 * 2..;
    a[last.clone()].iter().zip(&b[last]).fold(sums[0] + sums[1], |sum, (a, b)| sum + a * b)
}

#[inline(always)]
pub(super) fn add<const W: usize>(out: &mut [f64; W], factor: f64, x: &[f64; W]) {
    out.iter_mut().zip(x).for_each(|(out, x)| *out += factor * x);
}

#[inline(always)]
pub(super) fn pose<const N: usize>(q: &[f64], body: usize) -> &[f64; N] {
    q[body * N..].first_chunk().expect("a body has N coordinates")
}

#[inline(always)]
pub(super) fn pose_mut<const N: usize>(q: &mut [f64], body: usize) -> &mut [f64; N] {
    q[body * N..].first_chunk_mut().expect("a body has N coordinates")
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    pub(super) fn new(
        system: &Arc<dyn System>,
        parametrization: &Parametrization,
        q: &[f64],
    ) -> Option<Self> {
        let relatives = parametrization.relatives()?;
        let (tree, groups) = (system.tree(), system.relative_groups());
        let bodies = system.structure().sizes.bodies;
        let joints = &system.structure().joints;
        let of_row: BTreeMap<usize, usize> =
            joints.iter().enumerate().map(|(at, joint)| (joint.row, at)).collect();
        let mut edges: Vec<Edge> = Vec::new();
        let (mut coordinates, mut names) = (Vec::new(), Vec::new());
        let mut edge_of = vec![None; bodies];
        let mut screws = EdgeScrews::default();
        let mut root: Vec<usize> = (0..bodies).collect();
        let mut place_of = vec![0; bodies];
        tree.edges.iter().enumerate().for_each(|(at, edge)| place_of[edge.body] = at);
        for body in tree.forest.walk() {
            let at = place_of[body];
            let (edge, form) = (&tree.edges[at], relatives.forms[at]);
            if !system.edge_screws_at(at, form, q, &mut screws) {
                return None;
            }
            let start = coordinates.len();
            for group in edge.forms[form].clone() {
                let info = &groups[group];
                let measure = if info.kind.turns() { Measure::Angle } else { Measure::Length };
                for row in 0..info.rows {
                    coordinates.push((relatives.sources[at][coordinates.len() - start], measure));
                    names.push((group, row));
                }
            }
            if coordinates.len() - start != screws.count {
                return None;
            }
            if let Some(base) = screws.base {
                root[edge.body] = root[base];
            }
            edge_of[edge.body] = Some(edges.len());
            edges.push(Edge {
                moved_by: Vec::new(),
                at,
                form,
                body: edge.body,
                base: screws.base,
                carrier: screws.base.and_then(|base| edge_of[base]),
                first: screws.first,
                outward: screws.outward,
                range: start..coordinates.len(),
                driven: coordinates[start..].iter().enumerate().fold(
                    0,
                    |driven, (i, coordinate)| {
                        driven | u8::from(matches!(coordinate.0, Source::Driven(..))) << i
                    },
                ),
                stage: screws.stage,
                nested: screws.stage[..screws.count].windows(2).any(|two| two[0] < two[1]),
                rotation: screws.rotation,
                joint: match edge.source {
                    EdgeSource::Joint(joint) => Some(joint),
                    _ => None,
                },
                driver: edge.driver.and_then(|(row, ..)| of_row.get(&row).copied()),
            });
        }
        let path = |mut body: Option<usize>| {
            let mut out = Vec::new();
            while let Some(edge) = body.and_then(|b| edge_of[b]) {
                let edge: &Edge = &edges[edge];
                if !edge.range.is_empty() {
                    out.push(edge.range.clone());
                }
                body = edge.base;
            }
            out
        };
        let closures =
            Closures::new(system.as_ref(), parametrization, relatives, &coordinates, path)?;
        for at in 0..edges.len() {
            let mut clusters =
                edges[at].carrier.map_or(Vec::new(), |base| edges[base].moved_by.clone());
            let own = edges[at].range.clone().filter_map(|k| closures.place(k));
            clusters.extend(own.map(|(cluster, _)| cluster));
            clusters.sort_unstable();
            clusters.dedup();
            edges[at].moved_by = clusters;
        }
        let mut ends: Vec<usize> = closures.all.iter().flat_map(|c| c.ends).flatten().collect();
        ends.sort_unstable();
        ends.dedup();
        let (n, rows) = (coordinates.len(), closures.rows());
        let of_edges = edges.iter().flat_map(|edge| {
            edge.range.clone().enumerate().map(|(place, k)| (k, ((edge.at, place), edge.body)))
        });
        let at: Arc<[_]> = of_edges.clone().map(|(_, (place, _))| place).collect();
        let first = |(k, (group, row)): (usize, &(usize, usize))| {
            let reaches = *row == 0 && groups[*group].reach.is_finite();
            reaches.then(|| (*group, at[k].0, at[k].1))
        };
        let reaching = names.iter().enumerate().filter_map(first).collect();
        let dependent = of_edges.filter(|(k, _)| coordinates[*k].0 == Source::Dependent);
        let (places, moves) = dependent.map(|(_, place)| place).unzip();
        let (mut independent, mut driven) = (Vec::new(), Vec::new());
        for (k, (source, _)) in coordinates.iter().enumerate() {
            match *source {
                Source::Independent(variable) => independent.push((k, variable)),
                Source::Driven(row, sign, constant) => driven.push((k, row, sign, constant)),
                Source::Dependent => {}
            }
        }
        let zeros = || vec![[0.0; W]; bodies];
        let mut out = Self {
            system: system.clone(),
            sources: coordinates.iter().map(|c| c.0).collect(),
            independent: independent.into(),
            driven: driven.into(),
            reaching,
            at,
            names: names.into(),
            root,
            origin: vec![[0.0; 3]; bodies],
            center: vec![[0.0; 3]; bodies],
            screws: vec![[0.0; W]; n],
            own_columns: vec![[0.0; W]; n],
            columns: vec![[0.0; W]; n],
            turning: vec![None; edges.len()],
            rates: vec![0.0; n],
            accelerations: vec![0.0; n],
            relative: zeros(),
            twist: zeros(),
            twist_rate: zeros(),
            wrench: zeros(),
            wrench_size: vec![[0.0; 2]; bodies],
            bias: zeros(),
            applied: zeros(),
            inertias: (0..bodies)
                .map(|b| BodyInertia {
                    mass: system.mass(b),
                    own: system.inertia(b),
                    turned: system.inertia(b),
                })
                .collect(),
            stances: vec![Stance::GROUND; bodies],
            stood: vec![f64::NAN; q.len()],
            motions: vec![Motion::REST; ends.last().map_or(0, |last| last + 1)],
            ends,
            gradients: vec![0.0; closures.all.iter().map(|c| c.count * 2 * N).sum()],
            rows: vec![0.0; rows],
            along: vec![0.0; n],
            normal: vec![0.0; system.structure().sizes.bodies],
            zero_rates: vec![0.0; parametrization.ndof],
            subtrees: None,
            articulated: vec![Articulated::zero(); edges.len()],
            pivots: vec![Pivot::default(); n],
            felt: vec![[0.0; W]; n],
            branched: None,
            directions: None,
            derivatives: None,
            is_plain_tree: false,
            before: vec![0.0; n],
            change: vec![0.0; n],
            motion: zeros(),
            rate_change: vec![0.0; n],
            bias_change: vec![[0.0; W]; edges.len()],
            twist_change: zeros(),
            algebra: PhantomData,
            recent: RecentPoints::new(rows > 0, || closures.numbers(), q.len(), tree.edges.len()),
            closures,
            places,
            moves,
            edges: edges.into(),
        };
        out.plan_accelerations();
        Some(out)
    }

    pub(super) fn relatives(parametrization: &Parametrization) -> &Relatives {
        parametrization.relatives().expect("the parametrization that it was made for")
    }

    /// Twists of all bodies for rates or changes `x` of the coordinates.
    pub(super) fn carry(&self, x: &[f64], twists: &mut [[f64; W]]) {
        for edge in &*self.edges {
            let mut twist = edge.base.map_or([0.0; W], |base| twists[base]);
            for k in edge.range.clone() {
                add(&mut twist, x[k], &self.columns[k]);
            }
            twists[edge.body] = twist;
        }
    }

    /// Ḃ ẋ of all edges.
    pub(super) fn evaluate_bias(&mut self) {
        for at in 0..self.edges.len() {
            self.bias[self.edges[at].body] = self.column_change(at, &self.twist, &self.rates);
        }
    }

    /// Rates of the twists where no coordinate accelerates.
    pub(super) fn carry_bias(&mut self) {
        for edge in &*self.edges {
            let mut rate = self.bias[edge.body];
            if let Some(base) = edge.base {
                add(&mut rate, 1.0, &self.twist_rate[base]);
            }
            self.twist_rate[edge.body] = rate;
        }
    }

    /// Rates of the twists for `accelerations`.
    pub(super) fn evaluate_twist_rates(&mut self) {
        for edge in &*self.edges {
            let mut rate = self.bias[edge.body];
            if let Some(base) = edge.base {
                add(&mut rate, 1.0, &self.twist_rate[base]);
            }
            let columns = &self.columns[edge.range.clone()];
            for (column, x) in columns.iter().zip(&self.accelerations[edge.range.clone()]) {
                add(&mut rate, *x, column);
            }
            self.twist_rate[edge.body] = rate;
        }
    }

    /// q̈ for these rates.
    pub(super) fn tell_second_rates(&self, q: &[f64], v: &[f64], a: &mut [f64]) {
        for (b, rate) in self.twist_rate.iter().enumerate() {
            let (y, o) = (&self.twist[b], &self.origin[b]);
            *pose_mut(a, b) = A::second_rates(pose(q, b), pose(v, b), o, y, rate);
        }
    }

    /// Wrenches of gravity, forces and the turning of the bodies, and ż.
    pub(super) fn evaluate_forces(&mut self, state: &State, z_rate: &mut [f64]) {
        self.system.wrenches(state, self.applied.as_flattened_mut(), z_rate);
        for (b, applied) in self.applied.iter_mut().enumerate() {
            let (y, BodyInertia { turned, .. }) = (&self.twist[b], &self.inertias[b]);
            add(applied, 1.0, &A::turning(turned, y));
            *applied = A::moved(applied, &A::center(pose(&state.q, b)), &self.origin[b]);
        }
    }

    /// The wrench that accelerates a body with q̈ = a.
    #[inline(always)]
    pub(super) fn inertia_force(&self, b: usize, q: &[f64], a: &[f64; N]) -> [f64; W] {
        let BodyInertia { mass, turned, .. } = &self.inertias[b];
        A::inertia_force(*mass, turned, [pose(q, b), a], &self.origin[b], &self.twist_rate[b])
    }

    /// The same where q̈ has not been told.
    #[inline(always)]
    pub(super) fn inertia_force_anew(&self, b: usize, q: &[f64], v: &[f64]) -> [f64; W] {
        let (y, yd, o) = (&self.twist[b], &self.twist_rate[b], &self.origin[b]);
        self.inertia_force(b, q, &A::second_rates(pose(q, b), pose(v, b), o, y, yd))
    }

    /// Wrenches of inertia and forces of every body for the present rates of twists, which belong to q̈ = a.
    pub(super) fn evaluate_wrenches(&mut self, q: &[f64], a: &[f64]) {
        for b in 0..self.inertias.len() {
            let own = self.inertia_force(b, q, pose(a, b));
            self.wrench[b] = std::array::from_fn(|i| own[i] - self.applied[b][i]);
        }
    }

    /// The same where q̈ has not been told.
    pub(super) fn evaluate_wrenches_anew(&mut self, q: &[f64], v: &[f64]) {
        for b in 0..self.inertias.len() {
            let own = self.inertia_force_anew(b, q, v);
            self.wrench[b] = std::array::from_fn(|i| own[i] - self.applied[b][i]);
        }
    }

    /// Wrenches of bodies become those of all that hangs on them, and forces on the coordinates.
    pub(super) fn gather(&mut self) {
        for edge in self.edges.iter().rev() {
            let wrench = self.wrench[edge.body];
            for k in edge.range.clone() {
                self.along[k] = dot(&self.columns[k], &wrench);
            }
            if let Some(base) = edge.base {
                add(&mut self.wrench[base], 1.0, &wrench);
            }
        }
    }

    /// Inertias of all that hangs on each body, about the point that its edge turns about: about the reference point what
    /// is light and far out is a small difference.
    pub(super) fn gather_inertias(&mut self, q: &[f64]) {
        for (edge, own) in self.edges.iter().zip(&mut self.articulated) {
            let BodyInertia { mass, turned, .. } = &self.inertias[edge.body];
            let arm = difference(&A::center(pose(q, edge.body)), &self.center[edge.body]);
            own.inertia = A::Inertia::of_body(*mass, turned, &arm);
        }
        for (at, edge) in self.edges.iter().enumerate().rev() {
            if let (Some(base), Some(carrier)) = (edge.base, edge.carrier) {
                let arm = difference(&self.center[edge.body], &self.center[base]);
                let own = self.articulated[at].inertia.moved(&arm);
                self.articulated[carrier].inertia.add(&own);
            }
        }
    }

    /// Dᵀ of the forces on the coordinates; leaves y of the closures in `rows`.
    pub(super) fn project(&mut self, out: &mut [f64]) {
        for (r, &k) in self.rows.iter_mut().zip(&self.closures.dependent) {
            *r = self.along[k];
        }
        self.closures.solve_transposed(&mut self.rows);
        self.closures.subtract_transposed(&self.rows, &mut self.along);
        self.independent.iter().for_each(|&(k, at)| out[at] = self.along[k]);
        for closure in &self.closures.all {
            if let Origin::Deformations(_) = closure.origin {
                for (y, (_, k)) in self.rows[closure.first..].iter().zip(&closure.rows) {
                    out[*k] = *y;
                }
            }
        }
    }

    /// Dependent entries of `x`, which are zero, from the others, for rows with right-hand sides −`rows`.
    pub(super) fn complete(&mut self, x: &mut [f64]) {
        self.closures.multiply_add(x, &mut self.rows);
        self.closures.solve(&mut self.rows);
        for (value, &k) in self.rows.iter().zip(&self.closures.dependent) {
            x[k] = *value;
        }
    }

    /// Entries of x that are independent variables, or told by drivers: `level` 1 for rates, 2 for accelerations, none
    /// for changes at a fixed time.
    pub(super) fn tell(&self, t: f64, level: Option<usize>, p: &[f64], x: &mut [f64]) {
        x.fill(0.0);
        self.independent.iter().for_each(|&(k, at)| x[k] = p[at]);
        if let Some(level) = level {
            for &(k, row, sign, _) in &*self.driven {
                x[k] = sign * self.system.drive(row, t)[level];
            }
        }
    }

    /// D p, with zero residuals of the joints.
    pub(super) fn multiply_null_space(&mut self, p: &[f64], x: &mut [f64]) {
        self.tell(0.0, None, p, x);
        self.rows.fill(0.0);
        for closure in &self.closures.all {
            if let Origin::Deformations(_) = closure.origin {
                for (out, (_, k)) in self.rows[closure.first..].iter_mut().zip(&closure.rows) {
                    *out = -p[*k];
                }
            }
        }
        self.complete(x);
    }
}
