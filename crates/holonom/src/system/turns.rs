//! Angles in space that count turns: a pose tells them up to whole turns only.

use crate::math::TimeFunction;
use crate::model::{DriverKind, Frame, Model};

/// The angle of a joint or rotational spring in space, followed over any number of turns.
#[derive(Debug, Clone)]
pub(super) struct Turns {
    /// Its winding in the state.
    pub(super) index: usize,
    guide: Option<Guide>,
}

/// A driver of the same angle: θ = sign · s(t) + offset, turns included.
#[derive(Debug, Clone)]
struct Guide {
    motion: TimeFunction,
    sign: f64,
    offset: f64,
}

impl Turns {
    /// The angle of two frames about h of the first.
    pub(super) fn new(index: usize, frames: &[Frame; 2], model: &Model) -> Self {
        let rotations = model.drivers.iter().filter(|d| d.kind == DriverKind::Rotation);
        let guide = rotations.into_iter().find_map(|driver| {
            let sign = same_angle(model, &driver.frames, frames)?;
            let offset = design_angle(model, frames) - sign * design_angle(model, &driver.frames);
            Some(Guide { motion: driver.motion.clone(), sign, offset })
        });
        Self { index, guide }
    }

    /// A value near the angle at time t (s), rad: what its driver says, or the last winding.
    pub(super) fn near(&self, t: f64, winding: &[f64]) -> f64 {
        match &self.guide {
            Some(guide) => guide.sign * guide.motion.derivatives(t)[0] + guide.offset,
            None => winding[self.index],
        }
    }
}

/// ±1 where both angles are between the same bodies about the same axis, up to a constant.
fn same_angle(model: &Model, driven: &[Frame; 2], frames: &[Frame; 2]) -> Option<f64> {
    let order = match (driven.map(|f| f.body), frames.map(|f| f.body)) {
        ([a, b], [c, d]) if (a, b) == (c, d) => 1.0,
        ([a, b], [c, d]) if (a, b) == (d, c) => -1.0,
        _ => return None,
    };
    let cosine = dot(model.design_axis(&driven[0], 2), model.design_axis(&frames[0], 2));
    (cosine.abs() > 1.0 - 1e-9).then(|| order * cosine.signum())
}

/// The angle in the design configuration, principal value, rad.
fn design_angle(model: &Model, frames: &[Frame; 2]) -> f64 {
    let turned = model.design_axis(&frames[1], 0);
    dot(model.design_axis(&frames[0], 1), turned)
        .atan2(dot(model.design_axis(&frames[0], 0), turned))
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}
