//! From independent to all coordinates: positions, velocities, accelerations and multipliers.

use super::accelerations::{Accelerations, Accelerator, Known, Refusal};
use super::chart::Chart;
use super::joint::{JointForm, joint_form};
use super::parametrization::largest_index;
use super::recent::RecentPoints;
use super::redundant::Redundant;
use crate::error::EvaluationFailure;
use crate::system::{State, System};
use holonom_linalg::BlockMatrix;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Corrections that contract more slowly than this are refused as a way to another branch.
const CONTRACTION_LIMIT: f64 = 0.5;
/// The old factor is replaced when it would need more corrections than a new one costs.
const WORTH_REFACTORING: f64 = 4.0;
const MAX_CORRECTIONS: u32 = 40;
/// A correction of this size changes nothing.
const UNNOTICED: f64 = 0.1 * f64::EPSILON;
/// Corrections of this size may be noise where the residual is.
const NOISY_CORRECTION: f64 = 1e-9;

/// Work counters of the recovery.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct RecoveryCounters {
    /// Position recoveries.
    pub recoveries: u64,
    /// Corrections of positions.
    pub corrections: u64,
    /// Factorisations of [G; P].
    pub factorizations: u64,
    /// Acceleration solves.
    pub accelerations: u64,
    /// Symbolic analyses of matrices that have been replaced since.
    pub analyses: u64,
}

/// A point on the constraint manifold with the factors that belong to it.
#[derive(Debug, Clone)]
pub struct Manifold {
    system: Arc<dyn System>,
    chart: Chart,
    accelerator: Accelerator,
    /// Boxed: few models have redundant rows.
    redundant: Option<Box<Redundant>>,
    /// Coordinates of the edges of the forest at the last recovery.
    edges: Vec<[f64; 6]>,
    /// Configurations recovered before, within this step.
    recent: RecentPoints,
    /// G where it was last evaluated.
    g: BlockMatrix,
    phi: Vec<f64>,
    rows: Vec<f64>,
    correction: Vec<f64>,
    predictor: Vec<f64>,
    independent: Vec<f64>,
    /// What v̈ has beside P q̈.
    curvature: Vec<f64>,
    force: Vec<f64>,
    tau: Vec<f64>,
    z_rate: Vec<f64>,
    /// Sign of det [G; P] on the branch that is followed; zero where the next evaluation tells it.
    orientation: f64,
    /// Recoveries in joint coordinates. The chart, G and M are then those of a configuration before, until they are
    /// needed.
    joint: Option<Box<dyn JointForm>>,
    /// Time and configuration of the last evaluation in joint coordinates.
    at_time: f64,
    at: Vec<f64>,
    stale: bool,
    /// Whether the next recovery starts from another configuration than the last one left.
    returned: bool,
    /// Whether accelerations came from joint coordinates, and multipliers of the tree's joints have not been asked for.
    multipliers_wait: bool,
    /// Counters.
    pub counters: RecoveryCounters,
}

impl Manifold {
    /// Starts at a consistent configuration with its chart; `g` is the Jacobian there.
    pub fn new(
        system: Arc<dyn System>,
        mut chart: Chart,
        mut accelerator: Accelerator,
        g: BlockMatrix,
    ) -> Self {
        let sizes = system.structure().sizes;
        // The cheapest way is always there.
        let _ = accelerator.choose(system.as_ref(), &mut chart, Accelerations::Auto);
        let orientation = chart.determinant_sign();
        Self {
            phi: vec![0.0; sizes.rows],
            rows: vec![0.0; sizes.rows],
            correction: vec![0.0; sizes.coordinates],
            predictor: vec![0.0; sizes.coordinates],
            independent: vec![0.0; chart.ndof()],
            curvature: vec![0.0; chart.ndof()],
            force: vec![0.0; sizes.coordinates],
            tau: vec![0.0; sizes.rows],
            z_rate: vec![0.0; sizes.extra_states],
            accelerator,
            redundant: Redundant::new(&chart, &g).map(Box::new),
            recent: RecentPoints::new(&chart, sizes.coordinates, anchored(&chart).len()),
            edges: anchored(&chart),
            system,
            chart,
            g,
            orientation,
            joint: None,
            at_time: 0.0,
            at: Vec::new(),
            stale: false,
            returned: false,
            multipliers_wait: false,
            counters: RecoveryCounters::default(),
        }
    }

