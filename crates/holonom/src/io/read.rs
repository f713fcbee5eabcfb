//! Text to tree, TOML or JSON.

use jsonc_parser::ast;
use jsonc_parser::errors::ParseErrorKind;
use toml::de::{DeTable, DeValue};

use super::limits;
use super::tree::{Entry, Node, Span, Table, Value, join};
use crate::error::{Code, Diagnostic, Location, ModelErrors, printable};
use crate::watch::{NAMED, checkpoint};

/// Syntax of a model file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Syntax {
    /// TOML 1.0 (the usual one).
    Toml,
    /// JSON.
    Json,
}

impl Syntax {
    /// By the ending of a file name: `.json` is JSON, everything else TOML.
    pub fn of_file(name: &str) -> Self {
        let is_json = name.rsplit_once('.').is_some_and(|(_, e)| e.eq_ignore_ascii_case("json"));
        if is_json { Self::Json } else { Self::Toml }
    }
}

/// Reads source number `file`.
pub(super) fn read(
    source: &super::tree::Source,
    syntax: Syntax,
    file: usize,
) -> Result<Node, ModelErrors> {
    let text = source.text.as_str();
    if text.len() > limits::FILE_BYTES {
        let (size, most) = (text.len() >> 20, limits::FILE_BYTES >> 20);
        let message = format!("`{}` has {size} MB; a model file has at most {most}", source.name);
        return Err(Diagnostic::new(Code::TooLarge, "", message)
            .help("keep results and long records in files of their own")
            .into());
    }
    let mut reader = Reader { source, file, errors: Vec::new(), omitted: 0 };
    let value = match syntax {
        Syntax::Toml => reader.toml(text),
        Syntax::Json => reader.json(text),
    };
    match value {
        Some(value) if reader.errors.is_empty() => {
            Ok(Node { value, span: Span { file, start: 0, end: 0 } })
        }
        _ => Err(ModelErrors { errors: reader.errors, omitted: reader.omitted }),
    }
}

struct Reader<'a> {
    source: &'a super::tree::Source,
    file: usize,
    errors: Vec<Diagnostic>,
    omitted: usize,
}

