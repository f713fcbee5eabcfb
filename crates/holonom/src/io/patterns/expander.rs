//! Patterns written out, and laid out with what is stated beside them.

use std::cell::Cell;

use indexmap::IndexMap;

use super::indices::{Indices, at};
use super::row::{Row, Trouble, size};
use super::{CHANNELS, Expanded, Key, Made, Origin, SECTIONS};
use crate::error::{Code, Diagnostic};
use crate::io::expression::Fault;
use crate::io::limits;
use crate::io::merge::merge;
use crate::io::names::suggest;
use crate::io::parameters::Parameters;
use crate::io::shape::item_shape;
use crate::io::tree::{Entry, Node, Span, Table, Value, join};
use crate::watch::{NAMED, checkpoint};

/// Writes patterns out.
pub(super) struct Expander {
    pub(super) parameters: Parameters,
    /// Whether a parameter without a value was asked for: what follows from it is not reported.
    pub(super) broken: Cell<bool>,
    /// What is written, by section.
    made: [Table; SECTIONS.len()],
    channels: Vec<(Node, Origin)>,
    /// Values written so far, as limits count them.
    values: usize,
    pub(super) out: Expanded,
}

/// The table that `path` leads to.
pub(super) fn table_at<'a>(table: &'a mut Table, path: &[&str]) -> Option<&'a mut Table> {
    path.iter().try_fold(table, |table, field| match &mut table.get_mut(*field)?.node.value {
        Value::Table(table) => Some(table),
        _ => None,
    })
}

/// The table that `path` leads to, made where nothing is stated yet.
fn table_for<'a>(table: &'a mut Table, path: &[&str]) -> Option<&'a mut Table> {
    path.iter().try_fold(table, |table, field| {
        let empty = || Node { value: Value::Table(Table::new()), span: Span::SET };
        let entry = table
            .entry((*field).to_owned())
            .or_insert_with(|| Entry { key: Span::SET, node: empty() });
        match &mut entry.node.value {
            Value::Table(table) => Some(table),
            _ => None,
        }
    })
}

impl Expander {
    /// With nothing written yet.
    pub(super) fn new(parameters: Parameters) -> Self {
        Self {
            parameters,
            broken: Cell::new(false),
            made: SECTIONS.map(|_| Table::new()),
            channels: Vec::new(),
            values: 0,
            out: Expanded {
                root: Node { value: Value::Bool(false), span: Span::SET },
                errors: Vec::new(),
                origins: IndexMap::new(),
                patterns: Vec::new(),
                templates: Vec::new(),
                keys: Vec::new(),
            },
        }
    }

    pub(super) fn refuse(
        &mut self,
        code: Code,
        path: &str,
        message: String,
        help: impl Into<String>,
    ) {
        self.out.errors.push(Diagnostic::new(code, path, message).help(help));
    }

    /// Why something of a pattern has no value, with the repetition at which it was found.
    pub(super) fn report(
        &mut self,
        path: &str,
        code: Code,
        fault: Fault,
        names: &[String],
        row: &[i64],
    ) {
        let at = if row.is_empty() { String::new() } else { format!(" ({})", at(names, row)) };
        match fault {
            _ if self.broken.get() => {} // reported at the parameter
            Fault::Other(message, help) => {
                self.refuse(code, path, format!("`{path}`: {message}{at}"), help);
            }
            Fault::Unknown(name) => {
                let what = "neither a parameter nor an index of the pattern";
                let message = format!("`{path}` uses `{name}`, which is {what}{at}");
                let known = names.iter().map(String::as_str).chain(self.parameters.names());
                let help = suggest(&self.out.errors, &name, "names", known);
                self.refuse(Code::UnknownName, path, message, help);
            }
        }
    }

