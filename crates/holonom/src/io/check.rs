//! The tree against the shape of a model file: unknown and missing fields, types, sizes, names.
//! Expressions of parameters are replaced by their values here.

use std::collections::BTreeMap;

use serde_json::Value as Json;

use super::expression::{Fault, evaluate, is_number};
use super::limits;
use super::names::{nearest, objection, suggest};
use super::parameters::Parameters;
use super::schema::Dimension;
use super::shape::{Field, Record, Shape, Variant, alternatives, describe, model_file};
use super::tree::{Node, Span, Table, Value, join};
use super::units::{self, Units};
use crate::error::{Code, Diagnostic, shown};
use crate::watch::{NAMED, checkpoint};

/// Tables of items of the user's naming.
pub(super) const COLLECTIONS: [&str; 7] =
    ["bodies", "joints", "forces", "drivers", "tables", "roads", "parameters"];

/// Tables of `initial`, and the collections of the items that they speak of.
pub(super) const INITIAL: [(&str, &str); 3] =
    [("bodies", "bodies"), ("joints", "joints"), ("extra_states", "forces")];

/// Checks a whole file; the result has the structure of `schema::ModelFile` when there are no
/// errors.
pub(super) fn check_file(root: &Node) -> (Json, Vec<Diagnostic>) {
    let dimension = match root.field("dimension").and_then(Node::text) {
        Some("planar") => Some(Dimension::Planar),
        Some("spatial") => Some(Dimension::Spatial),
        _ => None, // reported below
    };
    let mut checker = Checker {
        dimension,
        parameters: Parameters::of(root),
        units: Units::of(root),
        tables: root.field("tables").and_then(Node::table),
        errors: Vec::new(),
    };
    let Some(table) = root.table() else {
        let message = format!("the file holds {}; expected a table of fields", root.kind());
        return (Json::Null, vec![Diagnostic::new(Code::WrongType, "", message)]);
    };
    checker.unique_names(table);
    let json = checker.record_of_type(model_file(), table, "", (None, None));
    (json, checker.errors)
}

struct Checker<'a> {
    /// `None` when the file does not say, so that only that is reported.
    dimension: Option<Dimension>,
    /// What is wrong with a parameter is reported where it is defined.
    parameters: Parameters,
    units: Units,
    /// Tables that laws and motions refer to.
    tables: Option<&'a Table>,
    errors: Vec<Diagnostic>,
}

