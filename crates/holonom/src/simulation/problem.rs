//! A model compiled and assembled, ready to run.

use super::checks::{RunError, check_state, why};
use crate::model::{Dimension, Model};
use crate::reduction::accelerations::AccelerationCosts;
use crate::reduction::assembly::{Assembled, AssemblyError, assemble, start};
use crate::reduction::{
    ChosenVelocity, Manifold, Parametrization, Relatives, Source, chosen_velocities,
};
use crate::system::{Channel, EdgeSource, RowKind, State, System, compile, compile_along};
use crate::topology::{Forest, Shape};
use crate::watch::stage;
use std::sync::{Arc, OnceLock};

/// A model with its system; assembled once, when first asked.
#[derive(Debug, Clone)]
pub struct Problem {
    model: Arc<Model>,
    system: Arc<dyn System>,
    assembled: Arc<OnceLock<Result<Assembled, AssemblyError>>>,
    chosen: Arc<OnceLock<Vec<ChosenVelocity>>>,
    /// The problem that this one differs from in numbers only: its symbolic work serves here too.
    base: Option<Arc<Problem>>,
}

/// What `check` reports about a model.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelSummary {
    /// Moving bodies.
    pub bodies: usize,
    /// Generalized coordinates.
    pub coordinates: usize,
    /// Constraint rows, Euler-parameter normalisations included.
    pub rows: usize,
    /// Rows of joints and drivers.
    pub joint_rows: usize,
    /// Degrees of freedom.
    pub ndof: usize,
    /// Independent loops of the graph of joints.
    pub loops: usize,
    /// Groups of bodies that no joint ties to the ground.
    pub floating: usize,
    /// Extra states.
    pub extra_states: usize,
    /// Redundant rows.
    pub redundant: Vec<RedundantRow>,
    /// Characteristic length, m.
    pub characteristic_length: f64,
    /// Smallest accepted pivot over the first: below 1e-5 the configuration is nearly singular.
    pub pivot_ratio: f64,
    /// Names of the independent coordinates.
    pub independent: Vec<String>,
    /// Edges of the spanning forest, parents before children.
    pub tree: Vec<EdgeSummary>,
    /// Where accelerations come from.
    pub accelerations: AccelerationSummary,
    /// In joint coordinates: coordinates along the tree, rows of cut joints and of drivers on the tree, entries of the factor
    /// of the composite inertia matrix. None where there is no joint form, or for large models.
    pub joint_coordinates: Option<[usize; 3]>,
}

/// Bodies up to which a summary tells the sizes of the joint form.
const SUMMARIZED_IN_JOINT_COORDINATES: usize = 300;

/// Where accelerations come from, and why.
#[derive(Debug, Clone, PartialEq)]
pub struct AccelerationSummary {
    /// Its name in options.
    pub way: &'static str,
    /// Whether the model states it; else it is the cheapest one.
    pub stated: bool,
    /// Predicted operations of one solve, in multiplications of a sparse elimination.
    pub costs: AccelerationCosts,
    /// Why there is no reduced matrix, or no way as stated.
    pub refusal: Option<String>,
}

/// An edge of the spanning forest: what places a body against its parent.
#[derive(Debug, Clone, PartialEq)]
pub struct EdgeSummary {
    /// The body.
    pub body: String,
    /// Its parent, `ground` for the ground.
    pub parent: String,
    /// `joint`, `force` or `free`.
    pub kind: &'static str,
    /// Name of the joint, the force, or the free body.
    pub item: String,
    /// Its relative coordinates.
    pub coordinates: Vec<EdgeCoordinate>,
}

/// A relative coordinate of an edge.
#[derive(Debug, Clone, PartialEq)]
pub struct EdgeCoordinate {
    /// `name.quantity`.
    pub name: String,
    /// `independent`, `driven`, or `dependent` where loops determine it.
    pub role: &'static str,
}

/// A constraint that others imply already.
#[derive(Debug, Clone, PartialEq)]
pub struct RedundantRow {
    /// Name of the joint or driver.
    pub item: String,
    /// Name of the row, `rotation about g`.
    pub row: String,
    /// What it prescribes, in words: the axis and where it points in the design configuration.
    pub direction: String,
}

