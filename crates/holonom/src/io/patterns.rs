//! Patterns: items that are written once and repeated over indices. They are written out here, so
//! that everything after sees a plain file; numbers keep their expressions, with the index put in.

use std::cell::Cell;
use std::collections::BTreeMap;

use indexmap::IndexMap;

use super::expression::{Fault, evaluate, filled, is_name, with_numbers};
use super::limits;
use super::merge::merge;
use super::names::{objection, suggest};
use super::tree::{Entry, Node, Span, Step, Table, Value, join, node_at, parse_path, path_of};
use crate::error::{Code, Diagnostic};
use crate::watch::{NAMED, checkpoint};

/// Tables of items that patterns repeat: the same path in a pattern and in the file.
const SECTIONS: [&[&str]; 7] = [
    &["bodies"],
    &["joints"],
    &["forces"],
    &["drivers"],
    &["tables"],
    &["initial", "bodies"],
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
}

#[derive(Clone, Copy)]
struct Origin {
    template: usize,
    pattern: usize,
    row: usize,
}

/// The indices of a pattern and all their values, row by row.
struct Indices {
    path: String,
    names: Vec<String>,
    rows: Vec<i64>,
}

impl Indices {
    fn len(&self) -> usize {
        self.rows.len() / self.names.len().max(1)
    }

    fn row(&self, row: usize) -> &[i64] {
        &self.rows[row * self.names.len()..][..self.names.len()]
    }

    /// `i = 7, j = 2`
    fn at(&self, row: usize) -> String {
        at(&self.names, self.row(row))
    }
}

fn at(names: &[String], row: &[i64]) -> String {
    let values = names.iter().zip(row).map(|(name, value)| format!("{name} = {value}"));
    values.collect::<Vec<_>>().join(", ")
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
}

/// Parameters by name; `None` where the value is no number, which is reported at its place.
pub(super) fn parameters(root: &Node) -> BTreeMap<String, Option<f64>> {
    let table = root.field("parameters").and_then(Node::table);
    let value = |node: &Node| match node.field("value")?.value {
        Value::Number(x) => Some(x),
        _ => None,
    };
    table.into_iter().flatten().map(|(name, entry)| (name.clone(), value(&entry.node))).collect()
}

/// Writes out the patterns of a file. Plainly stated items come first, then those of the patterns;
/// what is stated plainly under the name of a repeated item is laid over it.
pub(super) fn expand(mut root: Node) -> Expanded {
    let mut expander = Expander {
        parameters: parameters(&root),
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
        },
    };
    if let Value::Table(file) = &mut root.value {
        expander.patterns(file);
        expander.lay_out(file);
    }
    expander.out.root = root;
    expander.out
}

struct Expander {
    parameters: BTreeMap<String, Option<f64>>,
    /// Whether a parameter without a value was asked for: what follows from it is not reported.
    broken: Cell<bool>,
    /// What is written, by section.
    made: [Table; SECTIONS.len()],
    channels: Vec<(Node, Origin)>,
    values: usize,
    out: Expanded,
}

/// Why something cannot be repeated: the path below the item, and the reason.
struct Trouble {
    path: String,
    code: Code,
    fault: Fault,
}

/// Names with a value at one repetition.
struct Row<'a> {
    parameters: &'a BTreeMap<String, Option<f64>>,
    broken: &'a Cell<bool>,
    names: &'a [String],
    values: &'a [i64],
}

