//! One tree for both syntaxes: every value knows the file and the bytes it was read from, tables
//! keep the order of the file.

use indexmap::IndexMap;

use super::limits;
use crate::error::{Code, Location, shown};
use crate::watch::{NAMED, checkpoint};

/// Bytes `start..end` of source number `file`; values set by the caller have no source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Span {
    pub(super) file: usize,
    pub(super) start: usize,
    pub(super) end: usize,
}

impl Span {
    /// Of a value that no file states (`with_values`).
    pub(super) const SET: Self = Self { file: usize::MAX, start: 0, end: 0 };
}

/// A value with its place.
#[derive(Debug, Clone)]
pub(super) struct Node {
    pub(super) value: Value,
    pub(super) span: Span,
}

/// Values that model files can hold; numbers are finite.
#[derive(Debug, Clone)]
pub(super) enum Value {
    Bool(bool),
    Number(f64),
    Text(String),
    List(Vec<Node>),
    Table(Table),
}

/// Fields in file order, each with the place of its key.
pub(super) type Table = IndexMap<String, Entry>;

/// A field of a table.
#[derive(Debug, Clone)]
pub(super) struct Entry {
    pub(super) key: Span,
    pub(super) node: Node,
}

impl Node {
    pub(super) fn table(&self) -> Option<&Table> {
        match &self.value {
            Value::Table(table) => Some(table),
            _ => None,
        }
    }

    pub(super) fn text(&self) -> Option<&str> {
        match &self.value {
            Value::Text(text) => Some(text),
            _ => None,
        }
    }

    pub(super) fn field(&self, name: &str) -> Option<&Node> {
        self.table()?.get(name).map(|entry| &entry.node)
    }

    pub(super) fn field_mut(&mut self, name: &str) -> Option<&mut Node> {
        match &mut self.value {
            Value::Table(table) => table.get_mut(name).map(|entry| &mut entry.node),
            _ => None,
        }
    }

    /// The table that a field holds.
    pub(super) fn table_mut(&mut self, name: &str) -> Option<&mut Table> {
        match &mut self.field_mut(name)?.value {
            Value::Table(table) => Some(table),
            _ => None,
        }
    }

    /// What the value is, for messages.
    pub(super) fn kind(&self) -> String {
        match &self.value {
            Value::Bool(b) => format!("`{b}`"),
            Value::Number(x) => format!("the number {}", shown(*x)),
            Value::Text(t) if t.chars().count() > 40 => {
                format!("the text \"{}…\"", t.chars().take(40).collect::<String>())
            }
            Value::Text(t) => format!("the text {t:?}"),
            Value::List(list) if list.is_empty() => "an empty list".to_owned(),
            Value::List(list) => format!("a list of {}", list.len()),
            Value::Table(_) => "a table".to_owned(),
        }
    }

    /// As JSON.
    pub(super) fn to_json(&self) -> serde_json::Value {
        match &self.value {
            Value::Bool(b) => (*b).into(),
            Value::Number(x) => (*x).into(),
            Value::Text(t) => t.clone().into(),
            Value::List(list) => list.iter().map(Node::to_json).collect(),
            Value::Table(table) => serde_json::Value::Object(
                (table.iter().inspect(|_| checkpoint(NAMED)))
                    .map(|(key, entry)| (key.clone(), entry.node.to_json()))
                    .collect(),
            ),
        }
    }

    /// A value given by the caller.
    ///
    /// # Errors
    /// [`Code::UnusableValue`] where there is a null, [`Code::NotFinite`] with a number that no file may hold.
    pub(super) fn from_json(value: &serde_json::Value) -> Result<Self, Code> {
        let value = match value {
            serde_json::Value::Null => return Err(Code::UnusableValue),
            serde_json::Value::Bool(b) => Value::Bool(*b),
            serde_json::Value::Number(n) => match n.as_f64() {
                Some(x) if x.abs() <= limits::NUMBER => Value::Number(x),
                _ => return Err(Code::NotFinite),
            },
            serde_json::Value::String(t) => Value::Text(t.clone()),
            serde_json::Value::Array(list) => {
                Value::List(list.iter().map(Self::from_json).collect::<Result<_, _>>()?)
            }
            serde_json::Value::Object(map) => Value::Table(
                map.iter()
                    .map(|(key, value)| {
                        let node = Self::from_json(value)?;
                        Ok((key.clone(), Entry { key: Span::SET, node }))
                    })
                    .collect::<Result<_, Code>>()?,
            ),
        };
        Ok(Self { value, span: Span::SET })
    }
}

/// A step of a path: a field or an index.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Step {
    Field(String),
    Index(usize),
}

/// Reads `forces.front.stiffness[2]` and `patterns.chain.bodies."link_{i}".mass`; `None` when it is not
/// of this form.
pub(super) fn parse_path(path: &str) -> Option<Vec<Step>> {
    let mut steps = Vec::new();
    let mut rest = path;
    loop {
        let name = match rest.strip_prefix('"') {
            Some(quoted) => {
                let (name, tail) = unquoted(quoted)?;
                rest = tail;
                name
            }
            None => {
                let (name, tail) = rest.split_at(rest.find(['.', '[']).unwrap_or(rest.len()));
                if name.is_empty() {
                    return None;
                }
                rest = tail;
                name.to_owned()
            }
        };
        steps.push(Step::Field(name));
        while let Some(index) = rest.strip_prefix('[') {
            let (digits, tail) = index.split_once(']')?;
            steps.push(Step::Index(digits.parse().ok()?));
            rest = tail;
        }
        if rest.is_empty() {
            return Some(steps);
        }
        rest = rest.strip_prefix('.')?;
    }
}

