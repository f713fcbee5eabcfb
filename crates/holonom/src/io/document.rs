//! A model file read and merged, before it becomes a model: values can be set by path, the merged
//! text can be kept, a model can be built.

use std::collections::BTreeSet;

use indexmap::IndexMap;

use super::channels::unknown_channels;
use super::check::check_file;
use super::expression::{Part, names, parts};
use super::limits;
use super::merge::{Resolver, read_chain, without_disabled};
use super::meshes;
use super::patterns::{Expanded, expand};
use super::read::Syntax;
use super::resolve;
use super::schema::ModelFile;
use super::set::{make_way, set};
use super::tree::{Node, Places, Source, Span, Value, join, location, marks_key, node_at, span_of};
use super::units::Units;
use crate::error::{Code, Diagnostic, Location, ModelErrors, Severity, Warning, printable};
use crate::model::Model;
use crate::simulation::Problem;
use crate::watch::{NAMED, checkpoint, stage};

/// What observers are told while a file becomes a model.
const READING: &str = "reading";

/// A model file with the files it extends, merged by name.
#[derive(Debug, Clone)]
pub struct Document {
    root: Node,
    sources: Vec<Source>,
}

impl Document {
    /// Reads a model file and those it extends.
    ///
    /// `file_name` is used in messages and as the base of relative paths; `resolver` returns the text
    /// of the file that `extends` names, whose path it receives relative to the same base as
    /// `file_name`, and refuses paths that it will not read. Circles are found here.
    ///
    /// # Errors
    /// Syntax errors, repeated keys, numbers that are not finite, sizes beyond [`limits`], and what
    /// is wrong with `extends`.
    pub fn parse(
        text: &str,
        syntax: Syntax,
        file_name: &str,
        resolver: &mut dyn FnMut(&str) -> Result<String, String>,
    ) -> Result<Self, ModelErrors> {
        let mut sources = Vec::new();
        let resolver: &mut Resolver<'_> = resolver;
        let root = stage(READING, || read_chain(text, syntax, file_name, resolver, &mut sources))?;
        Ok(Self { root, sources })
    }

    /// The document with the triangles of the meshes that it names, which are read from STL files.
    ///
    /// `reader` returns the bytes of a file whose path it receives as the resolver of [`Self::parse`] does.
    ///
    /// # Errors
    /// [`Code::Mesh`] for every file that cannot be read.
    pub fn with_meshes(
        mut self,
        reader: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>,
    ) -> Result<Self, ModelErrors> {
        stage(READING, || meshes::put_in(&mut self.root, &self.sources, reader))?;
        Ok(self)
    }

    /// The document with new values, in the units of the file: `forces.front.stiffness[2]`, `parameters.spring`,
    /// `simulation.end_time`. A path that is not written in the file but that the format knows is
    /// added; what says the same in another way, in its place. What is set of an item that a pattern makes is laid over it.
    ///
    /// # Errors
    /// [`Code::UnknownPath`] with the nearest path, for all paths that lead nowhere.
    pub fn with_values<P: AsRef<str>>(
        &self,
        values: &[(P, serde_json::Value)],
    ) -> Result<Self, ModelErrors> {
        let mut document = self.clone();
        let mut errors: Vec<Diagnostic> = Vec::new();
        // Before all, so that values that contradict each other are refused.
        values.iter().for_each(|(path, _)| make_way(&mut document.root, path.as_ref()));
        // What is written by patterns depends on these: the order of the call does not matter.
        let (first, then): (Vec<_>, Vec<_>) = values.iter().partition(|(path, _)| {
            ["parameters.", "patterns."].iter().any(|start| path.as_ref().starts_with(start))
        });
        for (path, value) in first {
            errors.extend(set(&mut document.root, None, path.as_ref(), value).err().map(|e| *e));
        }
        let has_patterns = document.root.field("patterns").is_some() && !then.is_empty();
        let expanded = has_patterns.then(|| expand(document.root.clone()).root);
        for (path, value) in then {
            let set = set(&mut document.root, expanded.as_ref(), path.as_ref(), value);
            errors.extend(set.err().map(|e| *e));
        }
        if errors.is_empty() { Ok(document) } else { Err(ModelErrors { errors, omitted: 0 }) }
    }

    /// The merged file as JSON, in its own units and without what is switched off; reading it gives the same
    /// model.
    pub fn to_json(&self) -> String {
        // An item of a pattern is switched off by what is laid over it, which then has to stay.
        let root = self.root.clone();
        let root = if root.field("patterns").is_some() { root } else { without_disabled(root) };
        format!("{:#}\n", root.to_json())
    }