    /// The system.
    pub fn system(&self) -> &Arc<dyn System> {
        &self.system
    }

    /// The factored [G; P] of the last evaluation.
    pub fn chart(&self) -> &Chart {
        &self.chart
    }

    /// The same, for solves.
    pub fn chart_mut(&mut self) -> &mut Chart {
        // What cannot be factored solves to no finite numbers, which every iteration refuses.
        let _ = self.catch_up();
        &mut self.chart
    }

    /// Recovers in joint coordinates from now on, in other parametrizations too; at the configuration q whose factors
    /// are at hand. Returns whether it can: lines are no edges there.
    pub fn use_joint_coordinates(&mut self, q: &[f64]) -> bool {
        self.at = q.to_vec();
        self.stale = false;
        self.joint = joint_form(&self.system, self.chart.parametrization(), q);
        self.joint.is_some() && self.refactor_joint().is_ok()
    }

    /// Whether it does.
    pub fn has_joint_coordinates(&self) -> bool {
        self.joint.is_some()
    }

    /// Coordinates along the tree, rows of cut joints and of drivers on the tree, and entries of the factor of the composite
    /// inertia matrix, which has no fill.
    pub fn joint_sizes(&self) -> Option<[usize; 3]> {
        self.joint.as_ref().map(|joint| joint.sizes())
    }

    fn refactor_joint(&mut self) -> Result<(), EvaluationFailure> {
        let Some(joint) = &mut self.joint else { return Ok(()) };
        joint.factor(self.chart.parametrization(), &self.edges, &self.at)?;
        self.orientation = joint.determinant_sign();
        Ok(())
    }

    /// Makes chart, G and M those of the last evaluation.
    ///
    /// # Errors
    /// `simulation/singular-configuration`.
    pub fn catch_up(&mut self) -> Result<(), EvaluationFailure> {
        if !std::mem::take(&mut self.stale) {
            return Ok(());
        }
        self.accelerator.forget();
        self.system.constraint_jacobian(&self.at, &mut self.g);
        self.accelerator.evaluate_mass(self.system.as_ref(), &self.at);
        self.chart.refactor(self.system.as_ref(), &self.at, &self.g)
    }

    /// Condition of what independent variables and joints leave to solve for.
    pub fn condition(&mut self) -> f64 {
        match &mut self.joint {
            Some(joint) => joint.condition(),
            None => self.chart.condition(),
        }
    }

    /// Makes room for solves with [G; P] for several right-hand sides at a time.
    pub fn reserve_lanes(&mut self) {
        self.chart.reserve_lanes();
        self.recent = RecentPoints::new(&self.chart, self.correction.len(), self.edges.len());
    }

    /// Where accelerations come from.
    pub fn accelerator(&self) -> &Accelerator {
        &self.accelerator
    }

    /// Accelerations come from there from now on, in other parametrizations too.
    ///
    /// # Errors
    /// [`Refusal`] where the stated way cannot be.
    pub fn set_accelerations(&mut self, stated: Accelerations) -> Result<(), Refusal> {
        self.accelerator.choose(self.system.as_ref(), &mut self.chart, stated)
    }

    /// Symbolic analyses made so far.
    pub fn analyses(&self) -> u64 {
        self.counters.analyses + self.chart.analyses() + self.accelerator.saddle().analyses()
    }

    /// M where accelerations were last evaluated.
    pub fn mass(&self) -> &BlockMatrix {
        self.accelerator.saddle().mass()
    }

    /// Evaluates M at q.
    pub fn evaluate_mass(&mut self, q: &[f64]) {
        self.accelerator.evaluate_mass(self.system.as_ref(), q);
    }

    /// G where velocities were last recovered.
    pub fn jacobian(&self) -> &BlockMatrix {
        &self.g
    }

