//! One file per force: its law, wrenches, derivative blocks, energy and channels.

pub(super) mod bushing;
pub(super) mod law;
pub(super) mod line;
pub(super) mod maxwell;
pub(super) mod point_force;
mod road;
pub(super) mod rsda;
pub(super) mod torque;
pub(super) mod tsda;
pub(super) mod tyre;

use super::{Energy, ForceElement, ForceInput, Quantity, product};
use crate::model;

/// First and second body of a force. For a force on one body the second is acted on and the first
/// carries the reaction; it is the ground where there is none.
pub(super) fn bodies(force: &model::Force) -> [model::BodyIndex; 2] {
    match &force.kind {
        model::ForceKind::Tsda { frames, .. }
        | model::ForceKind::Rsda { frames, .. }
        | model::ForceKind::Maxwell { frames, .. }
        | model::ForceKind::Bushing { frames, .. } => [frames[0].body, frames[1].body],
        model::ForceKind::Tyre(tyre) => [None, tyre.frame.body],
        model::ForceKind::PointForce { frame, .. } => [None, frame.body],
        model::ForceKind::Torque { body, reaction, .. } => [*reaction, *body],
    }
}

/// Height of a road at x under a wheel of the given unloaded radius, m.
pub fn road_height(road: &model::Road, wheel_radius: f64, x: f64) -> f64 {
    road::height(road, wheel_radius, x)[0]
}

const fn quantity(
    name: &'static str,
    unit: &'static str,
    frame: &'static str,
    size: usize,
) -> Quantity {
    Quantity { name, unit, frame, size }
}

/// All power of an applied force is supplied.
fn supplied<const D: usize, const N: usize, const W: usize>(
    force: &impl ForceElement<D, N, W>,
    input: &ForceInput<f64, D, N, W>,
) -> Energy {
    let mut wrenches = [[0.0; W]; 2];
    force.evaluate(input, &mut wrenches, &mut []);
    Energy { supplied: product(&wrenches, input.twists()), ..Energy::default() }
}

/// Implements [`ForceElement`] for an enum by the element of each variant.
macro_rules! by_variant {
    ($name:ident, [$d:literal, $n:literal, $w:literal], $($variant:ident),+) => {
        impl ForceElement<$d, $n, $w> for $name {
            fn extra_states(&self) -> usize {
                match self { $(Self::$variant(e) => e.extra_states(),)+ }
            }
            fn extra_state_scales(&self) -> Vec<ExtraStateScale> {
                match self { $(Self::$variant(e) => e.extra_state_scales(),)+ }
            }
            fn counts_turns(&self) -> bool {
                match self { $(Self::$variant(e) => e.counts_turns(),)+ }
            }
            fn turned_over(&self, from: [&[f64; $n]; 2], to: [&[f64; $n]; 2]) -> bool {
                match self { $(Self::$variant(e) => e.turned_over(from, to),)+ }
            }
            fn angle(&self, bodies: [&Body<f64, $d, $n, $w>; 2], winding: f64) -> f64 {
                match self { $(Self::$variant(e) => e.angle(bodies, winding),)+ }
            }
            fn evaluate<T: Real>(
                &self,
                input: &ForceInput<T, $d, $n, $w>,
                wrenches: &mut Wrenches<T, $w>,
                z_rate: &mut [T],
            ) {
                match self { $(Self::$variant(e) => e.evaluate(input, wrenches, z_rate),)+ }
            }
            #[inline(always)]
            fn blocks<T: Real>(
                &self,
                input: &ForceInput<T, $d, $n, $w>,
                out: &mut ForceBlocks<T, $w>,
            ) {
                match self { $(Self::$variant(e) => e.blocks(input, out),)+ }
            }
            fn extra_rows<T: Real>(
                &self,
                input: &ForceInput<T, $d, $n, $w>,
                out: &mut ExtraRows<'_, T, $w>,
            ) {
                match self { $(Self::$variant(e) => e.extra_rows(input, out),)+ }
            }
            fn energy(&self, input: &ForceInput<f64, $d, $n, $w>) -> Energy {
                match self { $(Self::$variant(e) => e.energy(input),)+ }
            }
            fn quantities(&self) -> &'static [Quantity] {
                match self { $(Self::$variant(e) => e.quantities(),)+ }
            }
            fn quantity(
                &self,
                index: usize,
                input: &ForceInput<f64, $d, $n, $w>,
                out: &mut [f64],
            ) {
                match self { $(Self::$variant(e) => e.quantity(index, input, out),)+ }
            }
            fn breakpoints(&self) -> Vec<f64> {
                match self { $(Self::$variant(e) => e.breakpoints(),)+ }
            }
            fn longest_step(&self, input: &ForceInput<f64, $d, $n, $w>) -> f64 {
                match self { $(Self::$variant(e) => e.longest_step(input),)+ }
            }
            fn knots(&self) -> Vec<Vec<f64>> {
                match self { $(Self::$variant(e) => e.knots(),)+ }
            }
            fn velocities(&self) -> usize {
                match self { $(Self::$variant(e) => e.velocities(),)+ }
            }
            fn arguments(
                &self,
                input: &ForceInput<f64, $d, $n, $w>,
                out: &mut [crate::elements::LawPlace],
            ) {
                match self { $(Self::$variant(e) => e.arguments(input, out),)+ }
            }
            fn profile(&self, index: usize, argument: f64) -> f64 {
                match self { $(Self::$variant(e) => e.profile(index, argument),)+ }
            }
        }
    };
}
pub(super) use by_variant;
