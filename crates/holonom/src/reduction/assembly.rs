//! A consistent start: positions, velocities, accelerations and multipliers that satisfy the joints.
//!
//! Stated values are kept: a residual below [`PROJECTED`] is projected away and reported, a larger
//! one is refused. Unstated values are found from the joints with least change.

use super::accelerations::{Accelerations, Accelerator};
use super::chart::Chart;
pub use super::closing::{Conflict, FrameAxes};
use super::closing::{closed, contradiction, scale};
use super::manifold::Manifold;
use super::parametrization::Parametrization;
use super::partitioning::RANK_TOLERANCE;
use super::saddle::Saddle;
use super::singular_elements::{ASIDE, coincident_ends, opposite_axes};
use super::stated_joints::{Level, carry, moved, place, turn, wind};
use super::structural::structural_nonzeros;
use super::tree::choose_tree;
use crate::error::{EvaluationFailure, rounded};
use crate::model::{Body, InitialBody, Model, Orientation};
use crate::system::{BodyPose, Measure, State, System};
use holonom_linalg::{BlockMatrix, Cholesky};
use std::sync::Arc;

/// Residuals of stated values up to this size are projected away (m, rad, m/s, rad/s).
pub const PROJECTED: f64 = 1e-6;
/// Axes that are nearer to one line than this, rad, are opposite from the start.
const SAME_LINE: f64 = 1e-8;
/// Stated values that moved less moved by round-off.
pub(super) const MOVED: f64 = 1e-10;

/// Why no consistent start was found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AssemblyError {
    /// Stated values contradict a joint.
    #[error(
        "the stated initial {level} contradict {row}: {} {unit} are left, {allowed:.0e} allowed",
        rounded(*.residual)
    )]
    Inconsistent {
        /// `positions` or `velocities`.
        level: &'static str,
        /// Joint and row.
        row: String,
        /// Name of the joint, driver or body.
        item: String,
        /// What is left of it.
        residual: f64,
        /// m, rad, m/s or rad/s.
        unit: &'static str,
        /// Largest residual that is projected away.
        allowed: f64,
    },
    /// A stated coordinate of a joint contradicts the joints or other stated values.
    #[error(
        "the stated {field} of joint `{item}`, {value} {unit}, contradicts {row}: {} {row_unit} are left, \
         {allowed:.0e} allowed",
        rounded(*.residual),
        allowed = PROJECTED
    )]
    StatedJoint {
        /// Name of the field, `angle`.
        field: String,
        /// Name of the joint.
        item: String,
        /// The stated value.
        value: f64,
        /// Its unit.
        unit: &'static str,
        /// Joint and row that keep the largest residual.
        row: String,
        /// That residual.
        residual: f64,
        /// Its unit: m, rad, m/s or rad/s.
        row_unit: &'static str,
    },
    /// The joints cannot be closed.
    #[error(
        "the model cannot be assembled: {row} stays open by {} {unit}; it cannot be met together with {others}",
        rounded(*.residual)
    )]
    Unreachable {
        /// Joint and row.
        row: String,
        /// Name of the joint, driver or body.
        item: String,
        /// What stays open.
        residual: f64,
        /// m or rad.
        unit: &'static str,
        /// What it cannot be met together with.
        others: Conflict,
        /// Axes that these rows are named by.
        axes: FrameAxes,
    },
    /// Redundant constraints contradict each other.
    #[error(
        "{row} contradicts {others}: at {level} level they differ by {} {unit}",
        rounded(*.residual)
    )]
    Contradiction {
        /// `position`, `velocity` or `acceleration`.
        level: &'static str,
        /// Joint and row.
        row: String,
        /// Name of the joint, driver or body.
        item: String,
        /// By what they differ.
        residual: f64,
        /// m, rad, or that per second, or per second squared.
        unit: &'static str,
        /// What it contradicts.
        others: Conflict,
    },
    /// No mass behind a degree of freedom.
    #[error("the mass matrix is singular: no mass or inertia behind {coordinate}")]
    SingularMass {
        /// Name of the body.
        body: String,
        /// Body and direction.
        coordinate: String,
    },
    /// The ends of a spring are at one place, where its force has no direction.
    #[error(
        "the ends of spring `{item}` coincide at the start, where its force of {} N has no direction",
        rounded(*.force)
    )]
    CoincidentEnds {
        /// Name of the spring.
        item: String,
        /// Elastic force, N.
        force: f64,
    },
    /// The same of a spring and a damper in series, whatever its free length.
    #[error(
        "the ends of `{item}`, a spring and a damper in series, coincide at the start, where its force has no \
         direction"
    )]
    CoincidentSeries {
        /// Name of the element.
        item: String,
    },
    /// The axes of a twist are opposite, where it has no value.
    #[error(
        "the axes of `{item}` on its two bodies are opposite at the start, where its twist has no value"
    )]
    OppositeAxes {
        /// Name of the rotational spring or rotation driver.
        item: String,
    },
    /// The equations could not be evaluated at the start.
    #[error("{0}")]
    Evaluation(#[from] EvaluationFailure),
}

