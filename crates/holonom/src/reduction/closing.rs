//! Closing the joints with least change of what is free.

use super::assembly::{AssemblyError, PROJECTED, unit_of_row};
use super::parametrization::largest_index;
use super::stated_joints::{Level, conditions, stated};
use crate::model::{Assembly, DriverKind, InitialBody, InitialCoordinate, Model};
use crate::system::{Measure, State, System};
use crate::watch::checkpoint;
use holonom_linalg::{BlockMatrix, least_norm, sparse_least_norm};
use std::cmp::Ordering::{Equal, Less};
use std::f64::consts::TAU;
use std::sync::Arc;

/// How a least change is found.
#[derive(Debug, Clone, Copy)]
struct Solve {
    /// Characteristic lengths in which lengths are measured.
    lengths: f64,
    /// Relative rank tolerance.
    rank: f64,
    /// Beyond about as many operations it comes from a sparse matrix, which knows no rank but damps what depends on other
    /// rows.
    dense: f64,
}

/// For a few solves, for many, and for steps that make a residual smaller where it cannot vanish.
const USUAL: Solve = Solve { lengths: 1.0, rank: 1e-10, dense: 1e8 };
const OFTEN: Solve = Solve { dense: 1e6, ..USUAL };
const PLAIN: Solve = Solve { rank: 1e-2, ..OFTEN };
const MAX_ITERATIONS: usize = 60;
/// Residual from which on an iteration has come near.
const NEAR: f64 = 1e-9;
/// By how much a step may turn a body, rad (|δp|), or slide it, characteristic lengths, where it turns it, too.
const FURTHEST: f64 = 0.5;
/// Turning by less, against how far bodies slide, is round-off.
const NO_TURN: f64 = 1e-9;
/// Corrections back to a path are at most so large against the one before, the first against the way that was gone.
const CONTRACTION: f64 = 0.3;
/// Corrections by less, against the way that was gone, end them.
const NEAR_PATH: f64 = 1e-2;
/// Halvings of a step that makes a residual no smaller, and what is smaller.
const HALVINGS: i32 = 12;
const LESS: f64 = 1.0 - 1e-6;
/// Over a long way lengths are measured in no more characteristic ones: beyond, the rank of rows that only turn bodies would
/// be lost.
const MOST_LENGTHS: f64 = 1e5;
/// Part of a path that is too short to go on, against the longest one; the first may be shorter by that once more.
const SHORTEST: f64 = 1e-3;
/// Paths one after the other that lead no nearer, and parts of all of them.
const IN_VAIN: usize = 4;
const MOST_TRIES: usize = 500;