    /// Changes the parametrization at the configuration where G was last evaluated.
    pub fn set_chart(&mut self, mut chart: Chart) {
        self.independent.resize(chart.ndof(), 0.0);
        self.curvature.resize(chart.ndof(), 0.0);
        self.orientation = chart.determinant_sign();
        self.counters.analyses += self.chart.analyses();
        // What cannot be with these rows is made up for by the cheapest way.
        let stated = self.accelerator.stated();
        let _ = self.accelerator.choose(self.system.as_ref(), &mut chart, stated);
        self.redundant = Redundant::new(&chart, &self.g).map(Box::new);
        self.edges = anchored(&chart);
        self.recent = RecentPoints::new(&chart, self.correction.len(), self.edges.len());
        self.chart = chart;
        if self.joint.is_some() {
            let q = std::mem::take(&mut self.at);
            if !self.use_joint_coordinates(&q) {
                (self.joint, self.orientation) = (None, 0.0);
            }
        }
    }

    /// Largest entry of a vector over the coordinates, lengths divided by the characteristic length.
    fn size_of(&self, x: &[f64]) -> f64 {
        let sizes = &self.system.structure().sizes;
        let inverse = 1.0 / self.system.characteristic_length();
        // On bits, so that NaN is larger than every number.
        let bits = |x: f64| x.to_bits() & !(1 << 63);
        let mut largest = 0;
        for body in x.chunks_exact(sizes.per_body) {
            let (lengths, angles) = body.split_at(sizes.translations);
            for x in lengths {
                largest = largest.max(bits(x * inverse));
            }
            for x in angles {
                largest = largest.max(bits(*x));
            }
        }
        let largest = f64::from_bits(largest);
        if largest.is_finite() { largest } else { f64::INFINITY }
    }

    /// Solves Φ(q, t) = 0, v(q) = p from the guess in `q`, which must be a point of the branch that is
    /// followed (the last accepted or evaluated one).
    ///
    /// The first correction is the tangent predictor. The result is accepted only if corrections
    /// contract, it ends within half the predicted movement of the predictor (or noise), and the
    /// sign of det [G; P] has not changed.
    ///
    /// # Errors
    /// `simulation/position-recovery` naming the constraint with the largest residual; `q` is then
    /// meaningless.
    pub fn recover_position(
        &mut self,
        t: f64,
        p: &[f64],
        q: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        self.counters.recoveries += 1;
        if let Some(joint) = &mut self.joint {
            let parametrization = self.chart.parametrization();
            if std::mem::take(&mut self.returned) {
                joint.read(parametrization, q, &mut self.edges);
            }
            let corrections = joint.recover_position(parametrization, t, p, &mut self.edges, q)?;
            self.counters.corrections += corrections;
            return Ok(());
        }
        self.recent.go_near(t, &mut self.chart, q, &mut self.edges);
        let noise = 8.0 * f64::EPSILON * self.size_of(q).max(1.0);
        let mut predicted = 0.0;
        let placed = self.chart.parametrization().relatives().map(|relatives| relatives.exact);
        if let Some(exact) = placed {
            predicted = self.place(t, p, q, exact)?;
            if exact {
                return Ok(());
            }
        }
        let mut before = f64::INFINITY;
        let mut fresh = false;
        for k in 0..MAX_CORRECTIONS {
            self.counters.corrections += 1;
            let size = self.correct(t, p, q);
            if k == 0 {
                predicted += size;
                self.predictor.copy_from_slice(q);
            }
            let rate = size / before;
            // Or the next one would be lost in the last place, even of a stiff element's length.
            if size <= noise || (k > 0 && 4.0 * rate * size <= UNNOTICED) {
                return self.check_branch(q, predicted, noise);
            }
            if k > 0 && rate > CONTRACTION_LIMIT {
                // Corrections that no longer fall have reached round-off, if they are that small.
                if before <= 1e3 * noise || (size <= NOISY_CORRECTION && self.residual_is_noise(q))
                {
                    return self.check_branch(q, predicted, noise.max(size));
                }
                if fresh {
                    break;
                }
            }
            let remaining = if k > 0 { (noise / size).ln() / rate.ln() } else { 0.0 };
            if k > 0 && !fresh && (remaining > WORTH_REFACTORING || rate > CONTRACTION_LIMIT) {
                if !size.is_finite() {
                    break;
                }
                self.factor_at(q)?;
                fresh = true;
            }
            before = size;
        }
        Err(self.position_failure(t, q))
    }

