//! A model compiled and assembled, ready to run.

use crate::model::Model;
use crate::reduction::assembly::{Assembled, AssemblyError, assemble};
use crate::system::{Channel, System, compile};
use std::sync::Arc;

/// A model with its system.
#[derive(Debug, Clone)]
pub struct Problem {
    model: Arc<Model>,
    system: Arc<dyn System>,
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
    /// Extra states.
    pub extra_states: usize,
    /// Redundant rows: item and direction.
    pub redundant: Vec<(String, String)>,
    /// Characteristic length, m.
    pub characteristic_length: f64,
    /// Smallest accepted pivot over the first: below 1e-5 the configuration is nearly singular.
    pub pivot_ratio: f64,
    /// Names of the independent coordinates.
    pub independent: Vec<String>,
}

impl Problem {
    /// Compiles a model.
    pub fn new(model: Model) -> Self {
        let system = compile(&model);
        Self { model: Arc::new(model), system }
    }

    /// The same structure with other numbers; patterns are shared when the structure allows.
    pub fn with_model(&self, model: Model) -> Self {
        let system = self.system.with_values(&model).unwrap_or_else(|| compile(&model));
        Self { model: Arc::new(model), system }
    }

    /// The same problem with another start time, s.
    pub fn starting_at(&self, t: f64) -> Self {
        let mut model = self.model.as_ref().clone();
        model.simulation.start_time = Some(t);
        Self { model: Arc::new(model), system: self.system.clone() }
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
    pub fn assemble(&self) -> Result<Assembled, AssemblyError> {
        assemble(&self.system, &self.model)
    }

    /// Channels that can be asked for.
    pub fn channels(&self) -> &[Channel] {
        self.system.channels()
    }

    /// Counts of an assembled model.
    pub fn summary(&self, assembled: &Assembled) -> ModelSummary {
        let sizes = self.system.structure().sizes;
        let parametrization = assembled.manifold.chart().parametrization();
        let redundant = parametrization
            .dropped
            .iter()
            .map(|&row| {
                let (item, direction) = self.system.row_item(row);
                (item.to_owned(), direction.to_owned())
            })
            .collect();
        let independent = match &parametrization.projection {
            crate::reduction::Projection::Selection(independent) => {
                independent.iter().map(|&i| self.system.coordinate_name(i)).collect()
            }
            crate::reduction::Projection::Basis(_) => Vec::new(),
        };
        ModelSummary {
            bodies: sizes.bodies,
            coordinates: sizes.coordinates,
            rows: sizes.rows,
            joint_rows: sizes.joint_rows,
            ndof: parametrization.ndof,
            extra_states: sizes.extra_states,
            redundant,
            characteristic_length: self.system.characteristic_length(),
            pivot_ratio: parametrization.pivot_ratio,
            independent,
        }
    }
}
