//! Setting one value of a document by its path.

use indexmap::IndexSet;

use super::check::{COLLECTIONS, INITIAL, kind_fits};
use super::names::suggestion;
use super::shape::{Shape, Tagged, model_shape, other_ways};
use super::tree::{Entry, Node, Span, Step, Table, Value, join, node_at, parse_path, path_of};
use crate::error::{Code, Diagnostic};

/// Removes what says in another way what is set at `path`.
pub(super) fn make_way(root: &mut Node, path: &str) {
    let (mut node, mut shape) = (root, Some(model_shape()));
    for step in parse_path(path).unwrap_or_default() {
        let of_fields = shape.is_some_and(|shape| !matches!(fitting(shape, node), Shape::Map(_)));
        shape = shape.and_then(|shape| inner(shape, node, &step));
        let next = match (&mut node.value, &step) {
            (Value::Table(table), Step::Field(name)) => {
                if of_fields {
                    other_ways(name).for_each(|other| drop(table.shift_remove(other)));
                }
                table.get_mut(name).map(|entry| &mut entry.node)
            }
            (Value::List(list), Step::Index(i)) => list.get_mut(*i),
            _ => None,
        };
        let Some(next) = next else { return };
        node = next;
    }
}

/// Puts `value` where `path` leads. The path must exist in the file, in the format, or in `expanded`,
/// the file with its patterns written out: what is set there is laid over what the pattern writes.
pub(super) fn set(
    root: &mut Node,
    expanded: Option<&Node>,
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
        Err(code) => return Err(Box::new(no_value(code, path, &steps))),
    };
    // `parameters.spring` means its value.
    if let [Step::Field(collection), Step::Field(_)] = &steps[..]
        && collection == "parameters"
        && !matches!(new.value, Value::Table(_))
    {
        steps.push(Step::Field("value".to_owned()));
    }
    let mut shape = Some(model_shape());
    // Names that `initial` may speak of although it does not yet.
    let spoken_of = match &steps[..] {
        [Step::Field(initial), Step::Field(of), Step::Field(name), ..] if initial == "initial" => {
            let table = INITIAL.iter().find(|(table, _)| table == of);
            table.map(|(_, collection)| (*collection, name))
        }
        _ => None,
    };
    let tables = spoken_of.map_or(Vec::new(), |(collection, _)| {
        let trees = [Some(&*root), expanded].into_iter().flatten();
        trees.filter_map(|tree| tree.field(collection)?.table()).collect()
    });
    // The same of a bushing, whose branches have the extra states.
    let of_bushing = match spoken_of {
        Some(("forces", name)) => join("initial.extra_states", name),
        _ => String::new(),
    };
    let branches: Vec<String> = spoken_of.map_or(Vec::new(), |(_, name)| {
        let items = tables.iter().filter_map(|table: &&Table| table.get(name.as_str()));
        let branches = items.filter_map(|item| item.node.field("branches")?.table());
        branches.flat_map(|table| table.keys().cloned()).collect()
    });
    let is_there = spoken_of.is_some_and(|(_, n)| tables.iter().any(|t| t.contains_key(n)));
    let names: Vec<String> = if is_there {
        Vec::new() // they are for help only
    } else {
        tables.iter().flat_map(|table| table.keys().cloned()).collect()
    };
    let mut node = root;
    // What patterns wrote there.
    let mut seen = expanded;
    let mut walked = String::new();
    let mut is_stated = true;
    for step in &steps {
        let kind = node.kind();
        let guide = seen.filter(|_| node.field("type").is_none()).unwrap_or(node);
        // Tables whose names are those of items defined elsewhere.
        let of_names = INITIAL.iter().any(|(table, _)| walked == join("initial", table));
        let of_branches = !of_bushing.is_empty() && walked == of_bushing;
        let known = match (of_names, of_branches) {
            (true, _) => Vec::new(),
            (_, true) => branches.clone(),
            _ => fields(shape, guide),
        };
        shape = shape.and_then(|shape| inner(shape, guide, step));
        seen = seen.and_then(|seen| match (&seen.value, step) {
            (Value::Table(table), Step::Field(name)) => table.get(name).map(|entry| &entry.node),
            (Value::List(list), Step::Index(i)) => list.get(*i),
            _ => None,
        });
        node = match (&mut node.value, step) {
            (Value::Table(table), Step::Field(name)) => {
                let at = join(&walked, name);
                if !table.contains_key(name) {
                    let of_format = known.contains(name) || (of_names && is_there);
                    let node = match seen {
                        // Of an item of a pattern what is set is stated, and no more; lists are
                        // replaced as a whole.
                        Some(Node { value: Value::Table(_), .. }) => empty(),
                        Some(written) => written.clone(),
                        // What is not written yet becomes a table when the path goes on through it.
                        None if shape.is_some() && of_format => {
                            is_stated = false;
                            empty()
                        }
                        None => {
                            let written = table.keys().cloned().chain(known).chain(names);
                            let others = guide_names(expanded, &walked);
                            let candidates: IndexSet<String> = written.chain(others).collect();
                            let owner = if walked.is_empty() { "the model" } else { &walked };
                            let message = format!("`{path}`: {owner} has no `{name}`");
                            let items = COLLECTIONS.contains(&walked.as_str());
                            let what = match (items, of_branches) {
                                (true, _) => "names",
                                (_, true) => "branches",
                                _ => "fields",
                            };
                            let help =
                                suggestion(name, what, candidates.iter().map(String::as_str));
                            return fail(message, help);
                        }
                    };
                    table.insert(name.clone(), Entry { key: Span::SET, node });
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
            _ if !is_stated => {
                let message = format!("`{path}`: `{walked}` is not stated");
                return fail(message, format!("set the whole list, `{walked}`"));
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

/// Null is what other programs remove things by: the help says how that is done here.
fn no_value(code: Code, path: &str, steps: &[Step]) -> Diagnostic {
    if code == Code::NotFinite {
        let message = format!(
            "the new value of `{path}` is not finite; numbers of a model are at most 1e100"
        );
        return Diagnostic::new(code, path, message).help("look for a slip in the exponent");
    }
    let item = match steps {
        [Step::Field(of), Step::Field(_), ..]
            if of != "parameters" && COLLECTIONS.contains(&of.as_str()) =>
        {
            Some(path_of(&steps[..2]))
        }
        _ => None,
    };
    let help = match (item, steps.len()) {
        (Some(item), 2) => format!("`{item}.enabled = false` switches it off"),
        (Some(item), _) => format!(
            "give the value that is meant, such as the field's default; `{item}.enabled = false` switches the \
             whole item off"
        ),
        (None, _) => "give the value that is meant, such as the field's default".to_owned(),
    };
    let message = format!("the new value of `{path}` is null or holds one, which is no value");
    Diagnostic::new(code, path, message).help(help)
}

fn empty() -> Node {
    Node { value: Value::Table(Table::new()), span: Span::SET }
}

/// Names that stand in a table of the file with its patterns written out.
fn guide_names(expanded: Option<&Node>, walked: &str) -> Vec<String> {
    let table = expanded.and_then(|tree| node_at(tree, walked)?.table());
    table.into_iter().flat_map(|table| table.keys().cloned()).collect()
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

/// The shape one step further; of a table by `type`, that of `node`.
pub(super) fn inner<'a>(shape: &'a Shape, node: &Node, step: &Step) -> Option<&'a Shape> {
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

/// The shape itself, or the alternative that takes values of the kind of `node`.
pub(super) fn fitting<'a>(shape: &'a Shape, node: &Node) -> &'a Shape {
    match shape {
        Shape::Either(either) => {
            either.list.iter().map(|(_, s)| s).find(|s| kind_fits(s, node)).unwrap_or(shape)
        }
        shape => shape,
    }
}
