//! Files that extend each other: reading the chain, merging by name, removing what is switched off.

use indexmap::IndexSet;

use super::check::{COLLECTIONS, INITIAL};
use super::limits;
use super::read::{Syntax, read};
use super::set::{fitting, inner};
use super::shape::{Shape, model_shape, other_ways};
use super::tree::{Node, Source, Span, Step, Table, Value, join, location};
use super::units::QUANTITIES;
use crate::error::{Code, Diagnostic, ModelErrors};
use crate::watch::{NAMED, checkpoint};

/// Reads the text of a file by its path.
pub(super) type Resolver<'a> = dyn FnMut(&str) -> Result<String, String> + 'a;

/// Reads a file and those it extends into one tree.
pub(super) fn read_chain(
    text: &str,
    syntax: Syntax,
    name: &str,
    resolver: &mut Resolver<'_>,
    sources: &mut Vec<Source>,
) -> Result<Node, ModelErrors> {
    let mut layers = Vec::new();
    let mut next = Some((text.to_owned(), syntax, name.to_owned()));
    while let Some((text, syntax, name)) = next.take() {
        let file = sources.len();
        sources.push(Source { name: name.clone(), text });
        let mut root = read(&sources[file], syntax, file)?;
        check_version(&root, sources, file)?;
        if let Value::Table(table) = &mut root.value
            && let Some(entry) = table.shift_remove("extends")
        {
            next = Some(load(&entry.node, &name, resolver, sources)?);
        }
        layers.push(root);
    }
    let mut merged = layers.pop().unwrap_or(Node { value: Value::Bool(false), span: Span::SET });
    while let Some(layer) = layers.pop() {
        check_units(&merged, &layer, sources)?;
        merge(&mut merged, layer, Some(model_shape()));
    }
    Ok(merged)
}

fn check_version(root: &Node, sources: &[Source], file: usize) -> Result<(), ModelErrors> {
    let fail = |code, message: String, span| -> Result<(), ModelErrors> {
        let error = Diagnostic::new(code, "holonom", message)
            .help("write `holonom = 1` (in JSON `\"holonom\": 1`) at the top of the file");
        Err(Diagnostic { location: location(span, sources), ..error }.into())
    };
    if root.table().is_none() {
        return Ok(()); // reported with the structure of the file
    }
    let start = Span { file, start: 0, end: 0 };
    match root.field("holonom") {
        None => fail(Code::Version, "the file does not say its format version".to_owned(), start),
        Some(Node { value: Value::Number(1.0), .. }) => Ok(()),
        Some(node) => {
            let message = format!("`holonom` is {}; this program reads format 1", node.kind());
            fail(Code::Version, message, node.span)
        }
    }
}

/// A file that changes another one has its units: half of an item would else be in others.
fn check_units(base: &Node, layer: &Node, sources: &[Source]) -> Result<(), ModelErrors> {
    let Some(stated) = layer.field("units").and_then(Node::table) else { return Ok(()) };
    for (field, si, _) in QUANTITIES {
        let Some(entry) = stated.get(field) else { continue };
        let there = base.field("units").and_then(|units| units.field(field)?.text()).unwrap_or(si);
        if entry.node.text().is_some_and(|own| own != there) {
            let path = join("units", field);
            let message = format!(
                "`{path}` is {}, but the file that this one extends has {there:?}",
                entry.node.kind()
            );
            let error = Diagnostic::new(Code::ConflictingFields, path, message)
                .help("files that extend each other have the same units: leave `units` out here");
            return Err(Diagnostic { location: location(entry.node.span, sources), ..error }.into());
        }
    }
    Ok(())
}

/// The file that `extends` names.
fn load(
    target: &Node,
    from: &str,
    resolver: &mut Resolver<'_>,
    sources: &[Source],
) -> Result<(String, Syntax, String), ModelErrors> {
    let fail = |code, message: String, help: &str| -> ModelErrors {
        let error = Diagnostic::new(code, "extends", message).help(help);
        Diagnostic { location: location(target.span, sources), ..error }.into()
    };
    let Some(path) = target.text() else {
        let message = format!("`extends` is {}; expected a path as text", target.kind());
        return Err(fail(Code::WrongType, message, ""));
    };
    let absolute = path.starts_with('/') || path.contains(['\\', ':', '\0']);
    if absolute || path.is_empty() {
        let message = format!("`extends` is {path:?}; expected a relative path with `/`");
        let help = "name a model beside this one, such as \"../other/model.toml\"";
        return Err(fail(Code::Extends, message, help));
    }
    let name = relative_path(from, path);
    let chain = || {
        let names = sources.iter().map(|s| s.name.as_str());
        names.chain([name.as_str()]).collect::<Vec<_>>().join(" → ")
    };
    if sources.iter().any(|s| relative_path("", &s.name) == name) {
        let message = format!("files extend each other in a circle: {}", chain());
        return Err(fail(Code::ExtendsCircle, message, "let one of them stand by itself"));
    }
    if sources.len() > limits::EXTENDS_DEPTH {
        let most = limits::EXTENDS_DEPTH;
        let message = format!("more than {most} files extend each other: {}", chain());
        return Err(fail(Code::ExtendsCircle, message, "merge some of them into one"));
    }
    match resolver(&name) {
        Ok(text) => Ok((text, Syntax::of_file(&name), name)),
        Err(reason) => {
            let reason = reason.lines().next().unwrap_or_default();
            let message = format!("`extends` names `{name}`, which cannot be read: {reason}");
            let help = "the path is relative to this file and stays in the tree of model folders";
            Err(fail(Code::Extends, message, help))
        }
    }
}