impl Row<'_> {
    fn index(&self, name: &str) -> Option<i64> {
        self.names
            .iter()
            .zip(self.values)
            .find(|(known, _)| *known == name)
            .map(|(_, value)| *value)
    }

    fn value(&self, name: &str) -> Option<f64> {
        if let Some(index) = self.index(name) {
            return Some(index as f64);
        }
        let value = *self.parameters.get(name)?;
        self.broken.set(self.broken.get() || value.is_none());
        Some(value.unwrap_or(1.0))
    }

    fn name(&self, text: &str) -> Result<String, Fault> {
        if !text.contains(['{', '}']) {
            return Ok(text.to_owned());
        }
        filled(text, &mut |name| self.value(name))
    }

    fn text(&self, text: &str) -> Result<String, Fault> {
        let text = self.name(text)?;
        Ok(match text.strip_prefix('=') {
            Some(expression) if !self.parameters.contains_key(expression.trim()) => {
                "=".to_owned() + &with_numbers(expression, &|name| self.index(name))
            }
            _ => text,
        })
    }

    fn node(&self, node: &Node) -> Result<Node, Trouble> {
        let fail = |fault| Trouble { path: String::new(), code: Code::Expression, fault };
        let below = |step: Step| {
            move |mut trouble: Trouble| {
                let dot =
                    if trouble.path.is_empty() || trouble.path.starts_with('[') { "" } else { "." };
                trouble.path = path_of(&[step]) + dot + &trouble.path;
                trouble
            }
        };
        let value = match &node.value {
            Value::Text(text) => Value::Text(self.text(text).map_err(fail)?),
            Value::List(list) => {
                let entries = list.iter().enumerate();
                let filled = entries.map(|(i, n)| self.node(n).map_err(below(Step::Index(i))));
                Value::List(filled.collect::<Result<_, _>>()?)
            }
            Value::Table(table) => {
                let mut out = Table::with_capacity(table.len());
                for (key, entry) in table {
                    let step = || below(Step::Field(key.clone()));
                    let name = self.name(key).map_err(fail).map_err(step())?;
                    let node = self.node(&entry.node).map_err(step())?;
                    if out.contains_key(&name) {
                        let message = format!("the name `{name}` is made twice");
                        let fault = Fault::Other(message, String::new());
                        let path = String::new();
                        return Err(step()(Trouble { path, code: Code::DuplicateName, fault }));
                    }
                    out.insert(name, Entry { key: entry.key, node });
                }
                Value::Table(out)
            }
            plain => plain.clone(),
        };
        Ok(Node { value, span: node.span })
    }
}

/// Values of a part of the tree, as limits count them.
fn size(node: &Node) -> usize {
    1 + match &node.value {
        Value::Text(text) => text.len() / 64,
        Value::List(list) => list.iter().map(size).sum(),
        Value::Table(table) => {
            table.iter().map(|(key, entry)| key.len() / 64 + size(&entry.node)).sum()
        }
        _ => 0,
    }
}

