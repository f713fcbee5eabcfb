//! Initial state, outputs and defaults of a run.

use indexmap::IndexSet;

use super::Context;
use crate::error::Code;
use crate::io::names::suggest;
use crate::io::schema::{self, Rotational, Tolerance as Stated, Vector};
use crate::model::{
    self, Assembly, Initial, InitialBody, Orientation, Outputs, SimulationDefaults, Tolerance,
};

impl Context<'_> {
    pub(super) fn initial(&mut self) -> Initial {
        let stated = &self.file.initial;
        for name in stated.bodies.keys() {
            self.moving_body(&format!("initial.bodies.{name}"), name);
        }
        let mut bodies = Vec::with_capacity(self.file.bodies.len());
        for name in self.file.bodies.keys() {
            let body = stated.bodies.get(name);
            let velocity = body.and_then(|b| b.velocity).or(stated.velocity);
            let turning = body.and_then(|b| b.angular_velocity).or(stated.angular_velocity);
            bodies.push(InitialBody {
                position: body.and_then(|b| b.position).map(Vector::components),
                orientation: body.and_then(|b| self.initial_orientation(name, b)),
                velocity: velocity.map(Vector::components),
                angular_velocity: turning.map(Rotational::components),
            });
        }
        Initial {
            assembly: match stated.assembly {
                schema::Assembly::Keep => Assembly::Keep,
                schema::Assembly::Adjust => Assembly::Adjust,
            },
            bodies,
            extra_states: self.extra_states(),
        }
    }

    fn initial_orientation(&mut self, name: &str, b: &schema::InitialBody) -> Option<Orientation> {
        let stated = b
            .euler_parameters
            .map(|p| self.euler_parameters(format!("initial.bodies.{name}.euler_parameters"), p));
        stated.or(b.angle.map(Orientation::Angle))
    }

    fn extra_states(&mut self) -> Vec<(String, f64)> {
        let file = self.file;
        let mut out = Vec::new();
        for (name, &value) in &file.initial.extra_states {
            let path = format!("initial.extra_states.{name}");
            match file.forces.get(name) {
                Some(schema::Force::Maxwell(_)) => out.push((name.clone(), value)),
                Some(_) => {
                    let message = format!("the force `{name}` in `{path}` has no extra state");
                    let help = "extra states belong to forces of type \"maxwell\"";
                    self.refuse(Code::UnknownName, path, message, help);
                }
                None => {
                    let message = format!("`{path}` names the force `{name}`, which is not there");
                    let help = suggest(
                        &self.errors,
                        name,
                        "forces",
                        file.forces.keys().map(String::as_str),
                    );
                    self.refuse(Code::UnknownName, path, message, &help);
                }
            }
        }
        out
    }

    /// Channels are `item.quantity`; that the item exists is checked here, the quantity by the run.
    pub(super) fn outputs(&mut self) -> Outputs {
        let file = self.file;
        let known: IndexSet<&str> = ["energy", "constraint", "*"]
            .into_iter()
            .chain(file.bodies.keys().map(String::as_str))
            .chain(file.joints.keys().map(String::as_str))
            .chain(file.forces.keys().map(String::as_str))
            .chain(file.drivers.keys().map(String::as_str))
            .collect();
        for (i, channel) in file.outputs.channels.iter().enumerate() {
            let path = format!("outputs.channels[{i}]");
            let Some((item, quantity)) = channel.split_once('.') else {
                let message = format!("`{path}` is {channel:?}; expected \"item.quantity\"");
                let help = "such as \"chassis.position\" or \"energy.total\"";
                self.refuse(Code::WrongType, path, message, help);
                continue;
            };
            if !known.contains(item) {
                let message = format!("`{path}` names the item `{item}`, which is not there");
                let help = suggest(&self.errors, item, "items", known.iter().copied());
                self.refuse(Code::UnknownName, path, message, &help);
            } else if quantity.is_empty() {
                let message = format!("`{path}` is {channel:?}; expected \"item.quantity\"");
                self.refuse(Code::WrongType, path, message, "`item.*` stands for all quantities");
            }
        }
        Outputs { channels: file.outputs.channels.clone(), interval: file.outputs.interval }
    }

    pub(super) fn simulation(&self) -> SimulationDefaults {
        let stated = &self.file.simulation;
        SimulationDefaults {
            start_time: stated.start_time,
            end_time: stated.end_time,
            tolerance: stated.tolerance.map(|tolerance| match tolerance {
                Stated::Uniform(value) => Tolerance::uniform(value),
                Stated::Parts(schema::ToleranceParts { relative, translation, rotation }) => {
                    model::Tolerance { relative, translation, rotation }
                }
            }),
            method: stated.method.clone(),
            formula: stated.formula.clone(),
            fixed_step: stated.fixed_step,
            max_step: stated.max_step,
            initial_step: stated.initial_step,
            max_steps: stated.max_steps,
            max_seconds: stated.max_seconds,
            repartition_factor: stated.repartition_factor,
            dense_output: stated.dense_output,
            parametrization: stated.parametrization.map(schema::Parametrization::name),
            jacobian: stated.jacobian.map(schema::JacobianSource::name),
            newton: stated.newton.map(schema::Newton::name),
            accelerations: stated.accelerations.map(schema::Accelerations::name),
            profile: stated.profile.map(schema::Profile::name),
        }
    }
}
