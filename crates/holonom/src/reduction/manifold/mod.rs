//! From independent to all coordinates: positions, velocities, accelerations and multipliers.

mod coordinates;
mod positions;
mod references;

use crate::error::EvaluationFailure;
use crate::reduction::accelerations::{Accelerations, Accelerator, Known, Refusal};
use crate::reduction::chart::{Chart, Factors};
use crate::reduction::joint::JointForm;
use crate::reduction::recent::RecentPoints;
use crate::reduction::redundant::Redundant;
use crate::system::{State, System};
use crate::threads::Threads;
use holonom_linalg::BlockMatrix;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

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
    /// Of these, those that the joint form left to the Cartesian solvers.
    #[serde(default)]
    pub left_to_cartesian: u64,
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
    /// Configurations recovered before, within this step, where they are kept.
    recent: RecentPoints<Factors>,
    keeps_recent: bool,
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
    threads: Threads,
    /// Time and configuration of the last evaluation in joint coordinates.
    at_time: f64,
    at: Vec<f64>,
    stale: bool,
    /// Whether the next recovery starts from another configuration than the last one left.
    returned: bool,
    /// Whether it evaluates what steps have been through.
    is_beside: bool,
    /// Where all edges stood when their references were last moved; no number where some were left behind.
    anchored: Vec<f64>,
    /// Whether accelerations came from joint coordinates, and multipliers of the tree's joints have not been asked for.
    multipliers_wait: bool,
    /// Whether the accelerations last evaluated are those of joint coordinates.
    moves_along: bool,
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
        let mut out = Self {
            phi: Vec::new(),
            rows: Vec::new(),
            correction: Vec::new(),
            predictor: Vec::new(),
            independent: Vec::new(),
            curvature: Vec::new(),
            force: Vec::new(),
            tau: Vec::new(),
            z_rate: vec![0.0; sizes.extra_states],
            accelerator,
            redundant: Redundant::new(&chart, &g).map(Box::new),
            recent: RecentPoints::none(),
            keeps_recent: false,
            edges: anchored(&chart),
            system,
            chart,
            g,
            orientation,
            joint: None,
            threads: Threads::default(),
            at_time: 0.0,
            at: Vec::new(),
            stale: false,
            returned: false,
            is_beside: false,
            anchored: vec![f64::NAN; sizes.coordinates],
            multipliers_wait: false,
            moves_along: false,
            counters: RecoveryCounters::default(),
        };
        out.make_room();
        out
    }

    fn make_room(&mut self) {
        let (sizes, ndof) = (self.system.structure().sizes, self.chart.ndof());
        let Self { phi, rows, tau, correction, predictor, force, independent, curvature, .. } =
            self;
        [phi, rows, tau].into_iter().for_each(|x| x.resize(sizes.rows, 0.0));
        let of_coordinates = [correction, predictor, force];
        of_coordinates.into_iter().for_each(|x| x.resize(sizes.coordinates, 0.0));
        [independent, curvature].into_iter().for_each(|x| x.resize(ndof, 0.0));
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

    /// Makes room for derivatives: for recursions along the tree, or solves with [G; P] for several right-hand sides at a time.
    pub fn reserve_lanes(&mut self) {
        self.chart.reserve_lanes();
        if let Some(joint) = &mut self.joint {
            joint.keep_room_for_derivatives(true);
        }
        self.make_room_for_recent();
    }

    /// From now on configurations recovered lately are kept with their factors, for who evaluates in steps.
    pub fn keep_recent(&mut self) {
        if !self.keeps_recent {
            self.keeps_recent = true;
            self.make_room_for_recent();
        }
    }

    fn make_room_for_recent(&mut self) {
        // Joint coordinates keep their own.
        self.recent = if self.keeps_recent && self.joint.is_none() {
            self.chart.recent_points(self.correction.len(), self.edges.len())
        } else {
            RecentPoints::none()
        };
    }

    /// A copy for evaluations beside those of steps. In joint coordinates chart, G and M wait to be asked for, and have no
    /// room until then.
    pub fn beside(&self) -> Self {
        let mut out = self.clone();
        out.is_beside = true;
        if let Some(joint) = &mut out.joint {
            joint.keep_room_for_derivatives(false);
            out.give_up_factors();
            out.accelerator.release_mass();
        }
        out
    }

    /// Gives up what [`Manifold::awake`] makes the same again at the configuration q, its own: pivots of a sparse matrix are
    /// those of its way there. M stays for those that begin with these patterns and pivots.
    pub(in crate::reduction) fn rest(&mut self, q: &[f64]) {
        self.accelerator.release();
        let Self { phi, rows, tau, correction, predictor, force, .. } = self;
        let room = [phi, rows, tau, correction, predictor, force];
        room.into_iter().for_each(|x| *x = Vec::new());
        if self.chart.forest().is_some() {
            self.give_up_factors();
            self.at = q.to_vec();
        }
    }

    /// A copy that has everything again.
    pub(in crate::reduction) fn awake(&self) -> Self {
        let mut out = self.clone();
        out.make_room();
        // It could be factored before.
        let _ = out.catch_up();
        out
    }

    fn give_up_factors(&mut self) {
        self.chart.release();
        self.g.release();
        self.stale = true;
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
        self.orientation = chart.determinant_sign();
        self.counters.analyses += self.chart.analyses();
        // What cannot be with these rows is made up for by the cheapest way.
        let stated = self.accelerator.stated();
        let _ = self.accelerator.choose(self.system.as_ref(), &mut chart, stated);
        self.redundant = Redundant::new(&chart, &self.g).map(Box::new);
        self.g.restore();
        self.edges = anchored(&chart);
        self.anchored.fill(f64::NAN);
        self.chart = chart;
        self.make_room();
        if self.joint.is_some() {
            let q = std::mem::take(&mut self.at);
            self.use_joint_coordinates(&q, usize::MAX);
        }
        self.make_room_for_recent();
    }

    /// Goes back to a configuration of the branch after a failure elsewhere, whose factors may be
    /// those of a nearly singular matrix.
    pub fn go_back(&mut self, q: &[f64]) {
        self.return_to_anchor();
        self.moves_along = false;
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
        self.recent.keep_factors(|factors| self.chart.exchange(factors));
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
        self.moves_along = false;
        self.factor_at(q)?;
        let sign = match &self.joint {
            Some(joint) => joint.determinant_sign(),
            None => self.chart.determinant_sign(),
        };
        if self.orientation == 0.0 {
            self.orientation = sign;
        }
        // Of redundant rows those in use may be singular where the mechanism is not: steps part there.
        if sign != self.orientation && !(self.is_beside && self.redundant.is_some()) {
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
        self.multipliers_wait = false;
        if let Some(joint) = &mut self.joint {
            self.multipliers_wait = joint.accelerate(state, z_rate);
            self.moves_along = self.multipliers_wait;
            if self.multipliers_wait {
                self.accelerator.forget_multipliers();
                return finite(state);
            }
            self.counters.left_to_cartesian += 1;
            self.catch_up()?;
        }
        let system = self.system.as_ref();
        system.forces(state, &mut self.force, z_rate);
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
            self.multipliers_wait = false;
            if !joint.complete_multipliers(state) {
                self.multipliers_of_all(state);
            }
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
        if let Some(joint) = &mut self.joint {
            joint.residual(self.chart.parametrization(), p_rate, state, z_rate, psi);
            self.moves_along = true;
            return;
        }
        system.forces(state, &mut self.force, z_rate);
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
        if let Some(joint) = &mut self.joint
            && !joint.complete_multipliers(state)
        {
            self.multipliers_of_all(state);
        }
    }

    /// λ = Sᵀ(Q − M q̈) at the state of the last evaluation.
    fn multipliers_of_all(&mut self, state: &mut State) {
        let _ = self.catch_up();
        self.system.forces(state, &mut self.force, &mut self.z_rate);
        self.correction.copy_from_slice(&self.force);
        self.accelerator.saddle().mass().multiply_add(-1.0, &state.a, &mut self.correction);
        self.chart.solve_transposed(&self.correction, &mut state.lambda, &mut self.independent);
    }

    /// A change of independent variables on all coordinates, at the configuration q of the last evaluation: δq = D δp.
    /// `rows` is scratch of the length of λ.
    pub fn displace(&mut self, q: &[f64], dp: &[f64], dq: &mut [f64], rows: &mut [f64]) {
        if let Some(joint) = &mut self.joint {
            joint.displace(dp, q, dq);
            return;
        }
        rows.fill(0.0);
        self.chart.solve(rows, dp, dq);
    }

    /// A change of independent variables and their rates on all coordinates, at the state of the last evaluation:
    /// δq = D δp, δq̇ = D δṗ − [S D] (A₀ δq). `rows` and `rates` are scratch of the lengths of λ and p.
    pub fn spread(
        &mut self,
        state: &State,
        [dp, dp_rate]: [&[f64]; 2],
        [dq, dv]: [&mut [f64]; 2],
        [rows, rates]: [&mut [f64]; 2],
    ) {
        self.displace(&state.q, dp, dq, rows);
        if let Some(joint) = &mut self.joint {
            joint.displace_rates(self.chart.parametrization(), state, dp_rate, dq, dv);
            return;
        }
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

    /// (v, v̇, v̈) of the state whose accelerations were the last to be evaluated; references may have moved to it since.
    pub fn independent_motion(&self, state: &State, [p, p_rate, p_second]: [&mut [f64]; 3]) {
        let (system, parametrization) = (self.system.as_ref(), self.chart.parametrization());
        if let (true, Some(joint)) = (self.moves_along, &self.joint) {
            parametrization.positions(system, &state.q, p);
            joint.independent_motion(parametrization, state, [p_rate, p_second]);
        } else {
            self.independent_state(state, p, p_rate);
            self.independent_acceleration(state, p_second);
        }
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