    /// Places the bodies along the forest, dependent coordinates by the tangent; returns how far they
    /// moved.
    fn place(
        &mut self,
        t: f64,
        p: &[f64],
        q: &mut [f64],
        exact: bool,
    ) -> Result<f64, EvaluationFailure> {
        let system = self.system.clone();
        let system = system.as_ref();
        if !exact {
            system.position_constraints(t, q, &mut self.phi);
            let parametrization = self.chart.parametrization();
            parametrization.positions(system, q, &mut self.independent);
            for (out, target) in self.independent.iter_mut().zip(p) {
                *out -= target;
            }
            if let Some(relatives) = parametrization.relatives() {
                relatives.count_turns(system, &self.edges, p, &mut self.independent);
            }
            self.chart.solve(&self.phi, &self.independent, &mut self.correction);
        }
        let Some(relatives) = self.chart.parametrization().relatives() else { return Ok(0.0) };
        if !exact {
            relatives.predict_dependent(system, q, &self.correction, &mut self.edges);
            self.predictor.copy_from_slice(q);
        }
        relatives.coordinates(system, t, p, &mut self.edges)?;
        relatives.place(system, &self.edges, q);
        if exact {
            return Ok(0.0);
        }
        for (out, (x, y)) in self.correction.iter_mut().zip(q.iter().zip(&self.predictor)) {
            *out = x - y;
        }
        Ok(self.size_of(&self.correction))
    }

    /// Recoveries go on from the configuration that references were last moved to.
    pub fn return_to_anchor(&mut self) {
        self.recent.forget();
        self.returned = true;
        if let Some(relatives) = self.chart.parametrization().relatives() {
            for (x, anchor) in self.edges.iter_mut().zip(&relatives.anchors) {
                *x = anchor.x;
            }
        }
    }

    /// Windings that follow the edges of the forest, at the last recovery.
    pub fn tell_turns(&self, winding: &mut [f64]) {
        if let Some(relatives) = self.chart.parametrization().relatives() {
            relatives.tell_turns(self.system.as_ref(), &self.edges, winding);
        }
    }

    /// Moves references to the configuration q last recovered, whose independent variables are `p`; those of
    /// directions and rotations once one of them is `turn` (rad) away. Returns whether v has changed.
    ///
    /// # Errors
    /// `simulation/singular-configuration`.
    pub fn move_references(
        &mut self,
        q: &[f64],
        p: &[f64],
        turn: f64,
    ) -> Result<bool, EvaluationFailure> {
        let system = self.system.as_ref();
        let Some(relatives) = self.chart.relatives_mut() else { return Ok(false) };
        self.recent.forget();
        let turning = turn == 0.0 || relatives.turning(system, p) > turn;
        relatives.move_references(system, q, Some(p), &mut self.edges, turning);
        let changed = relatives.moves && turning;
        if self.joint.is_some() {
            self.at.copy_from_slice(q);
            self.stale = true;
            self.refactor_joint()?;
            return Ok(changed);
        }
        if !changed {
            return Ok(false);
        }
        self.accelerator.forget();
        self.chart.refactor(system, q, &self.g)?;
        self.orientation = self.chart.determinant_sign();
        Ok(true)
    }

    /// Takes over the references of another manifold in the same parametrization.
    pub fn follow(&mut self, other: &Self) {
        let Some(from) = other.chart.parametrization().relatives() else { return };
        if let Some(to) = self.chart.relatives_mut() {
            to.references.copy_from_slice(&from.references);
            to.anchors.copy_from_slice(&from.anchors);
        }
        self.orientation = if other.joint.is_some() { 0.0 } else { other.orientation };
        self.return_to_anchor();
    }