impl AssemblyError {
    /// Stable code.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Inconsistent { .. } | Self::StatedJoint { .. } => "assembly/inconsistent",
            Self::Unreachable { .. } => "assembly/unreachable",
            Self::Contradiction { .. } => "assembly/contradiction",
            Self::SingularMass { .. } => "assembly/singular-mass",
            Self::CoincidentEnds { .. } | Self::CoincidentSeries { .. } => {
                "assembly/coincident-ends"
            }
            Self::OppositeAxes { .. } => "assembly/opposite-axes",
            Self::Evaluation(failure) => failure.code,
        }
    }

    /// The item concerned, if one is.
    pub fn item(&self) -> Option<&str> {
        match self {
            Self::Inconsistent { item, .. }
            | Self::StatedJoint { item, .. }
            | Self::Unreachable { item, .. }
            | Self::Contradiction { item, .. }
            | Self::CoincidentEnds { item, .. }
            | Self::CoincidentSeries { item }
            | Self::OppositeAxes { item }
            | Self::SingularMass { body: item, .. } => Some(item),
            Self::Evaluation(_) => None,
        }
    }

    /// Path of the stated value concerned, if one is.
    pub fn path(&self) -> Option<String> {
        match self {
            Self::StatedJoint { item, field, .. } => Some(format!("initial.joints.{item}.{field}")),
            _ => None,
        }
    }

    /// What to try.
    pub fn help(&self) -> &'static str {
        match self {
            Self::Inconsistent { .. } | Self::StatedJoint { .. } => {
                "state fewer values, or set `initial.assembly = \"adjust\"` to treat them as guesses"
            }
            Self::Unreachable { axes, .. } => match axes {
                FrameAxes::None => {
                    "check lengths, points and axes of what is named, and drivers that prescribe the same motion; or \
                     start nearer to an assembled configuration, and beside a dead point"
                }
                FrameAxes::Planar => {
                    "check lengths, points and axes of what is named, and drivers that prescribe the same motion; or \
                     start nearer to an assembled configuration, and beside a dead point. f and g are axes on the joint's first body, f its own \
                     axis"
                }
                FrameAxes::Spatial => {
                    "check lengths, points and axes of what is named, and drivers that prescribe the same motion; or \
                     start nearer to an assembled configuration, and beside a dead point. f, g and h are axes of the joint's frame on its first \
                     body, h its own axis"
                }
            },
            Self::Contradiction { level: "position", .. } => {
                "these joints or drivers prescribe the same motion differently; remove or change one of them"
            }
            Self::Contradiction { .. } => {
                "these joints or drivers prescribe the same motion differently: remove or change one of them; or the \
                 mechanism is stretched or flat there (a dead point): start it beside that"
            }
            Self::SingularMass { .. } => {
                "give the body a mass and an inertia about every axis, or hold it by a joint"
            }
            Self::CoincidentEnds { .. } => {
                "move one of its points, or start where they are apart; only a spring of free length zero may begin there"
            }
            Self::CoincidentSeries { .. } => {
                "move one of its points, or start where they are apart"
            }
            Self::OppositeAxes { .. } => ASIDE,
            Self::Evaluation(_) => "check the model near its initial state",
        }
    }
}