/// The table that `path` leads to.
fn table_at<'a>(table: &'a mut Table, path: &[&str]) -> Option<&'a mut Table> {
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
    fn refuse(&mut self, code: Code, path: &str, message: String, help: impl Into<String>) {
        self.out.errors.push(Diagnostic::new(code, path, message).help(help));
    }

    /// Why something of a pattern has no value, with the repetition at which it was found.
    fn report(&mut self, path: &str, code: Code, fault: Fault, names: &[String], row: &[i64]) {
        let at = if row.is_empty() { String::new() } else { format!(" ({})", at(names, row)) };
        match fault {
            _ if self.broken.get() => {} // reported at the parameter
            Fault::Other(message, help) => {
                self.refuse(code, path, format!("`{path}`: {message}{at}"), help);
            }
            Fault::Unknown(name) => {
                let what = "neither a parameter nor an index of the pattern";
                let message = format!("`{path}` uses `{name}`, which is {what}{at}");
                let known = names.iter().chain(self.parameters.keys()).map(String::as_str);
                let help = suggest(&self.out.errors, &name, "names", known);
                self.refuse(Code::UnknownName, path, message, help);
            }
        }
    }

    fn patterns(&mut self, file: &mut Table) {
        let Some(patterns) = table_at(file, &["patterns"]) else { return };
        patterns.retain(|_, entry| {
            let enabled = entry.node.field("enabled").map(|node| &node.value);
            !matches!(enabled, Some(Value::Bool(false)))
        });
        for (name, entry) in patterns {
            let path = join("patterns", name);
            let Value::Table(pattern) = &mut entry.node.value else { continue };
            let mut repeated = Vec::new();
            for (section, place) in SECTIONS.iter().enumerate() {
                if let Some(items) = table_at(pattern, place) {
                    repeated.push((section, std::mem::take(items)));
                }
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
            self.repeat(indices, &repeated, &channels);
        }
    }

    /// Names and values of the indices. `None` when something is wrong with them; what the schema
    /// finds is left to the check.
    fn indices(&mut self, path: &str, pattern: &mut Table) -> Option<Indices> {
        let path_over = join(path, "over");
        let over = table_at(pattern, &["over"])?;
        let mut names: Vec<String> = Vec::new();
        let mut rows: Vec<Vec<i64>> = vec![Vec::new()];
        if over.is_empty() || over.len() > limits::INDICES {
            let message = format!("`{path_over}` has {} indices", over.len());
            let help =
                format!("one to {}, such as `over.i = {{ from = 1, to = 50 }}`", limits::INDICES);
            self.refuse(Code::OutOfRange, &path_over, message, help);
            return None;
        }
        let mut fine = true;
        for (name, entry) in over {
            let at = join(&path_over, name);
            let taken = self.parameters.contains_key(name);
            if taken || !is_name(name) || objection(name).is_some() {
                let message = if taken {
                    format!("the index `{name}` of `{path}` has the name of a parameter")
                } else {
                    format!("`{name}` cannot be the name of an index")
                };
                let help = "take a letter, such as i, or letters, digits and `_`";
                self.refuse(Code::BadName, &at, message, help);
                fine = false;
                continue;
            }
            let Value::Table(range) = &mut entry.node.value else { return None };
            let mut bounds = Vec::new();
            for field in ["from", "to"] {
                let bound = &mut range.get_mut(field)?.node.value;
                let stated = match bound {
                    Value::Number(x) => Bound::Number(*x),
                    Value::Text(text) => Bound::Expression(text.strip_prefix('=')?.to_owned()),
                    _ => return None,
                };
                *bound = Value::Number(1.0); // the check need not know expressions of indices
                bounds.push(stated);
            }
            if fine {
                rows = self.further(&at, &names, rows, &bounds)?;
            }
            names.push(name.clone());
        }
        if rows.len() > limits::REPETITIONS {
            return None;
        }
        fine.then(|| Indices { path: path.to_owned(), names, rows: rows.concat() })
    }

    /// The rows with one more index.
    fn further(
        &mut self,
        path: &str,
        names: &[String],
        rows: Vec<Vec<i64>>,
        bounds: &[Bound],
    ) -> Option<Vec<Vec<i64>>> {
        let mut out = Vec::new();
        for row in rows {
            let mut ends = [0i64; 2];
            for ((end, bound), field) in ends.iter_mut().zip(bounds).zip(["from", "to"]) {
                *end = self.bound(&join(path, field), bound, names, &row)?;
            }
            let [from, to] = ends;
            let at = if row.is_empty() { String::new() } else { format!(" ({})", at(names, &row)) };
            if to < from - 1 {
                let message =
                    format!("`{path}` goes from {from} to {to}{at}; expected `to` from `from` on");
                let help = "`to` one below `from` repeats nothing";
                self.refuse(Code::OutOfRange, &join(path, "to"), message, help);
                return None;
            }
            if out.len() + (to - from + 1) as usize > limits::REPETITIONS {
                let most = limits::REPETITIONS;
                let message = format!(
                    "`{path}` goes from {from} to {to}{at}: the pattern is repeated more than {most} times"
                );
                self.refuse(
                    Code::TooLarge,
                    &join(path, "to"),
                    message,
                    "look for a slip in the range",
                );
                return None;
            }
            out.extend(
                (from..=to).map(|index| row.iter().copied().chain([index]).collect::<Vec<_>>()),
            );
        }
        Some(out)
    }

    fn bound(&mut self, path: &str, bound: &Bound, names: &[String], row: &[i64]) -> Option<i64> {
        let value = match bound {
            Bound::Number(x) => Ok(*x),
            Bound::Expression(text) => {
                let (parameters, broken) = (&self.parameters, &self.broken);
                let values = Row { parameters, broken, names, values: row };
                evaluate(text, &mut |name| values.value(name))
            }
        };
        match value {
            _ if self.broken.get() => None,
            Ok(x) if x.fract() == 0.0 && x.abs() <= limits::INDEX => Some(x as i64),
            Ok(x) => {
                let at =
                    if row.is_empty() { String::new() } else { format!(" ({})", at(names, row)) };
                let message = format!("`{path}` is {x}{at}; expected a whole number up to 1e9");
                self.refuse(Code::OutOfRange, path, message, "");
                None
            }
            Err(fault) => {
                self.report(path, Code::Expression, fault, names, row);
                None
            }
        }
    }

    fn repeat(&mut self, indices: Indices, repeated: &[(usize, Table)], channels: &[Node]) {
        let count = indices.len();
        let path = indices.path.clone();
        let items = repeated.iter().flat_map(|(_, items)| items.values());
        let sizes = items.map(|entry| &entry.node).chain(channels).map(size).sum::<usize>();
        self.values = self.values.saturating_add(sizes.saturating_mul(count));
        if self.values > limits::REPEATED_VALUES {
            let most = limits::REPEATED_VALUES;
            let message =
                format!("`{path}` and the patterns before it write more than {most} values");
            self.refuse(
                Code::TooLarge,
                &path,
                message,
                "repeat less, or keep long lists in a table",
            );
            return;
        }
        let pattern = self.out.patterns.len();
        for (section, items) in repeated {
            let (section, place) = (*section, SECTIONS[*section].join("."));
            if self.made[section].len() + items.len() * count > limits::ITEMS {
                let most = limits::ITEMS;
                let message =
                    format!("with `{path}` there are more than {most} items in `{place}`");
                self.refuse(Code::TooLarge, &path, message, "");
                continue;
            }
            let first = self.out.templates.len();
            let below = join(&path, &place);
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
        }
        let first = self.out.templates.len();
        let place = join(&path, &CHANNELS.join("."));
        self.out.templates.extend((0..channels.len()).map(|k| format!("{place}[{k}]")));
        for row in 0..count {
            for (k, channel) in channels.iter().enumerate() {
                let origin = Origin { template: first + k, pattern, row };
                let values = self.row(&indices, row);
                match values.node(channel) {
                    Ok(node) => self.channels.push((node, origin)),
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
        let template = &self.out.templates[origin.template];
        let (name, node) = match made {
            Ok(made) if !self.broken.get() => made,
            Ok(_) => return false,
            Err(Trouble { path, code, fault }) => {
                let dot = if path.is_empty() { "" } else { "." };
                let path = template.clone() + dot + &path;
                self.report(&path, code, fault, &indices.names, indices.row(origin.row));
                return false;
            }
        };
        let path = join(place, &name);
        if let Some(&other) = self.out.origins.get(&path) {
            let (first, template) = (&self.out.templates[other.template], template.clone());
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
    fn lay_out(&mut self, file: &mut Table) {
        for (place, made) in SECTIONS.iter().zip(&mut self.made) {
            if made.is_empty() {
                continue;
            }
            // What is no table is reported by the check.
            let Some(items) = table_for(file, place) else { continue };
            let mut made = std::mem::take(made);
            let stated = std::mem::take(items);
            for (name, entry) in stated {
                match made.get_mut(&name) {
                    Some(base) => {
                        base.key = entry.key;
                        merge(&mut base.node, entry.node);
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

/// An end of a range.
enum Bound {
    Number(f64),
    Expression(String),
}