    /// Stands where a step of another run began: at time t and the configuration q with its windings and
    /// independent variables `p`. References move there, those of directions and rotations if `turning`:
    /// directions then have these normals.
    ///
    /// # Errors
    /// `simulation/chart-reach`, `simulation/singular-configuration`.
    pub fn stand_at(
        &mut self,
        t: f64,
        q: &[f64],
        p: &[f64],
        winding: &[f64],
        turning: bool,
        normals: impl Iterator<Item = (usize, [f64; 3])>,
    ) -> Result<(), EvaluationFailure> {
        let system = self.system.as_ref();
        if let Some(relatives) = self.chart.relatives_mut() {
            relatives.tell_branches(system, t, p, winding, &mut self.edges)?;
            relatives.move_references(system, q, Some(p), &mut self.edges, turning);
            for (group, normal) in normals {
                relatives.references[group][3..].copy_from_slice(&normal);
            }
        }
        self.factor_at(q)?;
        self.orientation = self.chart.determinant_sign();
        self.return_to_anchor();
        Ok(())
    }

    /// Whether Φ, as the last correction found it, is rounding of the coordinates: an ill-conditioned
    /// [G; P] then turns it into corrections that do not fall.
    fn residual_is_noise(&self, q: &[f64]) -> bool {
        let largest = q.iter().fold(1.0f64, |m, x| m.max(x.abs()));
        self.phi.iter().all(|x| x.abs() <= 64.0 * f64::EPSILON * largest)
    }

    /// One correction of the quasi-Newton iteration; returns its size.
    fn correct(&mut self, t: f64, p: &[f64], q: &mut [f64]) -> f64 {
        self.system.position_constraints(t, q, &mut self.phi);
        let system = self.system.as_ref();
        self.chart.parametrization().positions(system, q, &mut self.independent);
        for (out, target) in self.independent.iter_mut().zip(p) {
            *out -= target;
        }
        if let Some(relatives) = self.chart.parametrization().relatives() {
            relatives.reduce_turns(system, &mut self.independent);
        }
        self.chart.solve(&self.phi, &self.independent, &mut self.correction);
        for (x, d) in q.iter_mut().zip(&self.correction) {
            *x -= d;
        }
        self.size_of(&self.correction)
    }

    fn check_branch(
        &mut self,
        q: &[f64],
        predicted: f64,
        noise: f64,
    ) -> Result<(), EvaluationFailure> {
        for (out, (x, y)) in self.correction.iter_mut().zip(q.iter().zip(&self.predictor)) {
            *out = x - y;
        }
        if self.size_of(&self.correction) <= 0.5 * predicted + 1e3 * noise {
            return Ok(());
        }
        let moved = largest_index(&self.correction);
        let message = format!(
            "coordinate `{}` would leave the branch of the mechanism that was followed so far",
            self.system.coordinate_name(moved)
        );
        Err(EvaluationFailure::new("simulation/branch", message).of_coordinate(moved))
    }

    fn position_failure(&mut self, t: f64, q: &[f64]) -> EvaluationFailure {
        self.system.position_constraints(t, q, &mut self.phi);
        let (worst, moved) = (largest_index(&self.phi), largest_index(&self.correction));
        let correction = self.correction.get(moved).map_or(0.0, |x| x.abs());
        if self.residual_is_noise(q) {
            return EvaluationFailure::new("simulation/singular-configuration", format!(
                    "the joints are closed at t = {t:.6} s, but leave `{}` undetermined: corrections \
                     of {correction:.2e} do not fall",
                    self.system.coordinate_name(moved)
                )).of_coordinate(moved);
        }
        let residual = match self.phi.get(worst) {
            Some(size) => format!("{:.2e}, is in {}", size.abs(), self.system.row_name(worst)),
            None => "0, is in no joint".to_owned(),
        };
        EvaluationFailure::new("simulation/position-recovery", format!(
                "the joints could not be closed at t = {t:.6} s; the largest residual, {residual}; the \
                 last correction, {correction:.2e}, was of `{}`",
                self.system.coordinate_name(moved)
            )).of_row(self.phi.get(worst).map(|_| worst)).of_coordinate(moved)
    }

    /// Goes back to a configuration of the branch after a failure elsewhere, whose factors may be
    /// those of a nearly singular matrix.
    pub fn go_back(&mut self, q: &[f64]) {
        self.return_to_anchor();
        // A start that cannot be factored is found out by the next recovery.
        let _ = self.factor_at(q);
    }

