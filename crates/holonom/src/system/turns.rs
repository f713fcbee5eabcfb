//! Angles in space that count turns: a pose tells them up to whole turns only.

use crate::math::TimeFunction;
use crate::model::{Driver, DriverKind, Frame, Model};

/// The angle of a joint or rotational spring in space, followed over any number of turns.
#[derive(Debug, Clone)]
pub(super) struct Turns {
    /// Its winding in the state.
    pub(super) index: usize,
    guide: Option<Guide>,
}

/// What tells the same angle, turns included: θ = sign · guide + offset.
#[derive(Debug, Clone)]
struct Guide {
    by: GuidedBy,
    sign: f64,
    offset: f64,
}

#[derive(Debug, Clone)]
enum GuidedBy {
    /// The motion of a driver.
    Driver(TimeFunction),
    /// The winding of a joint.
    Joint(usize),
}

impl Turns {
    /// The angle of two frames about h of the first.
    pub(super) fn new(index: usize, frames: &[Frame; 2], model: &Model) -> Self {
        let guide = driver_of_angle(model, frames).map(|(driver, sign, offset)| Guide {
            by: GuidedBy::Driver(driver.motion.clone()),
            sign,
            offset,
        });
        Self { index, guide }
    }

    /// Lets the angle, whose frames these are, follow the winding of a joint about the same axis; returns
    /// whether something tells its turns now.
    pub(super) fn follow(
        &mut self,
        model: &Model,
        frames: &[Frame; 2],
        joint: &[Frame; 2],
        winding: usize,
    ) -> bool {
        if self.guide.is_none()
            && let Some((sign, offset)) = same_angle(model, joint, frames)
        {
            self.guide = Some(Guide { by: GuidedBy::Joint(winding), sign, offset });
        }
        self.guide.is_some()
    }

    /// Whether a driver tells its turns.
    pub(super) fn is_driven(&self) -> bool {
        matches!(self.guide, Some(Guide { by: GuidedBy::Driver(_), .. }))
    }

    /// A value near the angle at time t (s), rad: what its driver says, or the last winding.
    pub(super) fn near(&self, t: f64, winding: &[f64]) -> f64 {
        match &self.guide {
            Some(Guide { by: GuidedBy::Driver(motion), sign, offset }) => {
                sign * motion.derivatives(t)[0] + offset
            }
            Some(Guide { by: GuidedBy::Joint(joint), sign, offset }) => {
                sign * winding[*joint] + offset
            }
            None => winding[self.index],
        }
    }
}

/// The driver that tells the angle of `frames`, turns included: θ = sign · motion + constant.
pub(crate) fn driver_of_angle<'a>(
    model: &'a Model,
    frames: &[Frame; 2],
) -> Option<(&'a Driver, f64, f64)> {
    let rotations = model.drivers.iter().filter(|d| d.kind == DriverKind::Rotation);
    rotations.into_iter().find_map(|driver| {
        let (sign, offset) = same_angle(model, &driver.frames, frames)?;
        Some((driver, sign, offset))
    })
}

/// How an axis of frames lies to that of other frames between the same bodies.
#[derive(Debug, Clone, Copy)]
pub(super) struct Along {
    /// −1 where first and second body change places.
    pub(super) order: f64,
    /// Cosine between the axes: ±1.
    pub(super) cosine: f64,
}

/// Where axis `k` of both pairs of frames is parallel in the design configuration, and they are between
/// the same bodies.
pub(super) fn along(model: &Model, a: &[Frame; 2], b: &[Frame; 2], k: usize) -> Option<Along> {
    let order = match (a.map(|f| f.body), b.map(|f| f.body)) {
        ([a, b], [c, d]) if (a, b) == (c, d) => 1.0,
        ([a, b], [c, d]) if (a, b) == (d, c) => -1.0,
        _ => return None,
    };
    let cosine = dot(model.design_axis(&a[0], k), model.design_axis(&b[0], k));
    (cosine.abs() > 1.0 - 1e-9).then_some(Along { order, cosine })
}

/// Sign and constant where the angle of `frames` is that of `leading` up to them.
fn same_angle(model: &Model, leading: &[Frame; 2], frames: &[Frame; 2]) -> Option<(f64, f64)> {
    let Along { order, cosine } = along(model, leading, frames, 2)?;
    let sign = order * cosine.signum();
    Some((sign, design_angle(model, frames) - sign * design_angle(model, leading)))
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