/// How far the stated values of a body or of a joint were moved.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Adjustment {
    /// Body or joint.
    pub item: String,
    /// m.
    pub translation: f64,
    /// rad (Euler parameters: 2|δp|).
    pub rotation: f64,
    /// m/s.
    pub velocity: f64,
    /// rad/s.
    pub angular_velocity: f64,
}

/// A consistent start.
#[derive(Debug, Clone)]
pub struct Assembled {
    /// The state with accelerations and multipliers.
    pub state: State,
    /// In the initial parametrization, at rest: what a run has of its own is not kept beside it.
    manifold: Manifold,
    /// Stated values that were moved by more than round-off.
    pub adjustments: Vec<Adjustment>,
    /// Residuals of the stated values before projection, position and velocity level.
    pub stated_residuals: (f64, f64),
}

impl Assembled {
    /// Factors at the state, in the initial parametrization, to go on with.
    pub fn manifold(&self) -> Manifold {
        self.manifold.awake()
    }

    /// The manifold without its numbers.
    pub(crate) fn resting(&self) -> &Manifold {
        &self.manifold
    }

    /// The initial parametrization.
    pub fn parametrization(&self) -> &Parametrization {
        self.manifold.chart().parametrization()
    }

    /// Where accelerations come from.
    pub fn accelerator(&self) -> &Accelerator {
        self.manifold.accelerator()
    }
}

/// Finds a consistent start of a model. `template`: the manifold of a model that differs in numbers
/// only, whose symbolic work serves again.
///
/// # Errors
/// [`AssemblyError`], naming the joint, driver or body.
pub fn assemble(
    system: &Arc<dyn System>,
    model: &Model,
    template: Option<&Manifold>,
) -> Result<Assembled, AssemblyError> {
    let sizes = system.structure().sizes;
    let mut state = State::zeros(&sizes);
    state.t = model.simulation.start_time.unwrap_or(0.0);
    let none = InitialBody::default();
    let stated = |b: usize| model.initial.bodies.get(b).unwrap_or(&none);
    for (b, body) in model.bodies.iter().enumerate() {
        system.set_body(b, &stated_pose(body, &none), &mut state.q, &mut state.v);
    }
    let design = state.q.clone();
    for (b, body) in model.bodies.iter().enumerate() {
        system.set_body(b, &stated_pose(body, stated(b)), &mut state.q, &mut state.v);
    }
    let wanted = state.clone();
    place(system.as_ref(), model, &design, &mut state);
    let (mut state, worst) = closed(system, model, Level::Position, &state)?;

    turn(system.as_ref(), model, &design, &mut state);

    // The Euler-parameter rates follow the projected parameters.
    let mut q = state.q.clone();
    for (b, body) in model.bodies.iter().enumerate() {
        let mut pose = system.body(b, &state.q, &state.v);
        let target = stated_pose(body, stated(b));
        pose.velocity = target.velocity;
        pose.angular_velocity = target.angular_velocity;
        system.set_body(b, &pose, &mut q, &mut state.v);
    }
    let before = state.v.clone();
    carry(system.as_ref(), model, &mut state);
    // A driver whose twist has no value would seem to contradict the joints.
    if let Some(item) = opposite_axes(system.as_ref(), model, &state, SAME_LINE) {
        return Err(AssemblyError::OppositeAxes { item: item.to_owned() });
    }
    let (mut state, worst_velocity) = closed(system, model, Level::Velocity, &state)?;

    state.z = model.initial_extra_states();
    wind(system.as_ref(), model, &mut state);
    system.update_windings(state.t, &state.q, &mut state.winding);
    refuse_coincident_ends(system.as_ref(), model, &state)?;
    let (mut manifold, state) = start(system, state, template)?;
    manifold.rest(&state.q);
    let mut adjustments = adjustments(model, system.as_ref(), &wanted, &before, &state);
    adjustments.extend(moved(model, &state));
    Ok(Assembled { state, manifold, adjustments, stated_residuals: (worst, worst_velocity) })
}