    fn factor_at(&mut self, q: &[f64]) -> Result<(), EvaluationFailure> {
        self.counters.factorizations += 1;
        if let Some(joint) = &mut self.joint {
            self.at.copy_from_slice(q);
            self.stale = true;
            return joint.factor(self.chart.parametrization(), &self.edges, q);
        }
        self.accelerator.forget();
        self.recent.keep_factors(&mut self.chart);
        self.system.constraint_jacobian(q, &mut self.g);
        self.chart.refactor(self.system.as_ref(), q, &self.g)
    }

    /// Factors [G; P] at q and solves G q̇ = ν, P q̇ = `p_rate`; `full` if accelerations come next.
    ///
    /// # Errors
    /// `simulation/singular-configuration`, `simulation/branch` when det [G; P] changed its sign.
    pub fn recover_velocity(
        &mut self,
        t: f64,
        q: &[f64],
        p_rate: &[f64],
        v: &mut [f64],
        full: bool,
    ) -> Result<(), EvaluationFailure> {
        self.factor_at(q)?;
        let sign = match &self.joint {
            Some(joint) => joint.determinant_sign(),
            None => self.chart.determinant_sign(),
        };
        if self.orientation == 0.0 {
            self.orientation = sign;
        }
        if sign != self.orientation {
            return Err(EvaluationFailure::new(
                "simulation/branch",
                "the mechanism would pass through a singular configuration onto another \
                          branch",
            ));
        }
        if let Some(joint) = &mut self.joint {
            self.at_time = t;
            joint.recover_velocity(t, p_rate, v, q);
            return Ok(());
        }
        let at_hand = full && !self.system.has_drivers();
        if at_hand && let Some(form) = self.accelerator.null_space(&mut self.chart) {
            v.fill(0.0);
            form.add(p_rate, v);
            return Ok(());
        }
        self.system.velocity_rhs(t, &mut self.rows);
        self.chart.solve(&self.rows, p_rate, v);
        Ok(())
    }

    /// Accelerations at a state with consistent q and q̇ whose G was just evaluated by
    /// [`Manifold::recover_velocity`]; ż into `z_rate`. The multipliers are those of the state after
    /// [`Manifold::multipliers`] only.
    ///
    /// # Errors
    /// `simulation/singular-mass` when no acceleration is determined, `simulation/not-finite`.
    pub fn accelerate(
        &mut self,
        state: &mut State,
        z_rate: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        self.counters.accelerations += 1;
        let system = self.system.as_ref();
        system.forces(state, &mut self.force, &mut self.z_rate);
        z_rate.copy_from_slice(&self.z_rate);
        self.multipliers_wait = false;
        if let Some(joint) = &mut self.joint {
            self.multipliers_wait = joint.accelerate(&self.force, state);
            if self.multipliers_wait {
                return finite(state);
            }
            self.catch_up()?;
        }
        let system = self.system.as_ref();
        system.acceleration_rhs(state.t, &state.q, &state.v, &mut self.tau);
        self.accelerator.evaluate_mass(system, &state.q);
        let State { q, a, lambda, .. } = state;
        let at = Known { q, jacobian: &self.g, force: &self.force, tau: &self.tau };
        self.accelerator.accelerate(system, &mut self.chart, &at, a, lambda)?;
        finite(state)
    }

    /// What forces alone give: M̂⁻¹Dᵀ `force` at the configuration q last evaluated with accelerations.
    ///
    /// # Errors
    /// `simulation/singular-mass`.
    pub fn respond(
        &mut self,
        q: &[f64],
        force: &[f64],
        p_rate: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        self.catch_up()?;
        let system = self.system.as_ref();
        self.tau.fill(0.0);
        let (a, lambda) = (&mut self.correction, &mut self.rows);
        let at = Known { q, jacobian: &self.g, force, tau: &self.tau };
        self.accelerator.respond(system, &self.chart, &at, a, lambda)?;
        self.chart.parametrization().rates(system, q, a, p_rate);
        Ok(())
    }

    /// Multipliers of the state whose accelerations were the last to be computed.
    pub fn multipliers(&mut self, state: &mut State) {
        if let (true, Some(joint)) = (self.multipliers_wait, &mut self.joint) {
            joint.complete_multipliers(&self.force, state);
            self.multipliers_wait = false;
            return;
        }
        let State { a, lambda, .. } = state;
        self.accelerator.multipliers(&mut self.chart, &self.force, a, lambda);
    }