    pub(super) fn patterns(&mut self, file: &mut Table) {
        let Some(patterns) = table_at(file, &["patterns"]) else { return };
        let is_off = |entry: &Entry| {
            let enabled = entry.node.field("enabled").map(|node| &node.value);
            matches!(enabled, Some(Value::Bool(false)))
        };
        for (name, entry) in &mut *patterns {
            let off = is_off(entry);
            let path = join("patterns", name);
            let Value::Table(pattern) = &mut entry.node.value else { continue };
            let mut repeated = Vec::new();
            for (section, place) in SECTIONS.iter().enumerate() {
                if let Some(items) = table_at(pattern, place) {
                    repeated.push((section, std::mem::take(items)));
                }
            }
            let first_key = self.out.keys.len();
            for (section, items) in &repeated {
                self.out.keys.extend(items.keys().map(|text| Key {
                    section: *section,
                    text: text.clone(),
                    pattern: path.clone(),
                    made: if off { Made::Off } else { Made::Broken }, // until they are made
                }));
            }
            if off {
                continue;
            }
            let (first, last) = (CHANNELS[0], CHANNELS[1]);
            let channels = match table_at(pattern, &[first]).and_then(|table| table.get_mut(last)) {
                Some(Entry { node: Node { value: Value::List(list), .. }, .. }) => {
                    std::mem::take(list)
                }
                _ => Vec::new(),
            };
            self.broken.set(false);
            let Some(indices) = self.indices(&path, pattern) else { continue };
            self.repeat(indices, &repeated, first_key, &channels);
        }
        patterns.retain(|_, entry| !is_off(entry));
    }

    fn repeat(
        &mut self,
        indices: Indices,
        repeated: &[(usize, Table)],
        mut first_key: usize,
        channels: &[Node],
    ) {
        let count = indices.len();
        let path = indices.path.clone();
        let items = repeated.iter().flat_map(|(_, items)| items.values());
        let sizes = items.map(|entry| &entry.node).chain(channels).map(size).sum::<usize>();
        // Before the work; what expressions grow to is counted as it is written.
        if self.values.saturating_add(sizes.saturating_mul(count)) > limits::REPEATED_VALUES {
            self.refuse_size(&path);
            return;
        }
        let pattern = self.out.patterns.len();
        for (section, items) in repeated {
            let (section, place) = (*section, SECTIONS[*section].join("."));
            let keys = first_key..first_key + items.len();
            first_key = keys.end;
            if self.made[section].len() + items.len() * count > limits::ITEMS {
                let most = limits::ITEMS;
                let message =
                    format!("with `{path}` there are more than {most} items in `{place}`");
                self.refuse(Code::TooLarge, &path, message, "");
                continue;
            }
            let first = self.out.templates.len();
            let below = format!("{path}.{place}");
            self.out.templates.extend(items.keys().map(|key| join(&below, key)));
            let mut failed = vec![false; items.len()];
            for row in 0..count {
                for (k, (key, entry)) in items.iter().enumerate() {
                    if failed[k] {
                        continue;
                    }
                    let origin = Origin { template: first + k, pattern, row };
                    failed[k] = !self.item(&indices, section, &place, (key, entry), origin);
                }
            }
            for (key, _) in self.out.keys[keys].iter_mut().zip(failed).filter(|(_, failed)| !failed)
            {
                key.made = Made::All(pattern);
            }
        }
        let first = self.out.templates.len();
        let place = format!("{path}.{}", CHANNELS.join("."));
        self.out.templates.extend((0..channels.len()).map(|k| format!("{place}[{k}]")));
        for row in 0..count {
            for (k, channel) in channels.iter().enumerate() {
                let origin = Origin { template: first + k, pattern, row };
                let values = self.row(&indices, row);
                match values.node(channel) {
                    Ok(node) if self.counts(&node, &path) => self.channels.push((node, origin)),
                    Ok(_) => {}
                    Err(Trouble { code, fault, .. }) => {
                        let path = self.out.templates[origin.template].clone();
                        self.report(&path, code, fault, &indices.names, indices.row(row));
                        self.out.patterns.push(indices);
                        return;
                    }
                }
            }
        }
        self.out.patterns.push(indices);
    }