impl Reader<'_> {
    fn span(&self, start: usize, end: usize) -> Span {
        Span { file: self.file, start, end }
    }

    fn refuse(&mut self, span: Span, error: Diagnostic) {
        if self.errors.len() >= limits::ERRORS_SHOWN {
            self.omitted += 1;
            return;
        }
        let Span { start, end, .. } = span;
        let location = Some(Location::of(&self.source.name, &self.source.text, start, end));
        let path = printable(&error.path);
        self.errors.push(Diagnostic { path, location, ..error });
    }

    fn toml(&mut self, text: &str) -> Option<Value> {
        let (table, errors) = DeTable::parse_recoverable(text);
        // After one error of syntax the rest is guesswork; repeated keys are all real.
        let mut broken = false;
        for error in &errors {
            let at = error.span().unwrap_or(0..0);
            let message = error.message().trim().replace('\n', ", ");
            let span = self.span(at.start, at.end);
            let key = text.get(at).unwrap_or_default().trim_matches(['"', '\'']);
            if message.contains("duplicate key") {
                let message = format!("`{key}` is written twice");
                let error = Diagnostic::new(Code::DuplicateName, key, message);
                self.refuse(span, error.help("give each item and each field once, under one name"));
            } else if !broken {
                broken = true;
                let error = if message.contains("recurs") {
                    too_deep("")
                } else {
                    Diagnostic::new(Code::Syntax, "", format!("not valid TOML: {message}"))
                        .help("texts stand in quotes, lists in [ ], tables in { } on one line")
                };
                self.refuse(span, error);
            }
        }
        if !errors.is_empty() {
            return None;
        }
        Some(self.toml_table(table.into_inner(), "", 1))
    }

    fn toml_table(&mut self, table: DeTable<'_>, path: &str, depth: usize) -> Value {
        // The parser sorts fields by name; their places give back the order of the file.
        let mut fields: Vec<_> = table.into_iter().collect();
        fields.sort_by_key(|(key, _)| key.span().start);
        let mut out = Table::with_capacity(fields.len());
        for (key, value) in fields {
            checkpoint(NAMED);
            let at = key.span();
            let key_span = self.span(at.start, at.end);
            let name = key.into_inner().into_owned();
            let at = value.span();
            let span = self.span(at.start, at.end);
            let path = join(path, &name);
            if let Some(value) = self.toml_value(value.into_inner(), span, &path, depth + 1) {
                out.insert(name, Entry { key: key_span, node: Node { value, span } });
            }
        }
        Value::Table(out)
    }

    fn toml_value(
        &mut self,
        value: DeValue<'_>,
        span: Span,
        path: &str,
        depth: usize,
    ) -> Option<Value> {
        if depth > limits::NESTING {
            self.refuse(span, too_deep(path));
            return None;
        }
        match value {
            DeValue::Boolean(b) => Some(Value::Bool(b)),
            DeValue::String(text) => self.text(text.into_owned(), span, path),
            DeValue::Integer(i) => {
                let number = match i.radix() {
                    10 => i.as_str().parse().ok(),
                    radix => i128::from_str_radix(i.as_str(), radix).ok().map(|i| i as f64),
                };
                self.number(number, span, path)
            }
            DeValue::Float(x) => self.number(x.as_str().parse().ok(), span, path),
            DeValue::Datetime(_) => {
                let message = format!("`{path}` is a date; no field of a model takes dates");
                self.refuse(span, Diagnostic::new(Code::UnusableValue, path, message));
                None
            }
            DeValue::Array(list) => {
                let mut nodes = Vec::with_capacity(list.len());
                for (i, value) in list.into_iter().enumerate() {
                    let at = value.span();
                    let span = self.span(at.start, at.end);
                    let path = format!("{path}[{i}]");
                    let value = self.toml_value(value.into_inner(), span, &path, depth + 1);
                    nodes.extend(value.map(|value| Node { value, span }));
                }
                self.list(nodes, span, path)
            }
            DeValue::Table(table) => Some(self.toml_table(table, path, depth)),
        }
    }

    fn json(&mut self, text: &str) -> Option<Value> {
        if text.trim().is_empty() {
            let error = Diagnostic::new(Code::Syntax, "", "the file is empty")
                .help("a model begins with { \"holonom\": 1, \"dimension\": …");
            self.refuse(self.span(0, 0), error);
            return None;
        }
        // The parser with places is lenient about texts; this one decides what JSON is.
        if let Err(error) = serde_json::from_str::<serde::de::IgnoredAny>(text) {
            let line_start: usize =
                text.split_inclusive('\n').take(error.line().saturating_sub(1)).map(str::len).sum();
            let at = line_start + error.column().saturating_sub(1);
            let message = error.to_string();
            let message = message.rsplit_once(" at line ").map_or(message.as_str(), |(m, _)| m);
            let error = Diagnostic::new(Code::Syntax, "", format!("not valid JSON: {message}"))
                .help("names and texts stand in double quotes, items are separated by commas");
            self.refuse(self.span(at, at + 1), error);
            return None;
        }
        let options = jsonc_parser::CollectOptions::default();
        let strict = jsonc_parser::ParseOptions {
            allow_comments: false,
            allow_loose_object_property_names: false,
            allow_trailing_commas: false,
            allow_missing_commas: false,
            allow_single_quoted_strings: false,
            allow_hexadecimal_numbers: false,
            allow_unary_plus_numbers: false,
            allow_bare_decimal_point_numbers: false,
            allow_non_finite_numbers: false,
            allow_extended_string_escapes: false,
        };
        match jsonc_parser::parse_to_ast(text, &options, &strict) {
            Ok(parsed) => self.json_value(parsed.value?, "", 1),
            Err(error) => {
                let at = error.range();
                let message = format!("not valid JSON: {}", error.kind());
                self.refuse(
                    self.span(at.start, at.end),
                    if matches!(error.kind(), ParseErrorKind::NestingDepthExceeded) {
                        too_deep("")
                    } else {
                        Diagnostic::new(Code::Syntax, "", message)
                    },
                );
                None
            }
        }
    }

    fn json_value(&mut self, value: ast::Value<'_>, path: &str, depth: usize) -> Option<Value> {
        let at = jsonc_parser::common::Ranged::range(&value);
        let span = self.span(at.start, at.end);
        if depth > limits::NESTING {
            self.refuse(span, too_deep(path));
            return None;
        }
        match value {
            ast::Value::BooleanLit(b) => Some(Value::Bool(b.value)),
            ast::Value::StringLit(text) => self.text(text.value.into_owned(), span, path),
            ast::Value::NumberLit(x) => self.number(x.value.parse().ok(), span, path),
            ast::Value::NullKeyword(_) => {
                let message = format!("`{path}` is null; no field of a model takes null");
                let error = Diagnostic::new(Code::UnusableValue, path, message)
                    .help("leave the field out instead");
                self.refuse(span, error);
                None
            }
            ast::Value::Array(list) => {
                let mut nodes = Vec::with_capacity(list.elements.len());
                for (i, value) in list.elements.into_iter().enumerate() {
                    let at = jsonc_parser::common::Ranged::range(&value);
                    let span = self.span(at.start, at.end);
                    let value = self.json_value(value, &format!("{path}[{i}]"), depth + 1);
                    nodes.extend(value.map(|value| Node { value, span }));
                }
                self.list(nodes, span, path)
            }
            ast::Value::Object(object) => {
                let mut out = Table::with_capacity(object.properties.len());
                for field in object.properties {
                    checkpoint(NAMED);
                    let at = jsonc_parser::common::Ranged::range(&field.name);
                    let key = self.span(at.start, at.end);
                    let name = field.name.into_string();
                    let path = join(path, &name);
                    if let Some(first) = out.get(&name).map(|entry: &Entry| entry.key) {
                        if self.errors.len() >= limits::ERRORS_SHOWN {
                            self.omitted += 1; // finding the first line would cost
                            continue;
                        }
                        let (name, text) = (&self.source.name, &self.source.text);
                        let line = Location::of(name, text, first.start, first.end).line;
                        let message = format!("`{path}` is written twice, first on line {line}");
                        let error = Diagnostic::new(Code::DuplicateName, &path, message)
                            .help("give each item and each field once, under one name");
                        self.refuse(key, error);
                        continue;
                    }
                    let at = jsonc_parser::common::Ranged::range(&field.value);
                    let span = self.span(at.start, at.end);
                    if let Some(value) = self.json_value(field.value, &path, depth + 1) {
                        out.insert(name, Entry { key, node: Node { value, span } });
                    }
                }
                Some(Value::Table(out))
            }
        }
    }

    fn number(&mut self, number: Option<f64>, span: Span, path: &str) -> Option<Value> {
        match number {
            Some(x) if x.abs() <= limits::NUMBER => Some(Value::Number(x)),
            _ => {
                let written = &self.source.text[span.start..span.end];
                let written: String = written.chars().take(40).collect();
                let finite = number.is_some_and(f64::is_finite);
                let rule = if finite { "are at most 1e100" } else { "are finite" };
                let message = format!("`{path}` is {written}; numbers of a model {rule}");
                let error = Diagnostic::new(Code::NotFinite, path, message)
                    .help("look for a slip in the exponent, or leave the field out");
                self.refuse(span, error);
                None
            }
        }
    }

    fn text(&mut self, text: String, span: Span, path: &str) -> Option<Value> {
        if text.len() <= limits::TEXT_BYTES {
            return Some(Value::Text(text));
        }
        let (length, most) = (text.len(), limits::TEXT_BYTES);
        let message = format!("`{path}` is a text of {length} bytes; at most {most} are accepted");
        self.refuse(span, Diagnostic::new(Code::TooLarge, path, message));
        None
    }

    fn list(&mut self, nodes: Vec<Node>, span: Span, path: &str) -> Option<Value> {
        if nodes.len() <= limits::LIST_ENTRIES {
            return Some(Value::List(nodes));
        }
        let (length, most) = (nodes.len(), limits::LIST_ENTRIES);
        let message = format!("`{path}` has {length} entries; at most {most} are accepted");
        self.refuse(span, Diagnostic::new(Code::TooLarge, path, message));
        None
    }
}

fn too_deep(path: &str) -> Diagnostic {
    let most = limits::NESTING;
    let message = format!("tables and lists are nested more than {most} deep");
    Diagnostic::new(Code::TooDeep, path, message)
        .help("a model needs about six levels; a bracket may be missing")
}