impl Checker<'_> {
    fn refuse(&mut self, code: Code, path: &str, message: String, help: impl Into<String>) -> Json {
        self.errors.push(Diagnostic::new(code, path, message).help(help));
        Json::Null
    }

    /// Names are unique in the whole model: paths, channels and messages speak of items by name.
    fn unique_names(&mut self, root: &Table) {
        let mut seen: BTreeMap<&str, &str> = BTreeMap::new();
        for collection in COLLECTIONS {
            let items = root.get(collection).and_then(|entry| entry.node.table());
            for name in items.into_iter().flatten().map(|(name, _)| name) {
                if let Some(first) = seen.insert(name, collection) {
                    let at = join(collection, name);
                    let message = format!("`{at}` has the name of `{first}.{name}`");
                    let help = "names are unique in the whole model: rename one of the two";
                    self.refuse(Code::DuplicateName, &at, message, help);
                }
            }
        }
    }

    fn wrong_type(&mut self, shape: &Shape, node: &Node, path: &str, unit: Option<&str>) -> Json {
        let expected = self.describe(shape, unit);
        let message = format!("`{path}` is {}; expected {expected}", node.kind());
        let takes_number =
            alternatives(shape, self.dimension).iter().any(|s| matches!(s, Shape::Number));
        let help = match node.text().map(str::trim) {
            Some(text) if takes_number && text.parse().is_ok_and(f64::is_finite) => {
                format!("write the number without quotes: {text}")
            }
            Some(text) if takes_number && self.parameters.contains(text) => {
                format!("write \"={text}\" to use the parameter `{text}`")
            }
            Some(text) if takes_number && self.is_expression(text) => {
                format!("write \"={text}\": expressions begin with `=`")
            }
            Some(text)
                if takes_number
                    && text.split(' ').next().is_some_and(|n| n.parse::<f64>().is_ok()) =>
            {
                "write the number alone, without quotes and without its unit".to_owned()
            }
            _ => match (shape, &node.value) {
                (Shape::Record(record), Value::Number(x)) if record.field("value").is_some() => {
                    format!("write {{ value = {} }}", shown(*x))
                }
                (Shape::Text, Value::Number(_) | Value::Bool(_)) => {
                    let text = match &node.value {
                        Value::Number(x) if x.abs() < 1e15 => x.to_string(),
                        Value::Number(x) => shown(*x),
                        value => matches!(value, Value::Bool(true)).to_string(),
                    };
                    let shell = format!(", in a shell '\"{text}\"'");
                    let shell = if node.span == Span::SET { &shell } else { "" };
                    format!("write a text in quotes: \"{text}\"{shell}")
                }
                _ => String::new(),
            },
        };
        self.refuse(Code::WrongType, path, message, help)
    }

    /// Whether a text would have a value as an expression.
    fn is_expression(&self, text: &str) -> bool {
        let mut broken = false;
        let value = evaluate(text, &mut |name| self.parameters.number(name, &mut broken));
        value.is_ok_and(f64::is_finite)
    }

    fn value(&mut self, shape: &Shape, node: &Node, path: &str, unit: Option<&str>) -> Json {
        match (shape, &node.value) {
            (Shape::Number, Value::Number(x)) => self.in_si(*x, path, unit).into(),
            (Shape::Number, Value::Text(text)) if text.starts_with('=') => {
                let value = self.expression(&text[1..], path);
                value.as_f64().map_or(value, |x| self.in_si(x, path, unit).into())
            }
            (Shape::Integer { min, max }, Value::Number(x)) => self.integer(*x, *min, *max, path),
            (Shape::Bool, Value::Bool(b)) => (*b).into(),
            (Shape::Text, Value::Text(text)) => text.clone().into(),
            (Shape::Choice(words), Value::Text(text)) => {
                if words.iter().any(|(word, _)| word == text) {
                    return text.clone().into();
                }
                let expected = describe(shape, None, None);
                let message = format!("`{path}` is {}; expected {expected}", node.kind());
                let meant = nearest(text, words.iter().map(|(word, _)| word.as_str()));
                let help = meant.map_or(String::new(), |word| format!("did you mean \"{word}\"?"));
                self.refuse(Code::UnknownChoice, path, message, help)
            }
            (Shape::List { item, .. }, Value::List(list))
                if matches!(**item, Shape::List { .. })
                    && !list.is_empty()
                    && list.iter().all(|node| matches!(node.value, Value::Number(_))) =>
            {
                // One error for a row in place of a matrix, not one per entry.
                let expected = self.describe(shape, unit);
                let message = format!("`{path}` is a list of numbers; expected {expected}");
                let help = "give every row as a list of its own, zeros included";
                self.refuse(Code::WrongType, path, message, help)
            }
            (Shape::List { item, min, max }, Value::List(list)) => {
                if list.len() < *min || max.is_some_and(|max| list.len() > max) {
                    let expected = self.describe(shape, unit);
                    let message =
                        format!("`{path}` has {}; expected {expected}", entries(list.len()));
                    return self.refuse(Code::WrongSize, path, message, "");
                }
                let entries = list.iter().enumerate();
                entries.map(|(i, n)| self.value(item, n, &format!("{path}[{i}]"), unit)).collect()
            }
            (Shape::Record(record), Value::Table(table)) => {
                self.record_of_type(record, table, path, (None, unit))
            }
            (Shape::Tagged(tagged), Value::Table(table)) => {
                self.tagged(&tagged.variants, table, path, unit)
            }
            (Shape::Map(item), Value::Table(table)) => self.map(item, table, path, unit),
            (Shape::Either(_), _) => self.either(shape, node, path, unit),
            _ => self.wrong_type(shape, node, path, unit),
        }
    }

    /// A number of the file in SI.
    fn in_si(&self, x: f64, path: &str, unit: Option<&str>) -> f64 {
        match unit {
            Some(unit) if !self.units.are_si() => self.units.to_si(units::entry(unit, path), x),
            _ => x,
        }
    }

    /// What a shape expects, for messages.
    fn describe(&self, shape: &Shape, unit: Option<&str>) -> String {
        describe(shape, unit.map(|unit| self.units.name(unit)).as_deref(), self.dimension)
    }

    fn expression(&mut self, text: &str, path: &str) -> Json {
        let own = path.strip_prefix("parameters.").and_then(|path| path.strip_suffix(".value"));
        if own.is_some_and(|name| self.parameters.is_circular(name)) {
            let message = format!("`{path}` is `={text}`, and so depends on itself");
            let help = "give one of the circle as a number";
            return self.refuse(Code::Expression, path, message, help);
        }
        let mut broken = false;
        let value = evaluate(text, &mut |name| self.parameters.number(name, &mut broken));
        match value {
            _ if broken => 0.0.into(), // reported at the parameter
            Ok(x) if x.abs() <= limits::NUMBER => x.into(),
            Ok(x) => {
                let value = shown(x);
                let message =
                    format!("`{path}` is `={text}`, {value}; numbers of a model are at most 1e100");
                let help = if x.is_nan() {
                    "look for a division by zero, or a root, logarithm or arc of what has none"
                } else if x.is_infinite() {
                    "look for a division by zero, the logarithm of zero or numbers that are too large"
                } else {
                    "look for a slip in a factor or an exponent"
                };
                self.refuse(Code::NotFinite, path, message, help)
            }
            Err(Fault::Unknown(name)) => {
                let message =
                    format!("`{path}` refers to the parameter `{name}`, which is not there");
                let inside = |p: &&str| p.contains('-') && text.contains(p);
                let help = match self.parameters.names().find(inside) {
                    Some(whole) => {
                        format!("`{whole}` can stand alone only: in arithmetic `-` subtracts")
                    }
                    None => suggest(&self.errors, &name, "parameters", self.parameters.names()),
                };
                self.refuse(Code::UnknownName, path, message, help)
            }
            Err(Fault::Other(message, help)) => self.refuse(
                Code::Expression,
                path,
                format!("`{path}` is `={text}`: {message}"),
                help,
            ),
        }
    }

    fn integer(&mut self, x: f64, min: Option<u64>, max: Option<u64>, path: &str) -> Json {
        let (low, high) = (min.unwrap_or(0), max.unwrap_or(1 << 53));
        if x.fract() == 0.0 && x >= low as f64 && x <= high as f64 {
            return (x as u64).into();
        }
        let small = max.is_none() && x <= high as f64;
        let range = if small { String::new() } else { format!(" up to {high}") };
        let message =
            format!("`{path}` is {}; expected a whole number from {low}{range}", shown(x));
        self.refuse(Code::OutOfRange, path, message, "")
    }

    /// The alternative of the model's dimension and of the value's kind.
    fn either(&mut self, shape: &Shape, node: &Node, path: &str, unit: Option<&str>) -> Json {
        let fits = |s: &&Shape| {
            let sized = match (s, &node.value) {
                (Shape::List { max: Some(max), .. }, Value::List(list)) => *max == list.len(),
                _ => true,
            };
            sized && kind_fits(s, node)
        };
        let own = alternatives(shape, self.dimension);
        let exact = own.iter().copied().find(fits);
        let fitting = exact.or_else(|| own.into_iter().find(|s| kind_fits(s, node)));
        if let (None, Some(dimension)) = (exact, self.dimension)
            && alternatives(shape, None).iter().any(fits)
        {
            let expected = self.describe(shape, unit);
            let have = match &node.value {
                Value::List(list) => format!("has {}", entries(list.len())),
                _ => format!("is {}", node.kind()),
            };
            let message = format!("`{path}` {have}; expected {expected}");
            let help = match dimension {
                Dimension::Planar => {
                    "this model is planar: points are [x, y], inertia and angles are about z"
                }
                Dimension::Spatial => {
                    "this model is spatial: points are [x, y, z], inertia is a 3×3 tensor"
                }
            };
            return self.refuse(Code::WrongDimension, path, message, help);
        }
        match fitting {
            Some(fitting) => self.value(fitting, node, path, unit),
            None => self.wrong_type(shape, node, path, unit),
        }
    }

    fn tagged(
        &mut self,
        variants: &[Variant],
        table: &Table,
        path: &str,
        unit: Option<&str>,
    ) -> Json {
        let exists = |of: Option<Dimension>| {
            of.is_none() || self.dimension.is_none() || of == self.dimension
        };
        let known: Vec<&str> =
            variants.iter().filter(|v| exists(v.dimension)).map(|v| v.name.as_str()).collect();
        let choices = known.iter().map(|k| format!("\"{k}\"")).collect::<Vec<_>>().join(", ");
        let at = join(path, "type");
        let Some(node) = table.get("type").map(|entry| &entry.node) else {
            let message = format!("`{path}` has no `type`; expected one of {choices}");
            return self.refuse(Code::MissingField, &at, message, "");
        };
        let Some(name) = node.text() else {
            let message = format!("`{at}` is {}; expected one of {choices}", node.kind());
            return self.refuse(Code::WrongType, &at, message, "");
        };
        let Some(variant) = variants.iter().find(|v| v.name == name) else {
            let message = format!("`{at}` is \"{name}\"; expected one of {choices}");
            let help =
                nearest(name, known).map_or(String::new(), |k| format!("did you mean \"{k}\"?"));
            return self.refuse(Code::UnknownChoice, &at, message, help);
        };
        if !exists(variant.dimension) {
            let message =
                format!("`{path}` is of type \"{name}\", which {}", only(variant.dimension));
            let help = format!("types of this model's dimension: {choices}");
            return self.refuse(Code::WrongDimension, &at, message, help);
        }
        let mut json = self.record_of_type(&variant.record, table, path, (Some(name), unit));
        json["type"] = name.into();
        json
    }

    fn map(&mut self, item: &Shape, table: &Table, path: &str, unit: Option<&str>) -> Json {
        if table.len() > limits::ITEMS {
            let (count, most) = (table.len(), limits::ITEMS);
            let message = format!("`{path}` has {count} items; at most {most} are accepted");
            return self.refuse(Code::TooLarge, path, message, "");
        }
        // Under `initial` the names refer to items defined elsewhere.
        let defines = !path.starts_with("initial.");
        let can_be_off = match item {
            Shape::Record(record) => record.field("enabled").is_some(),
            Shape::Tagged(tagged) => {
                tagged.variants.iter().all(|v| v.record.field("enabled").is_some())
            }
            _ => false,
        };
        let mut out = serde_json::Map::with_capacity(table.len());
        for (name, entry) in table {
            let at = join(path, name);
            let hides = path == "parameters" && is_number(name);
            let hidden = hides.then(|| format!("`={name}` is a number by itself"));
            if let Some(objection) = objection(name).or(hidden).filter(|_| defines) {
                let message = format!("`{name}` in `{path}`: {objection}");
                self.refuse(
                    Code::BadName,
                    &at,
                    message,
                    "choose another name, of letters, digits, `_` and `-`",
                );
            }
            if let Some(Value::Bool(false)) = entry.node.field("enabled").map(|node| &node.value)
                && entry.node.table().is_some_and(|fields| fields.len() == 1)
                && can_be_off
            {
                let message = format!("`{at}` is switched off; there is no such item");
                let help = "name an item of the file that is extended, or delete the line";
                self.refuse(Code::UnknownName, &at, message, help);
                continue;
            }
            out.insert(name.clone(), self.value(item, &entry.node, &at, unit));
        }
        out.into()
    }

    fn record_of_type(
        &mut self,
        record: &Record,
        table: &Table,
        path: &str,
        (kind, outer): (Option<&str>, Option<&str>),
    ) -> Json {
        let owner = match (path, kind) {
            ("", _) => "the model".to_owned(),
            (path, Some(kind)) => format!("`{path}` of type \"{kind}\""),
            (path, None) => format!("`{path}`"),
        };
        let dimension = self.dimension;
        let exists = |field: &&Field| {
            field.dimension.is_none() || dimension.is_none() || field.dimension == dimension
        };
        let mut out = serde_json::Map::with_capacity(table.len());
        let mut meant = Vec::new();
        for (name, entry) in table {
            checkpoint(NAMED);
            let at = join(path, name);
            match record.field(name) {
                Some(field) if exists(&field) => {
                    let unit = units::within(unit_of(field, record, table), outer);
                    out.insert(name.clone(), self.value(&field.shape, &entry.node, &at, unit));
                }
                Some(field) => {
                    let message = format!("`{at}`: the field {}", only(field.dimension));
                    self.refuse(Code::WrongDimension, &at, message, "leave the field out");
                }
                None if name == "type" && kind.is_some() => {}
                None => {
                    let known = record.fields.iter().filter(exists).map(|f| f.name.as_str());
                    let message = format!("{owner} has no field `{name}`");
                    let help = suggest(&self.errors, name, "fields", known.clone());
                    meant.extend(nearest(name, known));
                    self.refuse(Code::UnknownField, &at, message, help);
                }
            }
        }
        for field in record.fields.iter().filter(exists).filter(|field| field.required) {
            let replaced = field.unless.as_ref().is_some_and(|other| table.contains_key(other));
            // A misspelled field is not missing too.
            let written = table.contains_key(&field.name) || meant.contains(&field.name.as_str());
            if !written && !replaced {
                let unit = units::within(unit_of(field, record, table), outer);
                let expected = self.describe(&field.shape, unit);
                let message = format!("{owner} has no `{}`; expected {expected}", field.name);
                self.refuse(
                    Code::MissingField,
                    &join(path, &field.name),
                    message,
                    first_sentence(&field.doc),
                );
            }
        }
        self.put_in_table(record, &mut out, outer);
        out.into()
    }

    /// A named table has the units of the field that refers to it: where they are not SI its columns take
    /// the place of its name.
    fn put_in_table(
        &mut self,
        record: &Record,
        out: &mut serde_json::Map<String, Json>,
        outer: Option<&str>,
    ) {
        let (Some(tables), Some(_)) = (self.tables, record.field("table")) else { return };
        let named = out.get("table").and_then(Json::as_str).and_then(|name| tables.get(name));
        let Some(table) = named.and_then(|entry| entry.node.table()) else { return };
        if self.units.are_si() || out.contains_key("x") || out.contains_key("y") {
            return;
        }
        let reported = self.errors.len();
        for column in ["x", "y"] {
            let (Some(field), Some(entry)) = (record.field(column), table.get(column)) else {
                return;
            };
            let unit = units::within(field.unit.as_deref(), outer);
            let values = self.value(&field.shape, &entry.node, column, unit);
            out.insert(column.to_owned(), values);
        }
        self.errors.truncate(reported); // they are reported at the table
        out.shift_remove("table");
    }
}

