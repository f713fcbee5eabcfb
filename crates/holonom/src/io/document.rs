//! A model file read and merged, before it becomes a model: values can be set by path, the merged
//! text can be kept, a model can be built.

use super::check::check_file;
use super::limits;
use super::merge::{Resolver, read_chain, without_disabled};
use super::read::Syntax;
use super::resolve;
use super::schema::ModelFile;
use super::set::set;
use super::tree::{Node, Source, Span, Value, locate};
use crate::error::{Code, Diagnostic, ModelErrors, Warning};
use crate::model::Model;

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
        let root = read_chain(text, syntax, file_name, resolver, &mut sources)?;
        Ok(Self { root, sources })
    }

    /// The document with new values: `forces.front.stiffness[2]`, `parameters.spring`,
    /// `simulation.end_time`. A path that is not written in the file but that the format knows is
    /// added.
    ///
    /// # Errors
    /// [`Code::UnknownPath`] with the nearest path, for all paths that lead nowhere.
    pub fn with_values<P: AsRef<str>>(
        &self,
        values: &[(P, serde_json::Value)],
    ) -> Result<Self, ModelErrors> {
        let mut document = self.clone();
        let errors: Vec<Diagnostic> = values
            .iter()
            .filter_map(|(path, value)| set(&mut document.root, path.as_ref(), value).err())
            .map(|error| *error)
            .collect();
        if errors.is_empty() { Ok(document) } else { Err(ModelErrors { errors, omitted: 0 }) }
    }

    /// The merged file as JSON, without what is switched off; reading it gives the same model.
    pub fn to_json(&self) -> String {
        format!("{:#}\n", without_disabled(&self.root).to_json())
    }

    /// Checks everything and builds the model.
    ///
    /// # Errors
    /// All errors found, up to [`limits::ERRORS_SHOWN`], in file order.
    pub fn build(&self) -> Result<(Model, Vec<Warning>), ModelErrors> {
        let root = without_disabled(&self.root);
        let (json, errors) = check_file(&root);
        if !errors.is_empty() {
            return Err(self.collect(errors, &root));
        }
        let file: ModelFile = serde_json::from_value(json).map_err(|error| {
            // The check follows the same types, so this would be a fault of the check.
            let message = format!("the file does not fit the format: {error}");
            ModelErrors::from(Diagnostic::new(Code::WrongType, "", message))
        })?;
        let (model, mut errors) = resolve::model(&file);
        // What could be resolved is looked at in any case, so that all errors come at once.
        errors.extend(crate::model::validate(&model));
        if !errors.is_empty() {
            return Err(self.collect(errors, &root));
        }
        let mut warnings = unused_parameters(&self.root);
        if file.gravity.is_none() {
            let message = "`gravity` is not stated; the model has none";
            let help = "write `gravity` to say so, or to have it";
            warnings.push(Diagnostic::new(Code::NotStated, "gravity", message).help(help));
        }
        warnings.extend(crate::model::implausible(&model));
        for warning in &mut warnings {
            locate(warning, &root, &self.sources);
        }
        Ok((model, warnings))
    }

    /// Errors in file order with their places, the first ones.
    fn collect(&self, errors: Vec<Diagnostic>, root: &Node) -> ModelErrors {
        let of_key = |e: &Diagnostic| super::tree::marks_key(e.code);
        let mut placed: Vec<(Span, Diagnostic)> = errors
            .into_iter()
            .map(|error| (super::tree::span_of(root, &error.path, of_key(&error)), error))
            .collect();
        placed.sort_by_key(|(span, _)| *span);
        let omitted = placed.len().saturating_sub(limits::ERRORS_SHOWN);
        placed.truncate(limits::ERRORS_SHOWN);
        let mut errors: Vec<Diagnostic> = placed.into_iter().map(|(_, error)| error).collect();
        for error in &mut errors {
            locate(error, root, &self.sources);
            // A number that a parameter brought: its name leads to the place to change.
            let written = super::tree::node_at(root, &error.path).and_then(Node::text);
            if let Some(name) = written.and_then(|text| text.strip_prefix('='))
                && !matches!(error.code, Code::UnknownName | Code::WrongType)
            {
                error.message += " (the value of the parameter `";
                error.message += name;
                error.message += "`)";
            }
        }
        ModelErrors { errors, omitted }
    }
}

/// Parameters that no text of the file refers to, switched-off items included: a variant that
/// switches items off should not be blamed.
fn unused_parameters(root: &Node) -> Vec<Warning> {
    let Some(parameters) = root.field("parameters").and_then(Node::table) else {
        return Vec::new();
    };
    let mut used = std::collections::BTreeSet::new();
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

fn references<'a>(node: &'a Node, used: &mut std::collections::BTreeSet<&'a str>) {
    match &node.value {
        Value::Text(text) => used.extend(text.strip_prefix('=')),
        Value::List(list) => list.iter().for_each(|node| references(node, used)),
        Value::Table(table) => table.values().for_each(|entry| references(&entry.node, used)),
        _ => {}
    }
}