/// The state with its positions or velocities closed: first what is not stated, with the stated
/// coordinates of joints as conditions, then all to remove what is left. With the largest residual of the
/// stated values.
pub(super) fn closed(
    system: &Arc<dyn System>,
    model: &Model,
    level: Level,
    from: &State,
) -> Result<(State, f64), AssemblyError> {
    let coordinates = stated(model, level);
    let number = usize::from(level != Level::Position);
    let keep = model.initial.assembly == Assembly::Keep;
    let attempt = |count: usize| Attempt::new(system, model, level, from, &coordinates[..count]);
    let all = attempt(coordinates.len());
    if all.residual <= PROJECTED {
        return Ok((all.finished(model, level), all.residual));
    }
    let plain = attempt(0);
    if plain.residual <= PROJECTED {
        if !keep {
            // What the conditions have reached serves as a guess.
            let near = Attempt::new(system, model, level, &all.state, &[]);
            let better = if near.residual <= PROJECTED { near } else { plain };
            return Ok((better.finished(model, level), all.residual));
        }
        // The first condition that cannot be kept together with those before it.
        for (count, c) in coordinates.iter().enumerate() {
            let failed = attempt(count + 1);
            if failed.residual <= PROJECTED {
                continue;
            }
            let (field, value) = (c.field.clone(), c.value);
            return Err(AssemblyError::StatedJoint {
                field,
                value,
                item: model.joints[c.joint].name.clone(),
                unit: unit(c),
                row: failed.told(model, level, &coordinates[..=count]),
                residual: failed.residual,
                row_unit: unit_of_row(failed.system.as_ref(), failed.row, number),
            });
        }
    }
    // What cannot be closed with everything free is no fault of what is stated.
    let everything = everything(system.as_ref());
    let mut state = plain.state;
    let (mut left, mut worst) = (plain.residual, plain.row);
    if plain.has_stated {
        state = from.clone();
        (left, worst) = solve(system.as_ref(), model, level, &mut state, &everything);
    }
    if left <= PROJECTED {
        return Err(AssemblyError::Inconsistent {
            level: if level == Level::Position { "positions" } else { "velocities" },
            row: system.row_name(plain.row),
            item: system.row_item(plain.row).0.to_owned(),
            residual: plain.residual,
            unit: unit_of_row(system.as_ref(), plain.row, number),
            allowed: PROJECTED,
        });
    }
    let open = open(system.as_ref(), model, level, &state);
    let found = match level {
        // The row that is open most where the iteration has stopped, of those that contradict each other.
        Level::Position => {
            let mut phi = vec![0.0; system.structure().sizes.rows];
            system.position_constraints(state.t, &state.q, &mut phi);
            let rows = Conflict::taking_part(&open);
            rows.max_by(|a, b| phi[*a].abs().total_cmp(&phi[*b].abs())).map(|row| (row, phi[row]))
        }
        Level::Velocity => {
            open.iter().copied().enumerate().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
        }
    };
    let found = found.map(|(row, residual)| (row, residual.abs()));
    let (worst, residual) = found.filter(|found| found.1 > PROJECTED).unwrap_or((worst, left));
    let rows = Conflict::rows(system.as_ref(), &open, worst);
    let axes = FrameAxes::of(system.as_ref(), rows.iter().take(SHOWN).chain([&worst]));
    let others = Conflict::named(system.as_ref(), &rows);
    let (row, item) = (system.row_name(worst), system.row_item(worst).0.to_owned());
    let unit = unit_of_row(system.as_ref(), worst, number);
    Err(match level {
        Level::Position => AssemblyError::Unreachable { row, item, residual, unit, others, axes },
        Level::Velocity => {
            let level = "velocity";
            AssemblyError::Contradiction { level, row, item, residual, unit, others }
        }
    })
}

/// What stays open of joints and drivers, whatever small change is made: beside a state, or of its velocities.
fn open(system: &dyn System, model: &Model, level: Level, state: &State) -> Vec<f64> {
    let mut residual = vec![0.0; system.structure().sizes.rows];
    let mut g = system.structure().constraint_pattern.zeros();
    if level == Level::Position {
        let mut beside = state.clone();
        let solver = Solver { system, model };
        solver.settle(&mut beside, &everything(system), &mut g, &mut residual);
        system.position_constraints(state.t, &beside.q, &mut residual);
        // That Euler parameters have unit length is no constraint of the user.
        residual.truncate(system.structure().sizes.joint_rows);
        return residual;
    }
    system.constraint_jacobian(&state.q, &mut g);
    system.velocity_rhs(state.t, &mut residual);
    g.multiply_add(-1.0, &state.v, &mut residual);
    contradiction(system, &state.q, &g, &residual)
}

/// What is left of a residual when no small change of the coordinates makes it smaller, by rows of joints and
/// drivers: Gᵀ n = 0, so that rows with n ≠ 0 depend on each other, and do not agree.
pub(super) fn contradiction(
    system: &dyn System,
    q: &[f64],
    g: &BlockMatrix,
    residual: &[f64],
) -> Vec<f64> {
    let mut left = residual.to_vec();
    if let Some(x) = least_change(system, g, residual, &everything(system), q, USUAL) {
        g.multiply_add(-1.0, &x, &mut left);
    }
    // That Euler parameters have unit length is no constraint of the user.
    left.truncate(system.structure().sizes.joint_rows);
    left
}

fn everything(system: &dyn System) -> Unknowns {
    Unknowns { free: (0..system.structure().sizes.coordinates).collect(), coupled: Vec::new() }
}