impl Problem {
    /// Compiles a model.
    pub fn new(model: Model) -> Self {
        let system = compile(&model);
        Self {
            model: Arc::new(model),
            system,
            assembled: Arc::default(),
            chosen: Arc::default(),
            base: None,
        }
    }

    /// The problem of a model that may differ in numbers only: patterns and pivot orders are then
    /// shared, always those of the first problem, so that results do not depend on what ran before.
    pub fn with_model(&self, model: Model) -> Self {
        let same_forest = model.simulation.cut == self.model.simulation.cut;
        match self.system.with_values(&model).filter(|_| same_forest) {
            Some(system) => {
                let base = self.base.clone().unwrap_or_else(|| Arc::new(self.clone()));
                Self {
                    model: Arc::new(model),
                    system,
                    assembled: Arc::default(),
                    chosen: Arc::default(),
                    base: Some(base),
                }
            }
            None => Self::new(model),
        }
    }

    /// The same problem starting at t, s; where it does already, the assembled start is shared.
    pub fn starting_at(&self, t: f64) -> Self {
        if self.model.simulation.start_time.unwrap_or_default() == t {
            return self.clone();
        }
        let mut model = self.model.as_ref().clone();
        model.simulation.start_time = Some(t);
        Self {
            model: Arc::new(model),
            assembled: Arc::default(),
            chosen: Arc::default(),
            ..self.clone()
        }
    }

