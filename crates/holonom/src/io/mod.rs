//! Text to model: one spanned tree for TOML and JSON.
//!
//! The way of a file: `read` makes a tree in which every value knows its place, `merge` lays files
//! that extend each other into one, `meshes` puts in the triangles that bodies name, `patterns` writes out what is repeated, `check` compares it with
//! the `schema` and puts values, of `parameters` too, in the place of expressions, `resolve` turns names into indices and points into frames, `model::validate` looks at the
//! numbers. Each step reports all errors it finds. Last, `channels` compares the outputs with those of the compiled model.

mod channels;
mod check;
mod document;
mod expression;
pub mod limits;
mod merge;
mod meshes;
mod names;
mod parameters;
mod patterns;
mod read;
mod reference;
mod resolve;
mod schema;
mod set;
mod shape;
mod stl;
mod tree;
mod units;

pub use document::Document;
pub use read::Syntax;
pub use reference::reference_markdown;
pub use schema::json_schema;