/// Constraints that contradict one of them, one row of each.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Conflict(pub Vec<String>);

/// Constraints that a message names.
const SHOWN: usize = 6;
/// Part of the largest entry below which a row takes no part in a contradiction.
const PART: f64 = 0.05;

impl Conflict {
    /// Those that with `row` take part in a [`contradiction`].
    pub(super) fn of(system: &dyn System, left: &[f64], row: usize) -> Self {
        Self::named(system, &Self::rows(system, left, row))
    }

    fn named(system: &dyn System, rows: &[usize]) -> Self {
        Self(rows.iter().map(|&k| system.row_name(k)).collect())
    }

    /// The rows of a contradiction.
    fn taking_part(left: &[f64]) -> impl Iterator<Item = usize> {
        let most = left.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        left.iter().enumerate().filter(move |(_, x)| x.abs() > PART * most).map(|(k, _)| k)
    }

    /// One row of each.
    fn rows(system: &dyn System, left: &[f64], row: usize) -> Vec<usize> {
        let mut largest: Vec<(&str, usize)> = Vec::new();
        for k in Self::taking_part(left) {
            let item = system.row_item(k).0;
            match largest.last_mut() {
                Some((last, at)) if *last == item => {
                    if left[k].abs() > left[*at].abs() {
                        *at = k;
                    }
                }
                _ => largest.push((item, k)),
            }
        }
        let own = system.row_item(row).0;
        let others = largest.into_iter().filter(|(item, _)| *item != own);
        others.map(|(_, k)| k).collect()
    }
}

/// Axes of frames of joints that the names of rows speak of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameAxes {
    /// None, but perhaps those of the ground.
    None,
    /// f and g.
    Planar,
    /// f, g and h.
    Spatial,
}

impl FrameAxes {
    fn of<'a>(system: &dyn System, mut rows: impl Iterator<Item = &'a usize>) -> Self {
        let of_frame = |&row: &usize| {
            let motion = system.row_item(row).1.motion();
            motion.is_some_and(|(_, axis)| axis.of_frame().is_some())
        };
        match system.structure().sizes.translations {
            _ if !rows.any(of_frame) => Self::None,
            2 => Self::Planar,
            _ => Self::Spatial,
        }
    }
}

impl std::fmt::Display for Conflict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let shown = self.0[..self.0.len().min(SHOWN)].join("; ");
        match self.0.len().saturating_sub(SHOWN) {
            _ if shown.is_empty() => f.write_str("the other joints"),
            0 => f.write_str(&shown),
            more => write!(f, "{shown}; and {more} more"),
        }
    }
}

fn unit(c: &InitialCoordinate) -> &'static str {
    match (c.kind, c.is_rate) {
        (DriverKind::Translation, false) => "m",
        (DriverKind::Translation, true) => "m/s",
        (DriverKind::Rotation, false) => "rad",
        (DriverKind::Rotation, true) => "rad/s",
    }
}

/// The unstated closed to the joints and some conditions.
struct Attempt {
    /// With the conditions as drivers.
    system: Arc<dyn System>,
    state: State,
    residual: f64,
    row: usize,
    /// Whether something is not free.
    has_stated: bool,
}

impl Attempt {
    fn new(
        system: &Arc<dyn System>,
        model: &Model,
        level: Level,
        from: &State,
        coordinates: &[&InitialCoordinate],
    ) -> Self {
        let system = conditions(model, coordinates, from.t).unwrap_or_else(|| Arc::clone(system));
        let mut state = from.clone();
        let free = unknowns(system.as_ref(), model, level);
        let has_stated = free.free.len() < system.structure().sizes.coordinates;
        let (residual, row) = solve(system.as_ref(), model, level, &mut state, &free);
        // No comparison holds for a residual that is not a number.
        let residual = if residual.is_nan() { f64::INFINITY } else { residual };
        Self { system, state, residual, row, has_stated }
    }