    /// ψ = Dᵀ(M q̈ − Q) for independent accelerations `p_rate` at a state with consistent q and q̇
    /// whose G was just evaluated by [`Manifold::recover_velocity`]; q̈ = D v̈ + S τ and
    /// λ = Sᵀ(Q − M q̈) into the state, ż into `z_rate`.
    ///
    /// Source: thesis (3.13), (3.14), (3.30).
    pub fn reduced_residual(
        &mut self,
        state: &mut State,
        p_rate: &[f64],
        z_rate: &mut [f64],
        psi: &mut [f64],
    ) {
        let system = self.system.as_ref();
        self.accelerator.forget_multipliers();
        self.multipliers_wait = false;
        system.forces(state, &mut self.force, z_rate);
        if let Some(joint) = &mut self.joint {
            joint.residual(self.chart.parametrization(), &self.force, p_rate, state, psi);
            return;
        }
        system.acceleration_rhs(state.t, &state.q, &state.v, &mut self.tau);
        let State { q, v, a, .. } = state;
        self.extend_acceleration(q, v, p_rate, a);
        let system = self.system.as_ref();
        self.force.iter_mut().for_each(|x| *x = -*x);
        self.accelerator.evaluate_mass(system, &state.q).multiply_add(
            1.0,
            &state.a,
            &mut self.force,
        );
        self.chart.solve_transposed(&self.force, &mut state.lambda, psi);
        state.lambda.iter_mut().for_each(|x| *x = -*x);
    }

    /// Multipliers of all joints for the accelerations of the last [`Manifold::reduced_residual`], which in joint
    /// coordinates finds those of the closures only.
    pub fn complete_residual(&mut self, state: &mut State) {
        if let Some(joint) = &mut self.joint {
            joint.complete_multipliers(&self.force, state);
        }
    }

    /// A change of independent variables and their rates on all coordinates, at the state of the last evaluation:
    /// δq = D δp, δq̇ = D δṗ − [S D] (A₀ δq). `rows` and `rates` are scratch of the lengths of λ and p.
    pub fn spread(
        &mut self,
        state: &State,
        change: [&[f64]; 2],
        [dq, dv]: [&mut [f64]; 2],
        [rows, rates]: [&mut [f64]; 2],
    ) {
        let [dp, dp_rate] = change;
        if let Some(joint) = &mut self.joint {
            joint.spread(self.chart.parametrization(), state, change, [dq, dv]);
            return;
        }
        rows.fill(0.0);
        self.chart.solve(rows, dp, dq);
        self.system.rate_change(&state.q, &state.v, dq, rows);
        rows.iter_mut().for_each(|x| *x = -*x);
        self.chart.parametrization().rate_change(self.system.as_ref(), state, dq, rates);
        for (out, rate) in rates.iter_mut().zip(dp_rate) {
            *out = rate - *out;
        }
        self.chart.solve(rows, rates, dv);
    }

    /// M̂ p = DᵀM D p with M and the factors of the last [`Manifold::reduced_residual`].
    pub fn reduced_mass_times(&mut self, p: &[f64], out: &mut [f64]) {
        if let Some(joint) = &mut self.joint {
            joint.mass_times(p, &self.at, out);
            return;
        }
        self.rows.fill(0.0);
        self.chart.solve(&self.rows, p, &mut self.correction);
        self.force.fill(0.0);
        self.accelerator.saddle().mass().multiply_add(1.0, &self.correction, &mut self.force);
        self.chart.solve_transposed(&self.force, &mut self.rows, out);
    }

    /// q̈ = D (v̈ − curvature) + S τ at the q and q̇ of the last [`Manifold::reduced_residual`] or
    /// [`Manifold::accelerate`], with its τ and factors.
    pub fn extend_acceleration(&mut self, q: &[f64], v: &[f64], p_rate: &[f64], a: &mut [f64]) {
        if self.joint.is_some() {
            // τ is not at hand either; what cannot be factored gives no finite numbers.
            let _ = self.catch_up();
            self.system.acceleration_rhs(self.at_time, q, v, &mut self.tau);
        }
        let parametrization = self.chart.parametrization();
        parametrization.curvature(self.system.as_ref(), q, v, &mut self.curvature);
        for ((out, rate), bend) in self.independent.iter_mut().zip(p_rate).zip(&self.curvature) {
            *out = rate - bend;
        }
        self.chart.solve(&self.tau, &self.independent, a);
    }

