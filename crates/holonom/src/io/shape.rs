//! The schema, compiled into what the reader, `with_values` and the reference page walk through.

use std::sync::OnceLock;

use serde_json::Value;

use super::schema::{Dimension, root_schema};

/// What may stand at one place of a model file.
#[derive(Debug, Clone)]
pub(super) enum Shape {
    Number,
    Integer {
        min: Option<u64>,
        max: Option<u64>,
    },
    Bool,
    Text,
    /// One of these words, with its meaning.
    Choice(Vec<(String, String)>),
    List {
        item: Box<Shape>,
        min: usize,
        max: Option<usize>,
    },
    Record(Record),
    /// A record whose fields depend on its `type`.
    Tagged(Tagged),
    /// Names of the user's choice.
    Map(Box<Shape>),
    /// The alternative whose dimension and kind fit.
    Either(Either),
}

/// A table with known fields.
#[derive(Debug, Clone)]
pub(super) struct Record {
    /// Title of the reference page.
    pub(super) title: String,
    pub(super) doc: String,
    pub(super) fields: Vec<Field>,
}

/// Alternatives.
#[derive(Debug, Clone)]
pub(super) struct Either {
    /// Name of this kind of value on the reference page; may be empty.
    pub(super) title: String,
    pub(super) doc: String,
    pub(super) list: Vec<(Option<Dimension>, Shape)>,
}

/// Records by the value of their `type`.
#[derive(Debug, Clone)]
pub(super) struct Tagged {
    /// Title of the reference page.
    pub(super) title: String,
    pub(super) doc: String,
    pub(super) variants: Vec<Variant>,
}

/// A known field.
#[derive(Debug, Clone)]
pub(super) struct Field {
    pub(super) name: String,
    pub(super) doc: String,
    pub(super) unit: Option<String>,
    /// The field whose choice decides between the units: they stand in the order of its words.
    pub(super) unit_by: Option<String>,
    pub(super) dimension: Option<Dimension>,
    pub(super) required: bool,
    /// The field beside it that may stand in for it where it is required.
    pub(super) unless: Option<String>,
    pub(super) default: Option<Value>,
    pub(super) shape: Shape,
}

/// A record by the value of its `type`.
#[derive(Debug, Clone)]
pub(super) struct Variant {
    pub(super) name: String,
    pub(super) dimension: Option<Dimension>,
    pub(super) record: Record,
}

/// Ways to state the same thing, each by some fields of a table.
const ALTERNATIVES: [&[&[&str]]; 9] = [
    &[&["point"], &["point_in_body"], &["points_in_body"]],
    &[&["points"], &["points_in_body"]],
    &[&["axis"], &["axis_in_body"], &["axes_in_body"]],
    &[&["axes"], &["axes_in_body"]],
    &[&["euler_parameters"], &["axis_angle"], &["yaw_pitch_roll"], &["euler_angles"]],
    &[&["joint"], &["between"], &["on"]],
    &[&["stiffness"], &["force"], &["torque"]],
    &[&["table"], &["x", "y"]],
    &[&["fixed_step"], &["max_step"]],
];

/// Fields that say all that others say, which do not say all of theirs.
const WHOLES: [(&str, &[&str]); 4] = [
    ("joint", &["point", "points_in_body", "axis", "axes_in_body"]),
    ("stiffness_matrix", &["stiffness", "rotational_stiffness"]),
    ("damping_matrix", &["damping", "rotational_damping"]),
    ("fixed_step", &["initial_step"]),
];

/// Fields whose place `field` takes: those that say the same in another way.
pub(super) fn other_ways(field: &str) -> impl Iterator<Item = &'static str> {
    let ways = ALTERNATIVES.iter().filter(move |ways| ways.iter().any(|way| way.contains(&field)));
    let others = ways.flat_map(move |ways| ways.iter().filter(move |way| !way.contains(&field)));
    let parts =
        WHOLES.iter().filter(move |(whole, _)| *whole == field).flat_map(|(_, parts)| *parts);
    others.copied().flatten().chain(parts).copied()
}