/// Prepares factors, accelerations and multipliers at a state that satisfies the joints; `template`
/// as for [`assemble`].
///
/// # Errors
/// [`AssemblyError`] when redundant rows contradict the others or a mass is missing.
pub fn start(
    system: &Arc<dyn System>,
    mut state: State,
    template: Option<&Manifold>,
) -> Result<(Manifold, State), AssemblyError> {
    let mut g = system.structure().constraint_pattern.zeros();
    system.constraint_jacobian(&state.q, &mut g);
    let (nonzero_g, nonzero_m) = match template {
        Some(m) => (m.chart().nonzero().clone(), None),
        None => {
            let (g, m) = structural_nonzeros(system.as_ref(), &state.q);
            (g, Some(m))
        }
    };
    let parametrization = choose_tree(system.as_ref(), &state, &g, None, RANK_TOLERANCE, true)?;
    let known = match template {
        Some(m) => m.chart().with_values(system.as_ref(), &parametrization, &state.q, &g)?,
        None => None,
    };
    let (chart, accelerator) = if let (Some(chart), Some(m)) = (known, template) {
        (chart, m.accelerator().with_values(system.as_ref()))
    } else {
        let nonzero_m =
            nonzero_m.unwrap_or_else(|| structural_nonzeros(system.as_ref(), &state.q).1);
        let kept = parametrization.kept.clone();
        (
            Chart::new(system.as_ref(), parametrization, &state.q, &g, &nonzero_g)?,
            Accelerator::new(Saddle::new(system.as_ref(), &state.q, &kept, &nonzero_g, &nonzero_m)),
        )
    };
    let mut manifold = Manifold::new(system.clone(), chart, accelerator, g);
    check_mass(system.as_ref(), &mut manifold, &state.q)?;
    // Round-off of the state is removed in the parametrization of the run.
    let parametrization = manifold.chart().parametrization().clone();
    let mut p = vec![0.0; parametrization.ndof];
    let mut rates = p.clone();
    manifold.independent_state(&state, &mut p, &mut rates);
    manifold.recover_position(state.t, &p, &mut state.q)?;
    manifold.recover_velocity(state.t, &state.q, &rates, &mut state.v, true)?;
    let mut z_rate = vec![0.0; state.z.len()];
    manifold.accelerate(&mut state, &mut z_rate)?;
    manifold.multipliers(&mut state);
    check_dropped(system.as_ref(), &mut manifold, &state, &parametrization)?;
    Ok((manifold, state))
}

/// A manifold in a given parametrization, factored at a consistent configuration.
///
/// # Errors
/// `simulation/singular-configuration`.
pub fn manifold_of(
    system: &Arc<dyn System>,
    parametrization: &Parametrization,
    q: &[f64],
) -> Result<Manifold, EvaluationFailure> {
    let mut g = system.structure().constraint_pattern.zeros();
    system.constraint_jacobian(q, &mut g);
    let (nonzero_g, nonzero_m) = structural_nonzeros(system.as_ref(), q);
    let chart = Chart::new(system.as_ref(), parametrization.clone(), q, &g, &nonzero_g)?;
    let kept = &parametrization.kept;
    let saddle = Saddle::new(system.as_ref(), q, kept, &nonzero_g, &nonzero_m);
    Ok(Manifold::new(system.clone(), chart, Accelerator::new(saddle), g))
}

