//! The files of meshes: what they hold is put in the place of their names, so that a model, and a result
//! with it, needs no other file.

use super::limits;
use super::merge::relative_path;
use super::stl::triangles;
use super::tree::{Entry, Node, Source, Span, Table, Value, join, location};
use crate::error::{Code, Diagnostic, ModelErrors};

/// Reads a file by its path.
pub(super) type Reader<'a> = dyn FnMut(&str) -> Result<Vec<u8>, String> + 'a;

/// Puts the triangles of every mesh into the tree, patterns included.
pub(super) fn put_in(
    root: &mut Node,
    sources: &[Source],
    reader: &mut Reader<'_>,
) -> Result<(), ModelErrors> {
    let mut work = Work { sources, reader, errors: Vec::new() };
    let Value::Table(file) = &mut root.value else { return Ok(()) };
    work.bodies(file, "");
    if let Some(Entry { node: Node { value: Value::Table(patterns), .. }, .. }) =
        file.get_mut("patterns")
    {
        for (name, pattern) in patterns {
            if let Value::Table(pattern) = &mut pattern.node.value {
                work.bodies(pattern, &join("patterns", name));
            }
        }
    }
    if work.errors.is_empty() {
        return Ok(());
    }
    let omitted = work.errors.len().saturating_sub(limits::ERRORS_SHOWN);
    work.errors.truncate(limits::ERRORS_SHOWN);
    Err(ModelErrors { errors: work.errors, omitted })
}

struct Work<'a, 'b> {
    sources: &'a [Source],
    reader: &'a mut Reader<'b>,
    errors: Vec<Diagnostic>,
}

impl Work<'_, '_> {
    fn bodies(&mut self, holder: &mut Table, path: &str) {
        let Some(bodies) = tables(holder, "bodies") else { return };
        let path = join(path, "bodies");
        for (name, body) in bodies {
            let Value::Table(body) = &mut body.node.value else { continue };
            let Some(shapes) = tables(body, "shapes") else { continue };
            let path = join(&join(&path, name), "shapes");
            for (name, shape) in shapes {
                if let Value::Table(shape) = &mut shape.node.value {
                    self.shape(shape, &join(&path, name));
                }
            }
        }
    }

    fn shape(&mut self, shape: &mut Table, path: &str) {
        let is_mesh = shape.get("type").and_then(|entry| entry.node.text()) == Some("mesh");
        let is_off = matches!(shape.get("enabled"), Some(entry) if matches!(entry.node.value, Value::Bool(false)));
        let is_given = shape.contains_key("vertices") || shape.contains_key("faces");
        let Some(Entry { node, .. }) =
            shape.get("file").filter(|_| is_mesh && !is_off && !is_given)
        else {
            return;
        };
        // What is no text, or a name that a pattern makes, is refused where the shape is read.
        let Some(name) = node.text().filter(|name| !name.contains('{')) else { return };
        let span = node.span;
        let from = self.sources.get(span.file).map_or("", |source| source.name.as_str());
        match self.read(from, name) {
            Ok((vertices, faces)) => {
                let put = |table: &mut Table, name: &str, value: Vec<Node>| {
                    let node = Node { value: Value::List(value), span };
                    table.insert(name.to_owned(), Entry { key: span, node });
                };
                put(shape, "vertices", rows(vertices, span));
                put(shape, "faces", rows(faces, span));
                shape.shift_remove("file");
            }
            Err(reason) => {
                let path = join(path, "file");
                let reason = reason.lines().next().unwrap_or_default();
                let message = format!("`{path}` names `{name}`, which cannot be read: {reason}");
                let help = "the path is relative to this file; triangles are read from STL files";
                let error = Diagnostic::new(Code::Mesh, &path, message).help(help);
                self.errors.push(Diagnostic { location: location(span, self.sources), ..error });
            }
        }
    }

    fn read(&mut self, from: &str, name: &str) -> Result<(Vec<[f64; 3]>, Vec<[f64; 3]>), String> {
        if name.starts_with('/') || name.contains(['\\', ':', '\0']) || name.is_empty() {
            return Err("it is no relative path with `/`".to_owned());
        }
        let bytes = (self.reader)(&relative_path(from, name))?;
        if bytes.len() > limits::MESH_BYTES {
            let (size, most) = (bytes.len() >> 20, limits::MESH_BYTES >> 20);
            return Err(format!("it has {size} MB; a mesh has at most {most}"));
        }
        let found = triangles(&bytes, limits::MESH_TRIANGLES)?;
        Ok((found.vertices, found.faces.iter().map(|face| face.map(|i| i as f64)).collect()))
    }
}

fn tables<'a>(holder: &'a mut Table, name: &str) -> Option<&'a mut Table> {
    match &mut holder.get_mut(name)?.node.value {
        Value::Table(table) => Some(table),
        _ => None,
    }
}

fn rows(rows: Vec<[f64; 3]>, span: Span) -> Vec<Node> {
    let number = |x: f64| Node { value: Value::Number(x), span };
    rows.into_iter().map(|row| Node { value: Value::List(row.map(number).into()), span }).collect()
}