    fn refuse_size(&mut self, path: &str) {
        let most = limits::REPEATED_VALUES;
        let message = format!("`{path}` and the patterns before it write more than {most} values");
        self.refuse(Code::TooLarge, path, message, "repeat less, or keep long lists in a table");
    }

    /// Counts what is written; `false` where it is too much, which is said once.
    fn counts(&mut self, node: &Node, path: &str) -> bool {
        let before = self.values;
        self.values = before.saturating_add(size(node));
        let fits = self.values <= limits::REPEATED_VALUES;
        if !fits && before <= limits::REPEATED_VALUES {
            self.refuse_size(path);
        }
        fits
    }

    fn row<'a>(&'a self, indices: &'a Indices, row: usize) -> Row<'a> {
        let Indices { names, .. } = indices;
        let (parameters, broken) = (&self.parameters, &self.broken);
        Row { parameters, broken, names, values: indices.row(row) }
    }

    /// Writes one item; `false` when it cannot be written.
    fn item(
        &mut self,
        indices: &Indices,
        section: usize,
        place: &str,
        (key, entry): (&str, &Entry),
        origin: Origin,
    ) -> bool {
        checkpoint(size(&entry.node) * NAMED);
        let values = self.row(indices, origin.row);
        let trouble = |fault| Trouble { path: String::new(), code: Code::Expression, fault };
        let made =
            values.name(key).map_err(trouble).and_then(|n| Ok((n, values.node(&entry.node)?)));
        let template = |this: &Self| this.out.templates[origin.template].clone();
        let (name, node) = match made {
            Ok(made) if !self.broken.get() => made,
            Ok(_) => return false,
            Err(Trouble { path, code, fault }) => {
                let dot = if path.is_empty() { "" } else { "." };
                let path = template(self) + dot + &path;
                self.report(&path, code, fault, &indices.names, indices.row(origin.row));
                return false;
            }
        };
        if !self.counts(&node, &indices.path) {
            return false;
        }
        let path = join(place, &name);
        if let Some(&other) = self.out.origins.get(&path) {
            let (first, template) = (&self.out.templates[other.template], template(self));
            let first_at = self.out.patterns.get(other.pattern).unwrap_or(indices).at(other.row);
            let message = format!(
                "`{template}` at {} makes `{path}`, which `{first}` made at {first_at}",
                indices.at(origin.row)
            );
            let help = "let the name tell all indices, such as `link_{i}_{j}`";
            self.refuse(Code::DuplicateName, &template, message, help);
            return false;
        }
        self.out.origins.insert(path, origin);
        self.made[section].insert(name, Entry { key: entry.key, node });
        true
    }

    /// Puts what was written into the file.
    pub(super) fn lay_out(&mut self, file: &mut Table) {
        for (place, made) in SECTIONS.iter().zip(&mut self.made) {
            if made.is_empty() {
                continue;
            }
            // What is no table is reported by the check.
            let Some(items) = table_for(file, place) else { continue };
            let shape = item_shape(place);
            let mut made = std::mem::take(made);
            for (name, entry) in std::mem::take(items) {
                match made.get_mut(&name) {
                    Some(base) => {
                        base.key = entry.key;
                        merge(&mut base.node, entry.node, shape);
                    }
                    None => {
                        items.insert(name, entry);
                    }
                }
            }
            items.extend(made);
        }
        if self.channels.is_empty() {
            return;
        }
        let Some(outputs) = table_for(file, &CHANNELS[..1]) else { return };
        let empty = Node { value: Value::List(Vec::new()), span: Span::SET };
        let entry = outputs
            .entry(CHANNELS[1].to_owned())
            .or_insert_with(|| Entry { key: Span::SET, node: empty });
        if let Value::List(list) = &mut entry.node.value {
            for (node, origin) in self.channels.drain(..) {
                self.out.origins.insert(format!("{}[{}]", CHANNELS.join("."), list.len()), origin);
                list.push(node);
            }
        }
    }
}
