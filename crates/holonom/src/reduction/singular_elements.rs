//! Where force elements and drivers have no value: springs whose ends have met, twists whose axes are opposite.

use crate::math::spatial::rotate;
use crate::math::vector::{dot, sum};
use crate::model::{Dimension, DriverKind, ElasticLaw, ForceKind, Frame, Model};
use crate::system::{Sample, State, System};

/// Points nearer than this part of the size of a model are one.
const COINCIDENT: f64 = 1e-8;
/// Points nearer than this part of their distance from the origin are apart by round-off alone.
const ROUND_OFF: f64 = 16.0 * f64::EPSILON;
/// What to try where the axes of a twist are opposite.
pub(crate) const ASIDE: &str = "a twist has a value only while its axes are less than half a turn apart: hold them together by a \
    revolute, cylindrical or universal joint, or keep the bodies from swinging so far";

/// The first spring whose ends are nearer to each other than `near`, m, or than round-off, and whose force acts there, where
/// it has no direction; with its elastic force, N, if that depends on the length alone.
pub(crate) fn coincident_ends<'a>(
    system: &dyn System,
    model: &'a Model,
    state: &State,
    near: f64,
) -> Option<(&'a str, Option<f64>)> {
    let sample = Sample::new(state);
    let norm = |a: &[f64; 3]| dot(a, a).sqrt();
    model.forces.iter().find_map(|force| {
        let (elastic, frames) = match &force.kind {
            ForceKind::Tsda { law, free_length, frames, .. } => {
                let elastic = match law {
                    ElasticLaw::Linear(stiffness) => -stiffness * free_length,
                    ElasticLaw::Table(table) => table.value_and_slope(-free_length).0,
                };
                (Some(elastic), frames)
            }
            ForceKind::Maxwell { frames, .. } => (None, frames),
            _ => return None,
        };
        let name = format!("{}.length", force.name);
        let channel = system.channel_named(&name).filter(|_| elastic != Some(0.0))?;
        let mut length = [0.0];
        system.channel(&channel, &sample, &mut length);
        let far = frames.iter().map(|frame| {
            let origin = frame.body.map(|b| system.body(b, &state.q, &state.v).position);
            norm(&origin.unwrap_or_default()) + norm(&frame.point)
        });
        let round_off = ROUND_OFF * far.fold(0.0, f64::max);
        let least = round_off.max(COINCIDENT * system.characteristic_length());
        (length[0] <= least.max(near)).then_some((force.name.as_str(), elastic))
    })
}

/// The first rotational spring or rotation driver between bodies in space whose axes are nearer to opposite than `near`, rad.
pub(crate) fn opposite_axes<'a>(
    system: &dyn System,
    model: &'a Model,
    state: &State,
    near: f64,
) -> Option<&'a str> {
    if model.dimension == Dimension::Planar {
        return None;
    }
    let axis = |frame: &Frame| {
        let own = frame.axes.map(|row| row[2]);
        frame.body.map_or(own, |b| rotate(&system.body(b, &state.q, &state.v).orientation, &own))
    };
    let springs = model.forces.iter().filter_map(|force| match &force.kind {
        ForceKind::Rsda { frames, .. } => Some((&force.name, frames)),
        _ => None,
    });
    let turning = model.drivers.iter().filter(|driver| driver.kind == DriverKind::Rotation);
    let mut twists = springs.chain(turning.map(|driver| (&driver.name, &driver.frames)));
    let found = twists.find(|(_, frames)| {
        let [first, second] = [axis(&frames[0]), axis(&frames[1])];
        let apart = sum(&first, &second);
        dot(&apart, &apart).sqrt() < near
    });
    found.map(|(name, _)| name.as_str())
}