    /// What the worst row is to the user, who stated the coordinates and no drivers of their names.
    fn told(&self, model: &Model, level: Level, coordinates: &[&InitialCoordinate]) -> String {
        let first = self.system.structure().sizes.joint_rows - coordinates.len();
        let Some(other) = self.row.checked_sub(first).and_then(|k| coordinates.get(k)) else {
            return self.system.row_name(self.row);
        };
        if coordinates.last().is_some_and(|last| !std::ptr::eq(*last, *other)) {
            let joint = &model.joints[other.joint].name;
            return format!("the stated {} of joint `{joint}`", other.field);
        }
        let is_stated = |body: &usize| {
            model.initial.bodies.get(*body).is_some_and(|own| match level {
                Level::Position => own.position.is_some() || own.orientation.is_some(),
                Level::Velocity => own.velocity.is_some() || own.angular_velocity.is_some(),
            })
        };
        let bodies: Vec<String> = (other.frames.iter().filter_map(|frame| frame.body))
            .filter(is_stated)
            .map(|body| format!("body `{}`", model.bodies[body].name))
            .collect();
        if bodies.is_empty() {
            return "what else is stated".to_owned();
        }
        format!("what is stated of {}", bodies.join(" and "))
    }

    /// The state with what is left of the residual removed.
    fn finished(&self, model: &Model, level: Level) -> State {
        let mut state = self.state.clone();
        let everything = everything(self.system.as_ref());
        solve(self.system.as_ref(), model, level, &mut state, &everything);
        state
    }
}

/// Closes positions or velocities over `unknowns`; the largest residual left and its row.
fn solve(
    system: &dyn System,
    model: &Model,
    level: Level,
    state: &mut State,
    unknowns: &Unknowns,
) -> (f64, usize) {
    let solver = Solver { system, model };
    let mut g = system.structure().constraint_pattern.zeros();
    if level == Level::Position {
        return solver.close(state, unknowns, &mut g);
    }
    system.constraint_jacobian(&state.q, &mut g);
    solver.close_velocities(state, unknowns, &g)
}

/// Coordinates that are not stated; all of them where stated values are guesses.
pub(super) fn unknowns(system: &dyn System, model: &Model, level: Level) -> Unknowns {
    let sizes = system.structure().sizes;
    let (n, d) = (sizes.per_body, sizes.translations);
    let keep = model.initial.assembly == Assembly::Keep;
    let none = InitialBody::default();
    let mut out = Unknowns { free: Vec::new(), coupled: Vec::new() };
    for (b, body) in model.bodies.iter().enumerate() {
        let own = model.initial.bodies.get(b).unwrap_or(&none);
        let (translation, rotation) = match level {
            _ if !keep => (false, false),
            Level::Position => (own.position.is_some(), own.orientation.is_some()),
            Level::Velocity => (own.velocity.is_some(), own.angular_velocity.is_some()),
        };
        if !translation {
            out.free.extend(b * n..b * n + d);
        }
        if !rotation {
            out.free.extend(b * n + d..(b + 1) * n);
        }
        if translation && !rotation && body.center_of_mass.iter().any(|c| *c != 0.0) {
            out.coupled.push(b);
        }
    }
    out
}

/// Dense helper over free unknowns, with the couplings of bodies whose origin is stated while their
/// orientation is free and their centre of mass lies elsewhere.
pub(super) struct Unknowns {
    pub(super) free: Vec<usize>,
    /// Per such body: first coordinate and W = ∂(A c)/∂p (3×4, planar 2×1) by rows.
    coupled: Vec<usize>,
}

/// Least-change solves over a set of free unknowns.
struct Solver<'a> {
    system: &'a dyn System,
    model: &'a Model,
}

