//! Integration formulas as data.

mod sdirk;

pub use sdirk::{SDIRK4_15, SDIRK4_16, Sdirk};