/// The path of some steps, as `parse_path` reads it.
pub(super) fn path_of(steps: &[Step]) -> String {
    steps.iter().fold(String::new(), |path, step| match step {
        Step::Field(name) => join(&path, name),
        Step::Index(i) => format!("{path}[{i}]"),
    })
}

/// The name that begins after a quotation mark, and what comes after its end.
fn unquoted(text: &str) -> Option<(String, &str)> {
    let mut name = String::new();
    let mut characters = text.char_indices();
    while let Some((at, c)) = characters.next() {
        match c {
            '"' => return Some((name, &text[at + 1..])),
            '\\' => match characters.next()?.1 {
                'n' => name.push('\n'),
                'r' => name.push('\r'),
                't' => name.push('\t'),
                'u' => {
                    let (digits, _) = text[at + 2..].strip_prefix('{')?.split_once('}')?;
                    name.push(char::from_u32(u32::from_str_radix(digits, 16).ok()?)?);
                    characters.nth(digits.chars().count() + 1)?;
                }
                c => name.push(c),
            },
            c => name.push(c),
        }
    }
    None
}

/// Appends a field to a path; names that a path would take apart stand in quotes, those of patterns too.
pub(super) fn join(path: &str, field: &str) -> String {
    let dot = if path.is_empty() { "" } else { "." };
    let apart = |c: char| ".[]{}\"\\".contains(c) || c.is_control();
    if !field.is_empty() && !field.contains(apart) {
        return [path, dot, field].concat();
    }
    let mut out = [path, dot, "\""].concat();
    for c in field.chars() {
        if c == '"' || c == '\\' || c.is_control() {
            out.extend(c.escape_default());
        } else {
            out.push(c);
        }
    }
    out.push('"');
    out
}

/// A file that was read.
#[derive(Debug, Clone)]
pub(super) struct Source {
    pub(super) name: String,
    pub(super) text: String,
}

/// What `path` leads to, if it is written.
pub(super) fn node_at<'a>(root: &'a Node, path: &str) -> Option<&'a Node> {
    parse_path(path)?.iter().try_fold(root, |node, step| match (&node.value, step) {
        (Value::Table(table), Step::Field(name)) => table.get(name).map(|entry| &entry.node),
        (Value::List(list), Step::Index(i)) => list.get(*i),
        _ => None,
    })
}

/// Place of what `path` names: of its key, or of its value. Where the path leads to nothing written,
/// the place of the nearest table around it.
pub(super) fn span_of(root: &Node, path: &str, of_key: bool) -> Span {
    let mut span = root.span;
    let mut node = root;
    for step in parse_path(path).unwrap_or_default() {
        let found = match (&node.value, &step) {
            (Value::Table(table), Step::Field(name)) => {
                table.get(name).map(|entry| (entry.key, &entry.node))
            }
            (Value::List(list), Step::Index(i)) => list.get(*i).map(|node| (node.span, node)),
            _ => None,
        };
        let Some((key, next)) = found else { return span };
        // A table opened by a header is marked at its name: its bytes reach over many lines.
        span = if of_key || matches!(next.value, Value::Table(_)) { key } else { next.span };
        node = next;
    }
    span
}

/// Whether findings with this code are about a name rather than about its value.
pub(super) fn marks_key(code: Code) -> bool {
    matches!(code, Code::UnknownField | Code::DuplicateName | Code::BadName | Code::MissingField)
}

/// The place of a span in its source.
pub(super) fn location(span: Span, sources: &[Source]) -> Option<Location> {
    let source = sources.get(span.file)?;
    Some(Location::of(&source.name, &source.text, span.start, span.end))
}

/// The places of many spans: the lines of the sources are counted once.
pub(super) struct Places<'a> {
    sources: &'a [Source],
    /// Where lines end, by source.
    ends: Vec<Vec<usize>>,
}

impl<'a> Places<'a> {
    pub(super) fn new(sources: &'a [Source]) -> Self {
        let ends = |s: &Source| s.text.match_indices('\n').map(|(at, _)| at).collect();
        Self { sources, ends: sources.iter().map(ends).collect() }
    }

    pub(super) fn of(&self, span: Span) -> Option<Location> {
        let source = self.sources.get(span.file)?;
        let line = self.ends[span.file].partition_point(|&end| end < span.start) + 1;
        Some(Location::on_line(line, &source.name, &source.text, span.start, span.end))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test] // independent truth: the steps that the path was made of
    fn every_name_comes_back_from_a_path() {
        for name in
            ["a", "a.b", "a[0]", "link_{i - 1}", "", "q\"\\", "x\u{1b}\n\t", "é", "\u{0}u{41}"]
        {
            let steps = [
                Step::Field("joints".into()),
                Step::Field(name.into()),
                Step::Index(2),
                Step::Field("x".into()),
            ];
            assert_eq!(parse_path(&path_of(&steps)).as_deref(), Some(&steps[..]), "{name:?}");
        }
        for broken in ["", "a..b", "a.", "\"a", "a[x]", "a\"b\"[", "\"\\u{110000}\""] {
            assert!(parse_path(broken).is_none(), "{broken}");
        }
    }
}