/// Redundant rows must agree with the kept ones at all three levels.
fn check_dropped(
    system: &dyn System,
    manifold: &mut Manifold,
    state: &State,
    parametrization: &Parametrization,
) -> Result<(), AssemblyError> {
    let rows = system.structure().sizes.rows;
    let size = |x: &[f64]| x.iter().fold(1.0f64, |m, v| m.max(v.abs()));
    let g = manifold.jacobian();
    let mut residuals = [vec![0.0; rows], vec![0.0; rows], vec![0.0; rows]];
    system.position_constraints(state.t, &state.q, &mut residuals[0]);
    system.velocity_rhs(state.t, &mut residuals[1]);
    system.acceleration_rhs(state.t, &state.q, &state.v, &mut residuals[2]);
    for (level, x) in [(1, &state.v), (2, &state.a)] {
        residuals[level].iter_mut().for_each(|r| *r = -*r);
        g.multiply_add(1.0, x, &mut residuals[level]);
    }
    let allowed = [PROJECTED, PROJECTED * size(&state.v), PROJECTED * size(&state.a)];
    for (k, level) in ["position", "velocity", "acceleration"].into_iter().enumerate() {
        for &row in &parametrization.dropped {
            if residuals[k][row].abs() > allowed[k] {
                let left = contradiction(system, &state.q, g, &residuals[k]);
                return Err(AssemblyError::Contradiction {
                    level,
                    row: system.row_name(row),
                    item: system.row_item(row).0.to_owned(),
                    residual: residuals[k][row],
                    unit: unit_of_row(system, row, k),
                    others: Conflict::of(system, &left, row),
                });
            }
        }
    }
    Ok(())
}

/// A coordinate in words: one of four Euler parameters says little.
fn direction(system: &dyn System, coordinate: usize) -> String {
    let sizes = system.structure().sizes;
    if !sizes.is_planar() && sizes.place_of(coordinate).1 >= sizes.translations {
        format!("a rotation of `{}`", system.coordinate_item(coordinate))
    } else {
        format!("`{}`", system.coordinate_name(coordinate))
    }
}

/// Unit of what a row leaves at a level, positions being 0.
pub(crate) fn unit_of_row(system: &dyn System, row: usize, level: usize) -> &'static str {
    match system.structure().row_measure[row] {
        Measure::Length => ["m", "m/s", "m/s²"][level],
        Measure::Angle => ["rad", "rad/s", "rad/s²"][level],
    }
}

/// A spring pushes along the line of its points.
fn refuse_coincident_ends(
    system: &dyn System,
    model: &Model,
    state: &State,
) -> Result<(), AssemblyError> {
    match coincident_ends(system, model, state, 0.0) {
        None => Ok(()),
        Some((item, Some(force))) => {
            Err(AssemblyError::CoincidentEnds { item: item.to_owned(), force })
        }
        Some((item, None)) => Err(AssemblyError::CoincidentSeries { item: item.to_owned() }),
    }
}