    /// (v, v̇) of a state.
    pub fn independent_state(&self, state: &State, positions: &mut [f64], rates: &mut [f64]) {
        let (system, parametrization) = (self.system.as_ref(), self.chart.parametrization());
        parametrization.positions(system, &state.q, positions);
        parametrization.rates(system, &state.q, &state.v, rates);
    }

    /// v̈ of the state whose accelerations were the last to be evaluated.
    pub fn independent_acceleration_anew(&mut self, state: &State, p_rate: &mut [f64]) {
        if let (true, Some(joint)) = (self.multipliers_wait, &mut self.joint) {
            joint.independent_acceleration(self.chart.parametrization(), state, p_rate);
        } else {
            self.independent_acceleration(state, p_rate);
        }
    }

    /// v̈ of a state with accelerations.
    pub fn independent_acceleration(&self, state: &State, p_rate: &mut [f64]) {
        let (system, parametrization) = (self.system.as_ref(), self.chart.parametrization());
        parametrization.accelerations(system, &state.q, &state.v, &state.a, p_rate);
    }

    /// (M q̈ + Gᵀλ − Q, G q̈ − τ) at a state with accelerations, multipliers and consistent q and q̇
    /// whose G was just evaluated by [`Manifold::recover_velocity`]; ż into `z_rate`.
    ///
    /// Source: thesis (3.76).
    pub fn descriptor_residual(
        &mut self,
        state: &State,
        z_rate: &mut [f64],
        force: &mut [f64],
        rows: &mut [f64],
    ) {
        let _ = self.catch_up();
        let system = self.system.as_ref();
        system.forces(state, force, z_rate);
        system.acceleration_rhs(state.t, &state.q, &state.v, rows);
        force.iter_mut().chain(rows.iter_mut()).for_each(|x| *x = -*x);
        self.accelerator.evaluate_mass(system, &state.q).multiply_add(1.0, &state.a, force);
        self.g.multiply_transposed_add(1.0, &state.lambda, force);
        self.g.multiply_add(1.0, &state.a, rows);
    }

    /// ‖Φ‖∞ and ‖G q̇ − ν‖∞ over all rows (redundant ones too) at a state whose G is current.
    pub fn residuals(&mut self, state: &State) -> (f64, f64) {
        let _ = self.catch_up();
        let largest = |x: &[f64]| x.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        self.system.position_constraints(state.t, &state.q, &mut self.phi);
        let position = largest(&self.phi);
        self.system.velocity_rhs(state.t, &mut self.rows);
        self.rows.iter_mut().for_each(|x| *x = -*x);
        self.g.multiply_add(1.0, &state.v, &mut self.rows);
        (position, largest(&self.rows))
    }

    /// Replaces the multipliers of a redundant set, where dropped rows have none, by those of
    /// minimum norm with the same generalized forces. G must belong to the state. Without redundant
    /// rows nothing changes.
    pub fn minimum_norm_multipliers(&mut self, lambda: &mut [f64]) {
        let joint_rows = self.system.structure().sizes.joint_rows;
        if self.redundant.is_some() {
            let _ = self.catch_up();
        }
        if let Some(redundant) = &mut self.redundant {
            redundant.distribute(&self.g, joint_rows, lambda);
        }
    }
}

fn finite(state: &State) -> Result<(), EvaluationFailure> {
    if state.a.iter().sum::<f64>().is_finite() {
        return Ok(());
    }
    Err(EvaluationFailure::new(
        "simulation/not-finite",
        format!("an acceleration is not a finite number at t = {:.6} s", state.t),
    ))
}

/// Coordinates of the edges where references were last moved.
fn anchored(chart: &Chart) -> Vec<[f64; 6]> {
    let relatives = chart.parametrization().relatives();
    relatives.map_or(Vec::new(), |r| r.anchors.iter().map(|anchor| anchor.x).collect())
}