/// `path` as seen from the folder of file `from`, without `.` and inner `..`.
pub(super) fn relative_path(from: &str, path: &str) -> String {
    let folder = from.rsplit_once('/').map_or("", |(folder, _)| folder);
    let root = if folder.starts_with('/') || (folder.is_empty() && from.starts_with('/')) {
        "/"
    } else {
        ""
    };
    let mut parts: Vec<&str> = Vec::new();
    for part in folder.split('/').chain(path.split('/')) {
        match part {
            "" | "." => {}
            ".." if parts.last().is_some_and(|&last| last != "..") => {
                parts.pop();
            }
            part => parts.push(part),
        }
    }
    format!("{root}{}", parts.join("/"))
}

/// Lays `over` on `base`, which have the shape: tables are merged field by field, everything else is replaced. A table
/// that states another `type` replaces the old one, whose fields would not fit, and a field those that
/// state the same in another way.
pub(super) fn merge(base: &mut Node, over: Node, shape: Option<&Shape>) {
    let type_of = |node: &Node| node.field("type").and_then(Node::text).map(str::to_owned);
    let retyped = type_of(&over).is_some_and(|new| type_of(base).is_some_and(|old| old != new));
    let guide = if over.field("type").is_some() { &over } else { &*base };
    let names = over.table().into_iter().flat_map(Table::keys);
    let shapes: Vec<_> =
        names.map(|name| inner(shape?, guide, &Step::Field(name.clone()))).collect();
    let of_fields = shape.is_some_and(|shape| !matches!(fitting(shape, guide), Shape::Map(_)));
    match (&mut base.value, over.value) {
        (Value::Table(fields), Value::Table(new)) if !retyped => {
            if of_fields {
                // Of fields that are not known nothing is said in their place.
                let known = new.keys().zip(&shapes).filter(|(_, shape)| shape.is_some());
                let others = known.flat_map(|(name, _)| other_ways(name));
                others.for_each(|other| drop(fields.shift_remove(other)));
            }
            for ((name, entry), shape) in new.into_iter().zip(shapes) {
                checkpoint(NAMED);
                match fields.get_mut(&name) {
                    Some(old) => {
                        old.key = entry.key;
                        merge(&mut old.node, entry.node, shape);
                    }
                    None => {
                        fields.insert(name, entry);
                    }
                }
            }
        }
        (_, value) => base.value = value,
    }
    base.span = over.span;
}

/// Removes the items with `enabled = false`, and what is stated of their start.
pub(super) fn without_disabled(mut root: Node) -> Node {
    for collection in COLLECTIONS {
        let Some(items) = root.table_mut(collection) else { continue };
        let removed = retain_enabled(items);
        if collection == "bodies" {
            let shapes = items.values_mut().filter_map(|body| body.node.table_mut("shapes"));
            shapes.for_each(|shapes| drop(retain_enabled(shapes)));
        }
        let Some(initial) = root.field_mut("initial").filter(|_| !removed.is_empty()) else {
            continue;
        };
        for (field, _) in INITIAL.iter().filter(|(_, of)| *of == collection) {
            if let Some(stated) = initial.table_mut(field) {
                // What is set from outside is not dropped without a word.
                let is_set = |node: &Node| {
                    let inside = node.table().into_iter().flat_map(Table::values);
                    node.span == Span::SET || inside.map(|e| e.node.span).any(|s| s == Span::SET)
                };
                stated.retain(|name, entry| is_set(&entry.node) || !removed.contains(name));
            }
        }
    }
    root
}

/// Removes items, and returns their names. Those of which nothing else is stated stay, for the check of fields: there is
/// nothing that they switch off.
fn retain_enabled(items: &mut Table) -> IndexSet<String> {
    let mut removed = IndexSet::new();
    items.retain(|name, entry| {
        let enabled = entry.node.field("enabled").map(|node| &node.value);
        let alone = matches!(&entry.node.value, Value::Table(fields) if fields.len() == 1);
        let stays = alone || !matches!(enabled, Some(Value::Bool(false)));
        if !stays {
            removed.insert(name.clone());
        }
        stays
    });
    removed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_seen_from_the_folder_of_the_file() {
        for (from, path, expected) in [
            ("models/a/model.toml", "../b/model.toml", "models/b/model.toml"),
            ("model.toml", "base.toml", "base.toml"),
            ("model.toml", "../x/./base.toml", "../x/base.toml"),
            ("/m/a/model.toml", "../../../b.toml", "/../b.toml"),
            ("a/b.toml", "../../c.toml", "../c.toml"),
        ] {
            assert_eq!(relative_path(from, path), expected, "{from} {path}");
        }
    }
}
