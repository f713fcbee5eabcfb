//! Holonom: implicit integration of constrained multibody systems.
//!
//! Rooms, in the order in which a model becomes a trajectory. Which room may use which others is told
//! by the table in `ARCHITECTURE.md`, which `tests/engine/architecture.rs` keeps.

pub mod error;
pub use holonom_linalg::{threads, watch};
pub mod math;
pub mod model;
pub mod topology;

pub mod elements;
pub mod newton;
pub mod reduction;
pub mod system;

pub mod control;
pub mod formula;
pub mod method;
pub mod simulation;

pub mod analysis;
pub mod io;

#[cfg(test)]
mod testing;