/// The unit of a field; of one that depends on a choice made beside it, that of the choice.
fn unit_of<'a>(field: &'a Field, record: &Record, table: &Table) -> Option<&'a str> {
    let (Some(unit), Some(by)) = (field.unit.as_deref(), &field.unit_by) else {
        return field.unit.as_deref();
    };
    let chosen = table.get(by).and_then(|entry| entry.node.text())?;
    let Shape::Choice(words) = &record.field(by)?.shape else { return None };
    unit.split(" or ").zip(words).find(|(_, (word, _))| word == chosen).map(|(unit, _)| unit)
}

/// The beginning of a description, as help: "mass; zero is allowed …".
fn first_sentence(doc: &str) -> String {
    let sentence = doc.split_once(". ").map_or(doc, |(first, _)| first).trim_end_matches('.');
    let mut characters = sentence.chars();
    characters.next().map_or(String::new(), |c| c.to_lowercase().chain(characters).collect())
}

fn entries(n: usize) -> String {
    if n == 1 { "1 entry".to_owned() } else { format!("{n} entries") }
}

fn only(dimension: Option<Dimension>) -> &'static str {
    match dimension {
        Some(Dimension::Planar) => "exists in planar models only",
        _ => "exists in spatial models only",
    }
}

/// Whether a value is of the kind that a shape takes; sizes and contents are looked at later.
pub(super) fn kind_fits(shape: &Shape, node: &Node) -> bool {
    match (shape, &node.value) {
        (Shape::Number, Value::Text(text)) => text.starts_with('='),
        (Shape::Number | Shape::Integer { .. }, Value::Number(_))
        | (Shape::Bool, Value::Bool(_))
        | (Shape::Text | Shape::Choice(_), Value::Text(_))
        | (Shape::List { .. }, Value::List(_))
        | (Shape::Record(_) | Shape::Tagged(_) | Shape::Map(_), Value::Table(_)) => true,
        (Shape::Either(either), _) => either.list.iter().any(|(_, shape)| kind_fits(shape, node)),
        _ => false,
    }
}