/// M̂ must be positive definite.
fn check_mass(
    system: &dyn System,
    manifold: &mut Manifold,
    q: &[f64],
) -> Result<(), AssemblyError> {
    let structure = system.structure();
    let (n, ndof) = (structure.sizes.coordinates, manifold.chart().ndof());
    if ndof == 0 {
        return Ok(());
    }
    if manifold.accelerator().way() != Accelerations::NullSpace {
        // M is positive semidefinite, so M̂ is positive definite where accelerations are determined. That of a template
        // is another one.
        manifold.evaluate_mass(q);
        let (force, mut rate) = (vec![0.0; n], vec![0.0; ndof]);
        return manifold.respond(q, &force, &mut rate).map_err(|failure| {
            match failure.coordinate {
                Some(coordinate) => AssemblyError::SingularMass {
                    body: system.coordinate_item(coordinate).to_owned(),
                    coordinate: direction(system, coordinate),
                },
                None => AssemblyError::Evaluation(failure),
            }
        });
    }
    let mut mass = structure.mass_pattern.zeros();
    system.mass_matrix(q, &mut mass);
    let mut d = vec![0.0; n * ndof];
    manifold.chart_mut().null_space(&mut d);
    let mut md = vec![0.0; n * ndof];
    mass.multiply_many_add(1.0, &d, ndof, &mut md);
    let mut reduced = vec![0.0; ndof * ndof];
    holonom_linalg::gram_add(n, ndof, &d, &md, &mut reduced);
    // Scaled by what each column of D would weigh if all of the model's mass followed it.
    let total = largest_diagonal(&mass, system);
    let weight: Vec<f64> = (0..ndof)
        .map(|k| {
            let square = (0..n).map(|i| (scale(system, i) * d[i * ndof + k]).powi(2)).sum::<f64>();
            (total * square).sqrt().max(f64::MIN_POSITIVE)
        })
        .collect();
    for i in 0..ndof {
        for j in 0..ndof {
            reduced[i * ndof + j] /= weight[i] * weight[j];
        }
    }
    let tiny = 1e-15;
    let singular = |k: usize| {
        let coordinate = manifold.chart().parametrization().coordinate(system, k);
        let body = system.coordinate_item(coordinate).to_owned();
        let name = manifold.chart().parametrization().name(system, k);
        AssemblyError::SingularMass { body, coordinate: format!("`{name}`") }
    };
    if let Some(k) = (0..ndof).find(|&k| reduced[k * ndof + k] <= tiny) {
        return Err(singular(k));
    }
    let mut cholesky = Cholesky::new(ndof);
    match cholesky.factor(&reduced) {
        Err(e) => Err(singular(e.index)),
        Ok(()) => Ok(()),
    }
}

fn largest_diagonal(mass: &BlockMatrix, system: &dyn System) -> f64 {
    let entries = mass.entries(0, 0).into_iter().zip(mass.values());
    entries
        .filter(|((i, j), _)| i == j)
        .fold(0.0, |m: f64, ((i, _), x)| m.max(x / scale(system, i).powi(2)))
}

/// Stated pose and rates of a body, design values where nothing is stated.
fn stated_pose(body: &Body, stated: &InitialBody) -> BodyPose {
    let orientation = match stated.orientation.unwrap_or(body.orientation) {
        Orientation::Angle(angle) => [angle, 0.0, 0.0, 0.0],
        Orientation::EulerParameters(p) => p,
    };
    BodyPose {
        position: stated.position.unwrap_or(body.position),
        orientation,
        velocity: stated.velocity.unwrap_or_default(),
        angular_velocity: stated.angular_velocity.unwrap_or_default(),
    }
}

/// How far stated values moved, for bodies where that is more than round-off.
fn adjustments(
    model: &Model,
    system: &dyn System,
    wanted: &State,
    wanted_velocity: &[f64],
    state: &State,
) -> Vec<Adjustment> {
    let sizes = system.structure().sizes;
    let angle = sizes.angle_factor();
    let distance =
        |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum::<f64>().sqrt();
    let mut out = Vec::new();
    for (b, stated) in model.initial.bodies.iter().enumerate() {
        let (r, p) = (sizes.translations_of(b), sizes.rotations_of(b));
        let moved = |is_stated: bool, x: f64| if is_stated { x } else { 0.0 };
        let adjustment = Adjustment {
            item: model.bodies[b].name.clone(),
            translation: moved(
                stated.position.is_some(),
                distance(&state.q[r.clone()], &wanted.q[r.clone()]),
            ),
            rotation: moved(
                stated.orientation.is_some(),
                angle * distance(&state.q[p.clone()], &wanted.q[p.clone()]),
            ),
            velocity: moved(
                stated.velocity.is_some(),
                distance(&state.v[r.clone()], &wanted_velocity[r]),
            ),
            angular_velocity: moved(
                stated.angular_velocity.is_some(),
                angle * distance(&state.v[p.clone()], &wanted_velocity[p]),
            ),
        };
        let largest = adjustment
            .translation
            .max(adjustment.rotation)
            .max(adjustment.velocity)
            .max(adjustment.angular_velocity);
        if largest > MOVED {
            out.push(adjustment);
        }
    }
    out
}