    /// The same problem along the forest of another that differs in numbers only; `None` if it differs in more.
    pub fn along(&self, forest: &Forest) -> Option<Self> {
        let own = &self.system.tree().forest;
        if own == forest {
            return Some(self.clone());
        }
        if (own.edge.len(), own.edges()) != (forest.edge.len(), forest.edges()) {
            return None;
        }
        let system = compile_along(&self.model, forest);
        Some(Self {
            model: self.model.clone(),
            system,
            assembled: Arc::default(),
            chosen: Arc::default(),
            base: None,
        })
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The system.
    pub fn system(&self) -> &Arc<dyn System> {
        &self.system
    }

    /// A consistent start.
    ///
    /// # Errors
    /// [`AssemblyError`] naming the joint or body.
    pub fn assemble(&self) -> Result<&Assembled, AssemblyError> {
        let compute = || {
            let template = self.base.as_ref().and_then(|base| base.manifold());
            stage("assembling", || assemble(&self.system, &self.model, template))
        };
        self.assembled.get_or_init(compute).as_ref().map_err(Clone::clone)
    }

    /// A run's beginning at a given state, whose round-off is projected away.
    ///
    /// # Errors
    /// [`RunError`] when it is not a state of this model or contradicts a joint or driver, naming
    /// the row and its residual; as [`Problem::assemble`].
    pub fn start_from(&self, state: &State) -> Result<(Manifold, State), RunError> {
        check_state(self.system.as_ref(), state)?;
        let template = self.base.as_deref().unwrap_or(self).manifold();
        Ok(start(&self.system, state.clone(), template)?)
    }

    /// Initial velocities that nothing determines and that are not zero.
    pub fn chosen_velocities(&self) -> &[ChosenVelocity] {
        let Ok(assembled) = self.assemble() else { return &[] };
        self.chosen.get_or_init(|| chosen_velocities(&self.system, &self.model, assembled))
    }

    fn manifold(&self) -> Option<&Manifold> {
        self.assemble().ok().map(Assembled::resting)
    }

    /// Channels that can be asked for.
    pub fn channels(&self) -> &[Channel] {
        self.system.channels()
    }

    /// A channel by name.
    pub fn channel(&self, name: &str) -> Option<Channel> {
        self.system.channel_named(name)
    }

    /// What a row of a joint or driver prescribes, in words.
    fn direction(&self, item: &str, row: RowKind) -> String {
        let Some((motion, axis)) = row.motion() else { return row.to_string() };
        let Some(k) = axis.of_frame() else { return format!("{motion} the ground's {axis} axis") };
        let joints = self.model.joints.iter().map(|j| (&j.name, &j.frames));
        let drivers = self.model.drivers.iter().map(|d| (&d.name, &d.frames));
        let frames =
            joints.chain(drivers).find(|(name, _)| *name == item).map(|(_, frames)| frames);
        let Some(frames) = frames else { return row.to_string() };
        // Three digits, without a minus before a zero.
        let round = |x: f64| (x * 1e3).round() / 1e3 + 0.0;
        let [x, y, z] = self.model.design_axis(&frames[0], k).map(round);
        let planar = self.model.dimension == Dimension::Planar;
        let points = if planar { format!("[{x}, {y}]") } else { format!("[{x}, {y}, {z}]") };
        format!("{motion} axis {axis} of its frame, {points} in the design configuration")
    }

    /// Edges of the forest with the part that each coordinate has.
    fn edges(&self, parametrization: &Parametrization) -> Vec<EdgeSummary> {
        let Some(relatives) = parametrization.relatives() else { return Vec::new() };
        let system = self.system.as_ref();
        let body = |b: usize| self.model.bodies[b].name.clone();
        let mut out = Vec::new();
        for (at, edge) in system.tree().edges.iter().enumerate() {
            let rows = edge.forms[relatives.forms[at]].clone().flat_map(|group| {
                (0..system.relative_groups()[group].rows).map(move |row| (group, row))
            });
            let coordinates = rows
                .zip(&relatives.sources[at])
                .map(|((group, row), source)| EdgeCoordinate {
                    name: Relatives::name_of(system, group, row),
                    role: match source {
                        Source::Independent(_) => "independent",
                        Source::Driven(..) => "driven",
                        Source::Dependent => "dependent",
                    },
                })
                .collect();
            out.push(EdgeSummary {
                body: body(edge.body),
                parent: edge.parent.map_or_else(|| "ground".to_owned(), body),
                kind: match edge.source {
                    EdgeSource::Joint(_) => "joint",
                    EdgeSource::Force(_) => "force",
                    EdgeSource::Free => "free",
                },
                item: edge.name.clone(),
                coordinates,
            });
        }
        out
    }

    /// Where accelerations come from when a run states no more than the model.
    fn accelerations(&self, mut manifold: Manifold) -> AccelerationSummary {
        let stated = self.model.simulation.accelerations.unwrap_or_default();
        let outcome = manifold.set_accelerations(stated);
        let accelerator = manifold.accelerator();
        let refusal = outcome.err().or(accelerator.costs().refusal);
        AccelerationSummary {
            way: accelerator.way().name(),
            stated: stated == accelerator.way(),
            costs: *accelerator.costs(),
            refusal: refusal.map(|refusal| why(self.system.as_ref(), refusal)),
        }
    }

    /// Counts of an assembled model.
    pub fn summary(&self, assembled: &Assembled) -> ModelSummary {
        let sizes = self.system.structure().sizes;
        let parametrization = assembled.parametrization();
        let redundant = parametrization
            .dropped
            .iter()
            .map(|&row| {
                let (item, row) = self.system.row_item(row);
                let direction = self.direction(item, row);
                RedundantRow { item: item.to_owned(), row: row.to_string(), direction }
            })
            .collect();
        let independent = (0..parametrization.ndof)
            .map(|k| parametrization.name(self.system.as_ref(), k))
            .collect();
        let accelerations = self.accelerations(assembled.manifold());
        let joint_coordinates = (sizes.bodies <= SUMMARIZED_IN_JOINT_COORDINATES)
            .then(|| {
                let mut manifold = assembled.manifold();
                manifold.use_joint_coordinates(&assembled.state.q, usize::MAX);
                manifold.joint_sizes()
            })
            .flatten();
        let ends: Vec<_> = self.model.joints.iter().map(|j| j.frames.map(|f| f.body)).collect();
        let shape = Shape::new(sizes.bodies, &ends);
        ModelSummary {
            loops: shape.loops,
            floating: shape.floating.len(),
            bodies: sizes.bodies,
            coordinates: sizes.coordinates,
            rows: sizes.rows,
            joint_rows: sizes.joint_rows,
            ndof: parametrization.ndof,
            extra_states: sizes.extra_states,
            redundant,
            characteristic_length: self.system.characteristic_length(),
            pivot_ratio: parametrization.pivot_ratio,
            tree: self.edges(parametrization),
            accelerations,
            joint_coordinates,
            independent,
        }
    }
}
