//! Setting one value of a document by its path.

use super::check::{COLLECTIONS, kind_fits};
use super::names::suggestion;
use super::shape::{Shape, Tagged, model_file};
use super::tree::{Entry, Node, Span, Step, Table, Value, join, parse_path};
use crate::error::{Code, Diagnostic};

/// Puts `value` where `path` leads. The path must exist in the file or in the format.
pub(super) fn set(
    root: &mut Node,
    path: &str,
    value: &serde_json::Value,
) -> Result<(), Box<Diagnostic>> {
    let fail = |message: String, help: String| {
        Err(Box::new(Diagnostic::new(Code::UnknownPath, path, message).help(help)))
    };
    let Some(mut steps) = parse_path(path) else {
        let message = format!("`{path}` is not a path of a model");
        let help = "write it like `forces.front.stiffness[2]`".to_owned();
        return fail(message, help);
    };
    if path == "extends" {
        let message = "`extends` was followed when the file was read; it takes no value".to_owned();
        return fail(message, "change the file, or read another one".to_owned());
    }
    let new = match Node::from_json(value) {
        Ok(new) => new,
        Err(reason) => {
            let message = format!("the value for `{path}`: {reason}");
            return Err(Box::new(Diagnostic::new(Code::NotFinite, path, message)));
        }
    };
    // `parameters.spring` means its value.
    if let [Step::Field(collection), Step::Field(_)] = &steps[..]
        && collection == "parameters"
        && !matches!(new.value, Value::Table(_))
    {
        steps.push(Step::Field("value".to_owned()));
    }
    // Names that `initial` may speak of although it does not yet.
    let names = |collection: &str| -> Vec<String> {
        let items = root.field(collection).and_then(Node::table);
        items.into_iter().flat_map(|items| items.keys().cloned()).collect()
    };
    let (bodies, forces) = (names("bodies"), names("forces"));
    let root_shape = Shape::Record(model_file().clone());
    let mut shape = Some(&root_shape);
    let mut node = root;
    let mut walked = String::new();
    for step in &steps {
        // What is not written yet becomes a table when the path goes on through it.
        let known = match walked.as_str() {
            "initial.bodies" => bodies.clone(),
            "initial.extra_states" => forces.clone(),
            _ => fields(shape, node),
        };
        let kind = node.kind();
        shape = shape.and_then(|shape| inner(shape, node, step));
        node = match (&mut node.value, step) {
            (Value::Table(table), Step::Field(name)) => {
                let at = join(&walked, name);
                if !table.contains_key(name) {
                    if shape.is_none() || !known.contains(name) {
                        let written: Vec<String> = table.keys().cloned().collect();
                        let mut candidates = written;
                        candidates.extend(known.into_iter().filter(|k| !table.contains_key(k)));
                        let owner = if walked.is_empty() { "the model" } else { &walked };
                        let message = format!("`{path}`: {owner} has no `{name}`");
                        let what =
                            if COLLECTIONS.contains(&walked.as_str()) { "names" } else { "fields" };
                        let help = suggestion(name, what, candidates.iter().map(String::as_str));
                        return fail(message, help);
                    }
                    let empty = Node { value: Value::Table(Table::new()), span: Span::SET };
                    table.insert(name.clone(), Entry { key: Span::SET, node: empty });
                }
                walked = at;
                &mut table[name.as_str()].node
            }
            (Value::List(list), Step::Index(i)) => {
                let length = list.len();
                let Some(entry) = list.get_mut(*i) else {
                    let message =
                        format!("`{path}`: `{walked}` has {length} entries, counted from 0");
                    return fail(message, String::new());
                };
                walked = format!("{walked}[{i}]");
                entry
            }
            _ => {
                let message = format!("`{path}`: `{walked}` is {kind}, which has no such part");
                return fail(message, String::new());
            }
        };
    }
    *node = new;
    Ok(())
}

/// Fields that the format knows for a table.
fn fields(shape: Option<&Shape>, node: &Node) -> Vec<String> {
    match shape.map(|shape| fitting(shape, node)) {
        Some(Shape::Record(record)) => record.fields.iter().map(|f| f.name.clone()).collect(),
        Some(Shape::Tagged(Tagged { variants, .. })) => {
            let kind = node.field("type").and_then(Node::text);
            let variant = variants.iter().find(|v| Some(v.name.as_str()) == kind);
            variant.map_or(Vec::new(), |v| v.record.fields.iter().map(|f| f.name.clone()).collect())
        }
        _ => Vec::new(),
    }
}

/// The shape one step further.
fn inner<'a>(shape: &'a Shape, node: &Node, step: &Step) -> Option<&'a Shape> {
    match (fitting(shape, node), step) {
        (Shape::Record(record), Step::Field(name)) => Some(&record.field(name)?.shape),
        (Shape::Tagged(Tagged { variants, .. }), Step::Field(name)) => {
            let kind = node.field("type").and_then(Node::text)?;
            let variant = variants.iter().find(|v| v.name == kind)?;
            Some(&variant.record.field(name)?.shape)
        }
        (Shape::Map(item), Step::Field(_)) | (Shape::List { item, .. }, Step::Index(_)) => {
            Some(item)
        }
        _ => None,
    }
}

fn fitting<'a>(shape: &'a Shape, node: &Node) -> &'a Shape {
    match shape {
        Shape::Either(either) => {
            either.list.iter().map(|(_, s)| s).find(|s| kind_fits(s, node)).unwrap_or(shape)
        }
        shape => shape,
    }
}
