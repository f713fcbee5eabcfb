//! Patterns: items that are written once and repeated over indices. They are written out here, so
//! that everything after sees a plain file; numbers keep their expressions, with the index put in.

//!
//! `indices` finds the values that indices take, `row` fills in those of one repetition, `expander` writes
//! the items and lays out what is stated beside them.

mod expander;
mod indices;
mod row;

use indexmap::IndexMap;

use self::expander::Expander;
use self::indices::Indices;
use super::parameters::Parameters;
use super::tree::{Node, Value, node_at, parse_path, path_of};
use crate::error::{Code, Diagnostic};

/// Tables of items that patterns repeat: the same path in a pattern and in the file.
const SECTIONS: [&[&str]; 8] = [
    &["bodies"],
    &["joints"],
    &["forces"],
    &["drivers"],
    &["tables"],
    &["initial", "bodies"],
    &["initial", "joints"],
    &["initial", "extra_states"],
];
const CHANNELS: [&str; 2] = ["outputs", "channels"];

/// A file with its patterns written out.
pub(super) struct Expanded {
    /// The plain tree; of the patterns it holds what is not repeated.
    pub(super) root: Node,
    pub(super) errors: Vec<Diagnostic>,
    /// By the path of what was written, `bodies.link_7`.
    origins: IndexMap<String, Origin>,
    patterns: Vec<Indices>,
    /// Paths of what is repeated, `patterns.chain.bodies."link_{i}"`.
    templates: Vec<String>,
    /// By the path of a plainly stated item whose name a pattern could make: that pattern.
    beside: IndexMap<String, usize>,
}

#[derive(Clone, Copy)]
struct Origin {
    template: usize,
    pattern: usize,
    row: usize,
}

impl Expanded {
    /// Where a pattern states what stands at `path` of the plain tree: the path in the pattern, the
    /// pattern, and the values of its indices. `None` for what the file states plainly.
    pub(super) fn origin(&self, path: &str, file: &Node) -> Option<(String, &str, String)> {
        if self.origins.is_empty() || node_at(file, path).is_some() {
            return None;
        }
        let steps = parse_path(path)?;
        let (origin, rest) = (2..=steps.len().min(3)).find_map(|n| {
            let (item, rest) = steps.split_at(n);
            Some((self.origins.get(&path_of(item))?, rest))
        })?;
        let mut path = self.templates[origin.template].clone();
        let rest = path_of(rest);
        if !rest.is_empty() {
            path = path + if rest.starts_with('[') { "" } else { "." } + &rest;
        }
        let pattern = &self.patterns[origin.pattern];
        Some((path, &pattern.path, pattern.at(origin.row)))
    }

    /// What a field that is missing says of an item that looks like an exception of a pattern, which makes no
    /// such item.
    pub(super) fn absent(&self, finding: &Diagnostic) -> Option<Diagnostic> {
        if finding.code != Code::MissingField || self.beside.is_empty() {
            return None;
        }
        let steps = parse_path(&finding.path)?;
        let (item, pattern) = (2..=steps.len().min(3)).find_map(|n| {
            let item = path_of(&steps[..n]);
            let pattern = *self.beside.get(&item)?;
            Some((item, &self.patterns[pattern]))
        })?;
        let (path, extent) = (&pattern.path, pattern.extent());
        let message =
            format!("`{path}` makes no `{item}` ({extent}), and it is not whole by itself");
        let help = "extend the range, remove the exception, or state all fields of the item";
        Some(Diagnostic::new(Code::UnknownName, item, message).help(help))
    }
}

/// Writes out the patterns of a file. Plainly stated items come first, then those of the patterns;
/// what is stated plainly under the name of a repeated item is laid over it.
pub(super) fn expand(mut root: Node) -> Expanded {
    let mut expander = Expander::new(Parameters::of(&root));
    if let Value::Table(file) = &mut root.value {
        expander.patterns(file);
        expander.lay_out(file);
    }
    Expanded { root, ..expander.out }
}