impl Solver<'_> {
    /// Gauss-Newton with minimum-norm corrections on Φ(q) = 0; returns the largest residual and its
    /// row. Without progress it stops; the residual then tells.
    fn close(&self, state: &mut State, unknowns: &Unknowns, g: &mut BlockMatrix) -> (f64, usize) {
        let mut phi = vec![0.0; self.system.structure().sizes.rows];
        // Corrections find what is near; to what is far leads a path.
        let start = state.q.clone();
        if !self.approach(state, unknowns, g, &mut phi) {
            let left = self.left(state, &mut phi);
            let stuck = std::mem::replace(&mut state.q, start);
            self.follow(state, unknowns, g, &mut phi);
            self.approach(state, unknowns, g, &mut phi);
            if !matches!(self.left(state, &mut phi).partial_cmp(&left), Some(Less)) {
                state.q = stuck;
            }
        }
        self.system.position_constraints(state.t, &state.q, &mut phi);
        let mut worst = largest_index(&phi);
        // Parameters of another length than one hide which joint is open.
        let joint_rows = self.system.structure().sizes.joint_rows;
        if worst >= joint_rows && phi.get(worst).is_some_and(|x| x.abs() > PROJECTED) {
            self.restore_lengths(state, unknowns);
            self.system.position_constraints(state.t, &state.q, &mut phi);
            worst = largest_index(&phi);
        }
        if phi.is_empty() { (0.0, 0) } else { (phi[worst].abs(), worst) }
    }

    /// Size of what is left, lengths against the characteristic one; `phi` is room for all rows.
    fn left(&self, state: &State, phi: &mut [f64]) -> f64 {
        self.system.position_constraints(state.t, &state.q, phi);
        let scale = scale(self.system, 0);
        let rows = phi.iter().zip(&self.system.structure().row_measure);
        let squares = rows.map(|(x, measure)| match measure {
            Measure::Length => (scale * x).powi(2),
            Measure::Angle => x * x,
        });
        squares.sum::<f64>().sqrt()
    }

    /// The iteration; whether it has come near. `phi` is room for Φ.
    fn approach(
        &self,
        state: &mut State,
        unknowns: &Unknowns,
        g: &mut BlockMatrix,
        phi: &mut [f64],
    ) -> bool {
        let mut best = f64::INFINITY;
        let mut stalled = 0;
        for _ in 0..MAX_ITERATIONS {
            self.system.position_constraints(state.t, &state.q, phi);
            let size = phi.iter().fold(0.0f64, |m, x| m.max(x.abs()));
            if size < 1e-14 || unknowns.free.is_empty() {
                return true;
            }
            if !size.is_finite() {
                return false;
            }
            stalled = if size < 0.9 * best { 0 } else { stalled + 1 };
            best = best.min(size);
            if stalled > if best < NEAR { 1 } else { 12 } {
                break;
            }
            let step = self.least_change(&state.q, unknowns, g, phi, USUAL);
            let Some(mut step) = step else { break };
            let [slid, turned] = largest(self.system, &step, 1.0);
            // What only slides is linear.
            if turned > NO_TURN * slid {
                step = limited(self.system, step, 1.0);
            }
            self.subtract(state, unknowns, &step);
        }
        best < NEAR
    }

    /// Goes to where no small change makes what is left smaller, if anything is: which rows contradict each other shows there.
    fn settle(&self, state: &mut State, unknowns: &Unknowns, g: &mut BlockMatrix, phi: &mut [f64]) {
        let mut left = self.left(state, phi);
        for _ in 0..MAX_ITERATIONS {
            if !(NEAR..f64::INFINITY).contains(&left) {
                return;
            }
            let step = self.least_change(&state.q, unknowns, g, phi, PLAIN);
            let Some(mut step) = step.map(|step| limited(self.system, step, 1.0)) else { return };
            let from = state.q.clone();
            let mut least = f64::INFINITY;
            for _ in 0..HALVINGS {
                self.subtract(state, unknowns, &step);
                least = self.left(state, phi);
                if least < LESS * left {
                    break;
                }
                state.q.copy_from_slice(&from);
                step.iter_mut().for_each(|x| *x *= 0.5);
            }
            if least >= LESS * left {
                return;
            }
            left = least;
        }
    }

    /// Goes along the path on which Φ(q) is a smaller and smaller part of what it is at first, least change all the way
    /// (D. F. Davidenko, Dokl. Akad. Nauk SSSR 88 (1953) 601): each part is closed before the next. Where the path turns
    /// back, as at a dead point, another one begins beyond.
    fn follow(&self, state: &mut State, unknowns: &Unknowns, g: &mut BlockMatrix, phi: &mut [f64]) {
        let mut first = vec![0.0; phi.len()];
        let (mut tries, mut in_vain, mut least) = (0, 0, f64::INFINITY);
        loop {
            let open = self.left(state, &mut first);
            in_vain = if open < 0.9 * least { 0 } else { in_vain + 1 };
            if in_vain == IN_VAIN {
                return;
            }
            least = least.min(open);
            // Over a long way least change would turn bodies where sliding them will do.
            let step = self.least_change(&state.q, unknowns, g, &first, USUAL);
            let Some(step) = step else { return };
            let lengths = (largest(self.system, &step, 1.0)[0] / FURTHEST).clamp(1.0, MOST_LENGTHS);
            let by = Solve { lengths, ..OFTEN };
            let (mut left, mut longest, mut usual) = (1.0, 1.0f64, 0.0f64);
            while left > 0.0 {
                let from = state.q.clone();
                let tangent = self.least_change(&from, unknowns, g, &first, by);
                let Some(tangent) = tangent else { return };
                let [_, turned] = largest(self.system, &tangent, lengths);
                if !turned.is_finite() {
                    return;
                }
                // Equal parts of what is left, so that no remainder is too short.
                let mut part = left / (left / longest.min(FURTHEST / turned)).ceil().max(1.0);
                let shortest = SHORTEST * if usual > 0.0 { usual } else { SHORTEST }.min(part);
                loop {
                    tries += 1;
                    if tries > MOST_TRIES {
                        return;
                    }
                    let step: Vec<f64> = tangent.iter().map(|x| part * x).collect();
                    self.subtract(state, unknowns, &step);
                    let there = (left - part, by);
                    if self.return_to_path(state, unknowns, g, [phi, &mut first], there, &step) {
                        break;
                    }
                    state.q.copy_from_slice(&from);
                    part *= 0.5;
                    if part <= shortest {
                        break;
                    }
                }
                if part <= shortest {
                    self.subtract(state, unknowns, &limited(self.system, tangent, lengths));
                    break;
                }
                usual = usual.max(part);
                longest = 2.0 * part;
                left = if part < left { left - part } else { 0.0 };
            }
            if left == 0.0 {
                return;
            }
        }
    }

    /// Corrects a state that has gone a step along a path until it is on it again, where only the part `left` of `first` is;
    /// whether corrections are small, against that step, and become so.
    fn return_to_path(
        &self,
        state: &mut State,
        unknowns: &Unknowns,
        g: &mut BlockMatrix,
        [phi, first]: [&mut [f64]; 2],
        (left, by): (f64, Solve),
        step: &[f64],
    ) -> bool {
        let way = size(self.system, step, by.lengths);
        let mut before = way;
        loop {
            self.system.position_constraints(state.t, &state.q, phi);
            for (row, (x, first)) in phi.iter_mut().zip(first.iter()).enumerate() {
                *x -= left * first;
                if self.system.structure().row_measure[row] == Measure::Angle {
                    *x -= TAU * (*x / TAU).round();
                }
            }
            let step = self.least_change(&state.q, unknowns, g, phi, by);
            let Some(step) = step else { return false };
            let length = size(self.system, &step, by.lengths);
            // No comparison holds for what is not a number.
            if !matches!(length.partial_cmp(&(CONTRACTION * before)), Some(Less | Equal)) {
                return false;
            }
            self.subtract(state, unknowns, &step);
            if length <= NEAR_PATH * way {
                return true;
            }
            before = length;
        }
    }

    /// The shortest step at a configuration that would take a residual away, found as [`least_change`] says.
    fn least_change(
        &self,
        q: &[f64],
        unknowns: &Unknowns,
        g: &mut BlockMatrix,
        residual: &[f64],
        by: Solve,
    ) -> Option<Vec<f64>> {
        self.system.constraint_jacobian(q, g);
        least_change(self.system, g, residual, unknowns, q, by)
    }

    fn subtract(&self, state: &mut State, unknowns: &Unknowns, step: &[f64]) {
        for (q, x) in state.q.iter_mut().zip(step) {
            *q -= x;
        }
        self.restore_origins(state, unknowns);
    }

    /// Gives free Euler parameters unit length.
    fn restore_lengths(&self, state: &mut State, unknowns: &Unknowns) {
        let sizes = self.system.structure().sizes;
        let (n, d) = (sizes.per_body, sizes.translations);
        for at in unknowns.free.iter().filter(|&&i| i % n == d) {
            let p = &mut state.q[*at..at + n - d];
            let length = p.iter().map(|x| x * x).sum::<f64>().sqrt();
            if length > 0.0 {
                p.iter_mut().for_each(|x| *x /= length);
            }
        }
        self.restore_origins(state, unknowns);
    }

    /// Minimum-norm correction of velocities; returns the largest residual left and its row.
    fn close_velocities(
        &self,
        state: &mut State,
        unknowns: &Unknowns,
        g: &BlockMatrix,
    ) -> (f64, usize) {
        let rows = self.system.structure().sizes.rows;
        let mut residual = vec![0.0; rows];
        let evaluate = |v: &[f64], residual: &mut Vec<f64>| {
            self.system.velocity_rhs(state.t, residual);
            residual.iter_mut().for_each(|x| *x = -*x);
            g.multiply_add(1.0, v, residual);
        };
        // Twice: the second solve removes the round-off of the first.
        for _ in 0..2 {
            evaluate(&state.v, &mut residual);
            if unknowns.free.is_empty() || residual.iter().all(|x| x.abs() < 1e-14) {
                break;
            }
            let Some(step) = least_change(self.system, g, &residual, unknowns, &state.q, USUAL)
            else {
                break;
            };
            for (v, x) in state.v.iter_mut().zip(&step) {
                *v -= x;
            }
        }
        evaluate(&state.v, &mut residual);
        let worst = largest_index(&residual);
        if rows == 0 { (0.0, 0) } else { (residual[worst].abs(), worst) }
    }

    /// Puts the origins of coupled bodies back to their stated places.
    fn restore_origins(&self, state: &mut State, unknowns: &Unknowns) {
        for &b in &unknowns.coupled {
            let stated = self.model.initial.bodies.get(b);
            let Some(position) = stated.and_then(|own| own.position) else { continue };
            let mut pose = self.system.body(b, &state.q, &state.v);
            pose.position = position;
            let mut v = state.v.clone();
            self.system.set_body(b, &pose, &mut state.q, &mut v);
        }
    }
}

