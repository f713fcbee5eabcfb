//! Patterns: items that are written once and repeated over indices. They are written out here, so
//! that everything after sees a plain file; numbers keep their expressions, with the index put in.

//!
//! `indices` finds the values that indices take, `row` fills in those of one repetition, `expander` writes
//! the items and lays out what is stated beside them.

mod expander;
mod indices;
mod row;

use std::collections::BTreeSet;

use indexmap::IndexMap;

use self::expander::Expander;
use self::indices::Indices;
use super::expression::{Part, could_be, parts};
use super::parameters::Parameters;
use super::tree::{Node, Step, Value, node_at, parse_path, path_of};
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
    /// Names that patterns make where nothing is wrong with them.
    keys: Vec<Key>,
}

/// Names that a pattern makes in a section.
struct Key {
    section: usize,
    /// `link_{i}`
    text: String,
    /// Path of the pattern.
    pattern: String,
    made: Made,
}

/// What came of the items of a key.
#[derive(PartialEq)]
enum Made {
    /// All of them, by this pattern.
    All(usize),
    /// Something is wrong with them, which is reported.
    Broken,
    /// The pattern is switched off.
    Off,
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

    /// What findings say of items that look like exceptions of patterns, none told yet.
    pub(super) fn exceptions(&self) -> Exceptions<'_> {
        let keys = self.keys.iter().filter_map(|key| Some((parts(&key.text).ok()?, key)));
        Exceptions { expanded: self, keys: keys.collect(), told: BTreeSet::new() }
    }
}

/// Items that look like exceptions of patterns, which make no such items.
pub(super) struct Exceptions<'a> {
    expanded: &'a Expanded,
    keys: Vec<(Vec<Part<'a>>, &'a Key)>,
    told: BTreeSet<String>,
}

impl<'a> Exceptions<'a> {
    /// A finding, or in the place of what it says of one field of such an item what is to be said of the item;
    /// `None` where that was told before or follows from what is wrong with the pattern.
    pub(super) fn told(&mut self, finding: Diagnostic) -> Option<Diagnostic> {
        let Some((item, key)) = self.exception(&finding) else { return Some(finding) };
        let (what, first) = match key.made {
            Made::Broken => return None,
            _ if !self.told.insert(item.clone()) => return None,
            Made::All(pattern) => {
                let extent = self.expanded.patterns[pattern].extent();
                (format!("makes no `{item}` ({extent})"), "extend the range")
            }
            Made::Off => (format!("is switched off and makes no `{item}`"), "switch it on"),
        };
        let message = format!("`{}` {what}, and it is not whole by itself", key.pattern);
        let help = format!("{first}, remove the exception, or state all fields of the item");
        Some(Diagnostic::new(Code::UnknownName, item, message).help(help))
    }

    /// The item that a finding says is not whole, or has nothing to switch off, and the key that its name is likely to
    /// be meant for.
    fn exception(&self, finding: &Diagnostic) -> Option<(String, &'a Key)> {
        let lacks = finding.code == Code::MissingField;
        if self.keys.is_empty() || !lacks && finding.code != Code::UnknownName {
            return None;
        }
        let below = |place: &[&str]| {
            finding.path.strip_prefix(&place.join(".")).is_some_and(|rest| rest.starts_with('.'))
        };
        let section = SECTIONS.iter().position(|place| below(place))?;
        let steps = parse_path(&finding.path)?;
        let item = steps.get(..=SECTIONS[section].len())?;
        let (Some(Step::Field(name)), path) = (item.last(), path_of(item)) else { return None };
        if self.expanded.origins.contains_key(&path) || !lacks && item.len() < steps.len() {
            return None;
        }
        let fitting =
            self.keys.iter().filter(|(parts, key)| key.section == section && could_be(parts, name));
        let key = fitting.map(|(_, key)| *key).min_by_key(|key| key.made != Made::Broken)?;
        Some((path, key))
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