impl Record {
    pub(super) fn field(&self, name: &str) -> Option<&Field> {
        self.fields.iter().find(|field| field.name == name)
    }
}

/// The fields of a model file.
pub(super) fn model_file() -> &'static Record {
    match model_shape() {
        Shape::Record(record) => record,
        _ => unreachable!("a model file is a table with known fields"),
    }
}

/// The shape of a model file.
pub(super) fn model_shape() -> &'static Shape {
    static SHAPE: OnceLock<Shape> = OnceLock::new();
    SHAPE.get_or_init(|| {
        let schema = root_schema();
        Shape::Record(Compiler { definitions: &schema["$defs"] }.record(&schema))
    })
}

/// The shape of the items in the table that these fields of a model file lead to.
pub(super) fn item_shape(place: &[&str]) -> Option<&'static Shape> {
    let inside = |shape: &'static Shape, field: &&str| match shape {
        Shape::Record(record) => Some(&record.field(field)?.shape),
        _ => None,
    };
    match place.iter().try_fold(model_shape(), inside)? {
        Shape::Map(item) => Some(item),
        _ => None,
    }
}

/// Reads the keywords that the types of `schema` lead to; a keyword it does not know would be a
/// rule that the reader does not keep, so it panics, which the tests of this room would see.
struct Compiler<'a> {
    definitions: &'a Value,
}

impl Compiler<'_> {
    fn shape(&self, schema: &Value) -> Shape {
        if let Some(reference) = schema["$ref"].as_str() {
            let name = reference.trim_start_matches("#/$defs/");
            return self.shape(&self.definitions[name]);
        }
        if let Some(list) = schema["anyOf"].as_array() {
            let alternatives = list.iter().flat_map(|alternative| match self.shape(alternative) {
                Shape::Either(inner) => inner.list,
                shape => vec![(dimension(alternative), shape)],
            });
            return Shape::Either(Either {
                title: text(&schema["title"]),
                doc: doc(schema),
                list: alternatives.collect(),
            });
        }
        if let Some(list) = schema["oneOf"].as_array() {
            if list.iter().all(|choice| choice["const"].is_string()) {
                let words = list.iter().map(|c| (text(&c["const"]), doc(c)));
                return Shape::Choice(words.collect());
            }
            let variants = list.iter().map(|variant| {
                let mut record = self.record(variant);
                record.fields.retain(|field| field.name != "type");
                Variant {
                    name: text(&variant["properties"]["type"]["const"]),
                    dimension: dimension(variant),
                    record,
                }
            });
            return Shape::Tagged(Tagged {
                title: text(&schema["title"]),
                doc: doc(schema),
                variants: variants.collect(),
            });
        }
        match schema["type"].as_str() {
            Some("number") => Shape::Number,
            Some("integer") => {
                Shape::Integer { min: schema["minimum"].as_u64(), max: schema["maximum"].as_u64() }
            }
            Some("boolean") => Shape::Bool,
            Some("string") => match schema["enum"].as_array() {
                Some(words) => {
                    Shape::Choice(words.iter().map(|w| (text(w), String::new())).collect())
                }
                None => Shape::Text,
            },
            Some("array") => Shape::List {
                item: Box::new(self.shape(&schema["items"])),
                min: schema["minItems"].as_u64().unwrap_or(0) as usize,
                max: schema["maxItems"].as_u64().map(|n| n as usize),
            },
            Some("object") if schema["properties"].is_object() => {
                Shape::Record(self.record(schema))
            }
            Some("object") => Shape::Map(Box::new(self.shape(&schema["additionalProperties"]))),
            _ => unreachable!("the schema has a form that the reader does not know: {schema}"),
        }
    }

    fn record(&self, schema: &Value) -> Record {
        let required = schema["required"].as_array().map_or(&[][..], Vec::as_slice);
        let properties = schema["properties"].as_object();
        let fields = properties.into_iter().flatten().map(|(name, property)| {
            let referred = property["$ref"].as_str().map(|r| r.trim_start_matches("#/$defs/"));
            let own = doc(property);
            Field {
                name: name.clone(),
                doc: match (own.is_empty(), referred) {
                    (true, Some(name)) => doc(&self.definitions[name]),
                    _ => own,
                },
                unit: property["x-unit"].as_str().map(str::to_owned),
                unit_by: property["x-unit-by"].as_str().map(str::to_owned),
                dimension: dimension(property),
                required: required.iter().any(|r| r.as_str() == Some(name))
                    || property["x-unless"].is_string(),
                unless: property["x-unless"].as_str().map(str::to_owned),
                default: property.get("default").cloned(),
                shape: match property.get("const") {
                    Some(word) => Shape::Choice(vec![(text(word), String::new())]),
                    None => self.shape(property),
                },
            }
        });
        Record { title: text(&schema["title"]), doc: doc(schema), fields: fields.collect() }
    }
}