    /// The same with its patterns written out, all items under their names, and values in the place of expressions: numbers
    /// in SI, but for those of parameters, which have the units of the fields that used them. Of a file in units of its own
    /// columns stand in the place of the names of tables.
    ///
    /// # Errors
    /// What is wrong with the patterns or the fields.
    pub fn to_plain_json(&self) -> Result<String, ModelErrors> {
        let mut expanded = self.expanded();
        let mut errors = std::mem::take(&mut expanded.errors);
        let (mut json, found) = check_file(&expanded.root);
        errors.extend(found);
        if !errors.is_empty() {
            return Err(self.collect(errors, &expanded));
        }
        if let Some(file) = json.as_object_mut() {
            let in_si = Units::of(&expanded.root).are_si();
            let done: &[&str] =
                if in_si { &["patterns"] } else { &["units", "patterns", "tables"] };
            done.iter().for_each(|name| drop(file.shift_remove(*name)));
        }
        Ok(format!("{json:#}\n"))
    }

    /// The tree with patterns written out and without what is switched off.
    fn expanded(&self) -> Expanded {
        let mut expanded = expand(self.root.clone());
        let none = Node { value: Value::Bool(false), span: Span::SET };
        expanded.root = without_disabled(std::mem::replace(&mut expanded.root, none));
        expanded
    }

    /// Checks everything and builds the model.
    ///
    /// # Errors
    /// All errors found, up to [`limits::ERRORS_SHOWN`], in file order.
    pub fn build(&self) -> Result<(Model, Vec<Warning>), ModelErrors> {
        let (model, warnings) = stage(READING, || self.built())?;
        // A copy has its many small pieces side by side: those made between what reading throws away would keep most of
        // that from being used again.
        Ok((model.clone(), warnings))
    }

    /// Checks the output channels of the file, whose quantities only the compiled model knows: `problem` is that of the
    /// model that [`Self::build`] returns.
    ///
    /// # Errors
    /// [`Code::UnknownName`] for every channel that is not there, with the nearest.
    pub fn check_channels(&self, problem: &Problem) -> Result<(), ModelErrors> {
        let errors = unknown_channels(problem);
        if errors.is_empty() { Ok(()) } else { Err(self.collect(errors, &self.expanded())) }
    }

    /// Where a file states the first of these that it states: a path of the model, or the name of an item.
    pub fn location_of(&self, wanted: &[&str]) -> Option<Location> {
        let root = self.expanded().root;
        let collections = ["joints", "drivers", "forces", "bodies"];
        let mut paths = wanted.iter().flat_map(|name| {
            let items = collections.iter().map(|collection| join(collection, name));
            std::iter::once((*name).to_owned()).chain(items)
        });
        let path = paths.find(|path| path.contains('.') && node_at(&root, path).is_some())?;
        location(span_of(&root, &path, true), &self.sources)
    }

    fn built(&self) -> Result<(Model, Vec<Warning>), ModelErrors> {
        let mut expanded = self.expanded();
        let mut errors = std::mem::take(&mut expanded.errors);
        let (json, found) = check_file(&expanded.root);
        errors.extend(found);
        if !errors.is_empty() {
            return Err(self.collect(errors, &expanded));
        }
        let file: ModelFile = serde_json::from_value(json).map_err(|error| {
            // The check follows the same types, so this would be a fault of the check.
            let message = format!("the file does not fit the format: {error}");
            ModelErrors::from(Diagnostic::new(Code::WrongType, "", message))
        })?;
        let (model, found) = resolve::model(&file);
        let (found, mut errors): (Vec<_>, Vec<_>) =
            found.into_iter().partition(|finding| finding.code.severity() == Severity::Warning);
        // What could be resolved is looked at in any case, so that all errors come at once.
        errors.extend(crate::model::validate(&model));
        if !errors.is_empty() {
            return Err(self.collect(errors, &expanded));
        }
        let mut warnings = unused_parameters(&self.root);
        if file.gravity.is_none() {
            let message = "`gravity` is not stated; the model has none";
            let help = "write `gravity` to say so, or to have it";
            warnings.push(Diagnostic::new(Code::NotStated, "gravity", message).help(help));
        }
        let stated = Units::stated(&expanded.root);
        if !stated.angle {
            warnings.extend(found); // angles that look like degrees
        }
        warnings.extend(crate::model::implausible(&model, stated));
        let mut warnings = self.once(warnings, &expanded);
        if !warnings.is_empty() {
            let places = Places::new(&self.sources);
            for (span, warning) in &mut warnings {
                warning.location = places.of(*span);
            }
        }
        Ok((model, warnings.into_iter().map(|(_, warning)| warning).collect()))
    }