/// Minimum-norm x over the free unknowns with G x = r, as [`Solve`] says; coupled translations follow their orientations.
fn least_change(
    system: &dyn System,
    g: &BlockMatrix,
    r: &[f64],
    unknowns: &Unknowns,
    q: &[f64],
    by: Solve,
) -> Option<Vec<f64>> {
    let sizes = system.structure().sizes;
    let (m, n, k) = (sizes.rows, sizes.coordinates, unknowns.free.len());
    checkpoint(m * k);
    let (per_body, d) = (sizes.per_body, sizes.translations);
    let couplings: Vec<(usize, Vec<f64>)> =
        unknowns.coupled.iter().map(|&b| (b, coupling(system, b, q))).collect();
    let mut column = vec![None; n];
    for (at, &i) in unknowns.free.iter().enumerate() {
        column[i] = Some(at);
    }
    let weights: Vec<f64> =
        unknowns.free.iter().map(|&i| 1.0 / weight(system, i, by.lengths)).collect();
    let mut coupled = vec![None; sizes.bodies];
    for (b, w) in &couplings {
        coupled[*b] = Some(w);
    }
    let mut entries = Vec::new();
    for ((row, i), x) in g.entries(0, 0).into_iter().zip(g.values()) {
        let mut add = |i: usize, x: f64| {
            if let Some(at) = column[i] {
                entries.push((row, at, x * weights[at]));
            }
        };
        add(i, *x);
        if let (Some(w), true) = (coupled[i / per_body], i % per_body < d) {
            for c in 0..per_body - d {
                let factor = w[i % per_body * (per_body - d) + c];
                add(i / per_body * per_body + d + c, x * factor);
            }
        }
    }
    let solution = if (m * m) as f64 * k as f64 <= by.dense {
        let mut a = vec![0.0; m * k];
        for (row, at, x) in entries {
            a[row * k + at] += x;
        }
        least_norm(m, k, &a, r, by.rank).ok()?.x
    } else {
        sparse_least_norm(m, k, &entries, r).ok()?
    };
    let mut x = vec![0.0; n];
    for ((&i, y), w) in unknowns.free.iter().zip(&solution).zip(&weights) {
        x[i] = y * w;
    }
    for (b, w) in &couplings {
        for i in 0..d {
            x[b * per_body + i] = (0..per_body - d)
                .map(|c| w[i * (per_body - d) + c] * x[b * per_body + d + c])
                .sum();
        }
    }
    Some(x)
}