fn text(value: &Value) -> String {
    value.as_str().unwrap_or_default().to_owned()
}

fn doc(schema: &Value) -> String {
    schema["description"].as_str().unwrap_or_default().replace('\n', " ")
}

fn dimension(schema: &Value) -> Option<Dimension> {
    match schema["x-dimension"].as_str()? {
        "planar" => Some(Dimension::Planar),
        _ => Some(Dimension::Spatial),
    }
}

/// What a shape expects, for messages: "a number (kg)", "a list of 2 numbers (m)".
pub(super) fn describe(shape: &Shape, unit: Option<&str>, dimension: Option<Dimension>) -> String {
    let unit_text = unit.map_or(String::new(), |unit| format!(" ({unit})"));
    match shape {
        Shape::Number => format!("a number{unit_text}"),
        Shape::Integer { .. } => "a whole number".to_owned(),
        Shape::Bool => "`true` or `false`".to_owned(),
        Shape::Text => "a text".to_owned(),
        Shape::Choice(words) => {
            let words: Vec<_> = words.iter().map(|(word, _)| format!("\"{word}\"")).collect();
            words.join(" or ")
        }
        Shape::List { item, min, max } => {
            let count = match (*min, *max) {
                (n, Some(m)) if n == m => format!(" of {n}"),
                (0, _) => String::new(),
                (n, _) => format!(" of {n} or more"),
            };
            let entries = match &**item {
                Shape::Number => format!("numbers{unit_text}"),
                Shape::Text => "names".to_owned(),
                Shape::List { item, max: Some(m), .. } if matches!(**item, Shape::Number) => {
                    format!("lists of {m} numbers{unit_text}")
                }
                other => format!("entries, each {}", describe(other, unit, dimension)),
            };
            let of = if count.is_empty() { " of" } else { "" };
            format!("a list{count}{of} {entries}")
        }
        Shape::Record(record) => {
            let named = |required: bool| -> Vec<String> {
                let fields = record.fields.iter().filter(|f| f.required == required);
                fields.map(|f| format!("`{}`", f.name)).collect()
            };
            match (&named(true)[..], &named(false)[..]) {
                ([], few @ ([_] | [_, _] | [_, _, _])) => {
                    format!("a table with some of {}", few.join(", "))
                }
                ([], _) => "a table".to_owned(),
                (names, _) => format!("a table with {}", names.join(", ")),
            }
        }
        Shape::Tagged(_) => "a table with a `type`".to_owned(),
        Shape::Map(_) => "a table of names".to_owned(),
        Shape::Either(either) => {
            let of_kind: Vec<_> = alternatives(shape, dimension)
                .into_iter()
                .map(|shape| describe(shape, unit, dimension))
                .collect();
            let text = of_kind.join(" or ");
            // The one text among points is a marker.
            if either.title == "place" {
                text.replace(" or a text", " or a marker \"body.marker\"")
            } else {
                text
            }
        }
    }
}

/// The alternatives that a model of this dimension has.
pub(super) fn alternatives(shape: &Shape, dimension: Option<Dimension>) -> Vec<&Shape> {
    match shape {
        Shape::Either(Either { list, .. }) => {
            let fits =
                |of: &Option<Dimension>| of.is_none() || dimension.is_none() || *of == dimension;
            list.iter().filter(|(of, _)| fits(of)).map(|(_, shape)| shape).collect()
        }
        shape => vec![shape],
    }
}