    /// Errors in file order with their places, the first ones.
    fn collect(&self, errors: Vec<Diagnostic>, expanded: &Expanded) -> ModelErrors {
        let mut placed = self.once(errors, expanded);
        placed.sort_by_key(|(span, _)| *span);
        let omitted = placed.len().saturating_sub(limits::ERRORS_SHOWN);
        placed.truncate(limits::ERRORS_SHOWN);
        let mut errors = Vec::with_capacity(placed.len());
        for (span, mut error) in placed {
            error.location = location(span, &self.sources);
            error.path = printable(&error.path);
            errors.push(error);
        }
        ModelErrors { errors, omitted }
    }

    /// Findings with their places. What is found in the repetitions of a pattern is said once, at the
    /// first, and leads to the pattern.
    fn once(&self, findings: Vec<Diagnostic>, expanded: &Expanded) -> Vec<(Span, Diagnostic)> {
        let mut out: Vec<(Span, Diagnostic)> = Vec::with_capacity(findings.len());
        let mut seen: IndexMap<(String, Code), Repeated> = IndexMap::new();
        let mut exceptions = expanded.exceptions();
        for finding in findings {
            checkpoint(NAMED);
            let Some(mut finding) = exceptions.told(finding) else { continue };
            let of_pattern = finding.path.starts_with("patterns.");
            let tree = if of_pattern { &self.root } else { &expanded.root };
            let span = span_of(tree, &finding.path, marks_key(finding.code));
            if let Some((path, pattern, at)) = expanded.origin(&finding.path, &self.root) {
                let index = out.len();
                let first = Repeated { index, more: 0, pattern: pattern.to_owned(), at };
                match seen.entry((path.clone(), finding.code)) {
                    indexmap::map::Entry::Occupied(mut entry) => {
                        entry.get_mut().more += 1;
                        continue;
                    }
                    indexmap::map::Entry::Vacant(entry) => entry.insert(first),
                };
                finding.path = path;
            }
            out.push((span, finding));
        }
        for (_, finding) in &mut out {
            let note = printable(&self.note(finding));
            finding.message += &note;
        }
        for Repeated { index, more, pattern, at } in seen.into_values() {
            let others = if more == 0 { String::new() } else { format!(" and {more} more") };
            let place = format!(" (`{pattern}`, {at}{others})");
            out[index].1.message += &place;
        }
        out
    }

    /// Of a number that an expression brought: the expression leads to the place to change.
    fn note(&self, finding: &Diagnostic) -> String {
        let written = node_at(&self.root, &finding.path).and_then(Node::text);
        let Some(expression) = written.and_then(|text| text.strip_prefix('=')) else {
            return String::new();
        };
        if !OF_VALUES.contains(&finding.code) {
            return String::new();
        }
        match self.root.field("parameters").and_then(|p| p.field(expression)) {
            Some(_) => format!(" (the value of the parameter `{expression}`)"),
            None => format!(" (the value of `={expression}`)"),
        }
    }
}

/// A finding in the repetitions of a pattern: the first and how many more there are.
struct Repeated {
    index: usize,
    more: usize,
    pattern: String,
    at: String,
}

/// Errors about the value of a number that do not quote the expression it comes from.
const OF_VALUES: [Code; 9] = [
    Code::TooLarge,
    Code::OutOfRange,
    Code::Inertia,
    Code::Matrix,
    Code::ZeroAxis,
    Code::NotPerpendicular,
    Code::NotUnit,
    Code::CoincidentPoints,
    Code::Table,
];

/// Parameters that no text of the file refers to, switched-off items included: a variant that
/// switches items off should not be blamed.
fn unused_parameters(root: &Node) -> Vec<Warning> {
    let Some(parameters) = root.field("parameters").and_then(Node::table) else {
        return Vec::new();
    };
    let mut used = BTreeSet::new();
    references(root, &mut used);
    let unused = parameters.keys().filter(|name| !used.contains(name.as_str()));
    unused
        .map(|name| {
            let message = format!("the parameter `{name}` is not used");
            let help = format!("write \"={name}\" where it belongs, or remove it");
            Diagnostic::new(Code::UnusedParameter, format!("parameters.{name}"), message).help(help)
        })
        .collect()
}

fn references<'a>(node: &'a Node, used: &mut BTreeSet<&'a str>) {
    match &node.value {
        Value::Text(text) => references_of_text(text, used),
        Value::List(list) => list.iter().for_each(|node| references(node, used)),
        Value::Table(table) => {
            for (key, entry) in table {
                references_of_text(key, used);
                references(&entry.node, used);
            }
        }
        _ => {}
    }
}

fn references_of_text<'a>(text: &'a str, used: &mut BTreeSet<&'a str>) {
    if let Some(expression) = text.strip_prefix('=') {
        used.insert(expression.trim());
        names(expression, &mut |name, _| {
            used.insert(name);
        });
    }
    if text.contains('{') {
        for part in parts(text).unwrap_or_default() {
            if let Part::Number(expression, _) = part {
                names(expression, &mut |name, _| {
                    used.insert(name);
                });
            }
        }
    }
}
