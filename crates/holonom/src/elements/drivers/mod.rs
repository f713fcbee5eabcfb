//! Prescribed motions: u(q) = s(t) with u a relative coordinate of two frames.

pub(super) mod rotation;
pub(super) mod translation;