/// ∂(A c)/∂p of a body, D×(N−D) by rows; A is quadratic in the Euler parameters, so central
/// differences are exact for them and accurate to 1e-10 for an angle.
fn coupling(system: &dyn System, body: usize, q: &[f64]) -> Vec<f64> {
    let sizes = system.structure().sizes;
    let (n, d) = (sizes.per_body, sizes.translations);
    let h = 1e-5;
    let arm = |shift: f64, c: usize| {
        let mut moved = q.to_vec();
        moved[body * n + d + c] += shift;
        let rest = vec![0.0; q.len()];
        let pose = system.body(body, &moved, &rest);
        let r = &moved[body * n..];
        [
            r[0] - pose.position[0],
            r[1] - pose.position[1],
            r.get(2).unwrap_or(&0.0) - pose.position[2],
        ]
    };
    let mut w = vec![0.0; d * (n - d)];
    for c in 0..n - d {
        let (plus, minus) = (arm(h, c), arm(-h, c));
        for i in 0..d {
            w[i * (n - d) + c] = (plus[i] - minus[i]) / (2.0 * h);
        }
    }
    w
}

/// What makes changes of a coordinate comparable: 1/m for lengths.
pub(super) fn scale(system: &dyn System, coordinate: usize) -> f64 {
    match system.structure().coordinate_measure(coordinate) {
        Measure::Length => 1.0 / system.characteristic_length(),
        Measure::Angle => 1.0,
    }
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// What makes changes of a coordinate comparable, lengths measured in so many characteristic ones.
fn weight(system: &dyn System, coordinate: usize, lengths: f64) -> f64 {
    match system.structure().coordinate_measure(coordinate) {
        Measure::Length => scale(system, coordinate) / lengths,
        Measure::Angle => scale(system, coordinate),
    }
}

/// Size of a step.
fn size(system: &dyn System, step: &[f64], lengths: f64) -> f64 {
    let entries = step.iter().enumerate().map(|(i, x)| (weight(system, i, lengths) * x).powi(2));
    entries.sum::<f64>().sqrt()
}

/// A step shortened until it slides and turns no body by more than [`FURTHEST`].
fn limited(system: &dyn System, mut step: Vec<f64>, lengths: f64) -> Vec<f64> {
    let [slid, turned] = largest(system, &step, lengths);
    let longest = slid.max(turned);
    if longest > FURTHEST {
        step.iter_mut().for_each(|x| *x *= FURTHEST / longest);
    }
    step
}

/// How far a step slides and turns the body that it slides and turns most, lengths measured in so many characteristic ones:
/// sizes of vectors, which a common rotation of the model does not change.
fn largest(system: &dyn System, step: &[f64], lengths: f64) -> [f64; 2] {
    let sizes = system.structure().sizes;
    step.chunks_exact(sizes.per_body).fold([0.0, 0.0], |[slid, turned]: [f64; 2], x| {
        let (r, p) = x.split_at(sizes.translations);
        [slid.max(scale(system, 0) / lengths * norm(r)), turned.max(norm(p))]
    })
}
