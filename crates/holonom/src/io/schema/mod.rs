//! The structure of a model file as types. The JSON Schema, the checks of the reader and the
//! reference page all come from them, so that they cannot differ.
//!
//! Comments on fields are the text of the reference page. `x-unit` is the unit of a number,
//! `x-dimension` says where a field exists in models of one dimension only.

mod forces;
mod items;
mod motions;
mod patterns;
mod run;
mod shapes;
mod units;

use indexmap::IndexMap;
use schemars::JsonSchema;
use schemars::transform::{RecursiveTransform, Transform};
use serde::{Deserialize, Serialize};
use serde_json::json;

pub(super) use forces::*;
pub(super) use items::*;
pub(super) use motions::*;
pub(super) use patterns::*;
pub(super) use run::*;
pub(super) use shapes::*;
pub(super) use units::*;

/// Fields that every item has, added to each.
macro_rules! item {
    ($(#[$meta:meta])* struct $name:ident { $($body:tt)* }) => {
        #[derive(Debug, Clone, serde::Deserialize, schemars::JsonSchema)]
        #[serde(deny_unknown_fields)]
        $(#[$meta])*
        pub(crate) struct $name {
            $($body)*
            /// Text for people: what it is, where its numbers come from.
            #[allow(dead_code, reason = "for readers of the file")]
            pub(crate) title: Option<String>,
            /// `false` removes the item, also one of a file that this file extends.
            #[allow(dead_code, reason = "applied while files are merged")]
            #[serde(default = "crate::io::schema::yes")]
            pub(crate) enabled: bool,
        }
    };
}
pub(super) use item;

pub(super) fn yes() -> bool {
    true
}

/// A model of a mechanism: bodies, joints, forces and drivers, in SI units and radians unless `units` says
/// otherwise.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Holonom model file")]
pub(crate) struct ModelFile {
    /// Version of this format: 1.
    #[allow(dead_code, reason = "checked before anything else is read")]
    #[schemars(range(min = 1, max = 1))]
    pub(crate) holonom: u32,
    /// Title for reports.
    pub(crate) title: Option<String>,
    /// Path, relative to this file, of a model that this file changes; see "Variants" above.
    #[allow(dead_code, reason = "applied while files are merged")]
    pub(crate) extends: Option<String>,
    /// Planar models move in x-y and turn about z; spatial models move in three dimensions.
    pub(crate) dimension: Dimension,
    /// Units of the numbers of this file.
    #[allow(dead_code, reason = "applied while the file is checked")]
    #[serde(default)]
    pub(crate) units: Units,
    /// Acceleration of gravity, ground axes. Where it is left out there is none, and a warning says so.
    #[schemars(extend("x-unit" = "m/s²"))]
    pub(crate) gravity: Option<Vector>,
    /// Numbers with a name, used as `"=name"` or in arithmetic, `"=2*name"`, in any numeric field.
    #[allow(dead_code, reason = "their values are put in place while the file is checked")]
    #[serde(default)]
    pub(crate) parameters: IndexMap<String, Parameter>,
    /// Rigid bodies in the design configuration.
    #[serde(default)]
    pub(crate) bodies: IndexMap<String, Body>,
    /// Joints between bodies, or between a body and the ground.
    #[serde(default)]
    pub(crate) joints: IndexMap<String, Joint>,
    /// Force elements and applied forces.
    #[serde(default)]
    pub(crate) forces: IndexMap<String, Force>,
    /// Prescribed motions.
    #[serde(default)]
    pub(crate) drivers: IndexMap<String, Driver>,
    /// Tables that force laws and motions refer to.
    #[serde(default)]
    pub(crate) tables: IndexMap<String, DataTable>,
    /// Road profiles that tyres refer to.
    #[serde(default)]
    pub(crate) roads: IndexMap<String, Road>,
    /// Items that are repeated over an index; see "Patterns: many alike items" above.
    #[allow(dead_code, reason = "written out before the file is checked")]
    #[serde(default)]
    pub(crate) patterns: IndexMap<String, Pattern>,
    /// State at the start of the run.
    #[serde(default)]
    pub(crate) initial: Initial,
    /// What a run writes unless the command says otherwise.
    #[serde(default)]
    pub(crate) outputs: Outputs,
    /// How a run integrates unless the command says otherwise.
    #[serde(default)]
    pub(crate) simulation: Simulation,
}

/// Planar or spatial.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Dimension {
    /// Points are `[x, y]`; inertia, angles and torques are numbers about z.
    Planar,
    /// Points are `[x, y, z]`; orientations are Euler parameters.
    Spatial,
}

/// `[x, y]` in planar, `[x, y, z]` in spatial models.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
#[schemars(title = "vector")]
pub(crate) enum Vector {
    #[schemars(extend("x-dimension" = "planar"))]
    Planar([f64; 2]),
    #[schemars(extend("x-dimension" = "spatial"))]
    Spatial([f64; 3]),
}

impl Vector {
    /// Three components; the third of a planar vector is zero.
    pub(super) fn components(self) -> [f64; 3] {
        match self {
            Self::Planar([x, y]) => [x, y, 0.0],
            Self::Spatial(v) => v,
        }
    }
}

/// A number about z in planar, `[x, y, z]` in spatial models.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
#[schemars(title = "rotational vector")]
pub(crate) enum Rotational {
    #[schemars(extend("x-dimension" = "planar"))]
    Planar(f64),
    #[schemars(extend("x-dimension" = "spatial"))]
    Spatial([f64; 3]),
}

impl Rotational {
    pub(super) fn components(self) -> [f64; 3] {
        match self {
            Self::Planar(z) => [0.0, 0.0, z],
            Self::Spatial(v) => v,
        }
    }
}

/// A vector, or a marker `"body.marker"`.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(untagged)]
#[schemars(title = "place")]
pub(crate) enum Place {
    At(Vector),
    Marker(String),
}

/// Fields of `Option` type may be left out; null is not a value of a model file, and a table that
/// is left out needs no default.
#[derive(Clone)]
struct WithoutNull;

impl Transform for WithoutNull {
    fn transform(&mut self, schema: &mut schemars::Schema) {
        let Some(object) = schema.as_object_mut() else { return };
        if object.get("default").is_some_and(serde_json::Value::is_object) {
            object.remove("default");
        }
        if let Some(types) = object.get_mut("type").and_then(|t| t.as_array_mut()) {
            types.retain(|t| t != "null");
            if let [only] = &types[..] {
                let only = only.clone();
                object.insert("type".to_owned(), only);
            }
        }
        if let Some(list) = object.get_mut("anyOf").and_then(|t| t.as_array_mut()) {
            list.retain(|alternative| alternative.get("type") != Some(&json!("null")));
            if let [serde_json::Value::Object(only)] = &list[..] {
                let only = only.clone();
                object.remove("anyOf");
                object.extend(only);
            }
        }
    }
}

/// Numbers may be written as expressions, `"=parameter"`.
#[derive(Clone)]
struct WithParameters;

impl Transform for WithParameters {
    fn transform(&mut self, schema: &mut schemars::Schema) {
        let Some(object) = schema.as_object_mut() else { return };
        if object.get("type") == Some(&json!("number")) {
            object.insert("type".to_owned(), json!(["number", "string"]));
            object.insert("pattern".to_owned(), json!("^="));
        }
    }
}

/// Parts of items, as files that extend another one and exceptions of patterns hold them: nothing is required.
#[derive(Clone)]
struct Partial;

/// How references to definitions begin, and to those of parts.
const DEFINITION: &str = "#/$defs/";
const PART: &str = "#/$defs/Part";

impl Transform for Partial {
    fn transform(&mut self, schema: &mut schemars::Schema) {
        let Some(object) = schema.as_object_mut() else { return };
        object.shift_remove("required");
        // Without a `type` all variants fit that have the fields.
        if let Some(variants) = object.shift_remove("oneOf") {
            object.insert("anyOf".to_owned(), variants);
        }
        if let Some(serde_json::Value::String(target)) = object.get_mut("$ref") {
            *target = target.replace(DEFINITION, PART);
        }
    }
}

/// Of items that are switched off nothing is required.
#[derive(Clone)]
struct SwitchedOff {
    /// Names of the definitions of items.
    items: Vec<String>,
}

impl Transform for SwitchedOff {
    fn transform(&mut self, schema: &mut schemars::Schema) {
        let Some(inside) = schema.get_mut("additionalProperties") else { return };
        let name = inside["$ref"].as_str().and_then(|target| target.strip_prefix(DEFINITION));
        let Some(name) = name.filter(|name| self.items.iter().any(|item| item == name)) else {
            return;
        };
        let off =
            json!({ "properties": { "enabled": { "const": false } }, "required": ["enabled"] });
        let part = json!({ "$ref": format!("{PART}{name}") });
        *inside = json!({ "if": off, "then": part, "else": inside });
    }
}

/// What is required unless another field of the same table stands in for it, `x-unless`.
#[derive(Clone)]
struct WithSubstitutes;

impl Transform for WithSubstitutes {
    fn transform(&mut self, schema: &mut schemars::Schema) {
        let Some(object) = schema.as_object_mut() else { return };
        let Some(properties) = object.get("properties").and_then(|p| p.as_object()) else { return };
        let replaced = |(name, field): (&String, &serde_json::Value)| {
            Some((name.clone(), field["x-unless"].as_str()?.to_owned()))
        };
        let pairs: Vec<_> = properties.iter().filter_map(replaced).collect();
        let Some((_, substitute)) = pairs.first() else { return };
        let names: Vec<_> = pairs.iter().map(|(name, _)| name).collect();
        let either = json!([{ "required": names }, { "required": [substitute] }]);
        object.insert("anyOf".to_owned(), either);
    }
}

/// The schema that the reader follows.
pub(super) fn root_schema() -> serde_json::Value {
    let settings = schemars::generate::SchemaSettings::draft2020_12()
        .with_transform(RecursiveTransform(WithoutNull));
    settings.into_generator().into_root_schema_for::<ModelFile>().to_value()
}

/// JSON Schema (draft 2020-12) of model files, for editors and other tools. A file that extends another one or has
/// patterns holds parts of items, which only the merged and written-out file completes: of such a file the
/// schema requires no field of an item.
pub fn json_schema() -> String {
    let settings = || {
        schemars::generate::SchemaSettings::draft2020_12()
            .with_transform(RecursiveTransform(WithoutNull))
            .with_transform(RecursiveTransform(WithParameters))
    };
    let whole = settings().with_transform(RecursiveTransform(WithSubstitutes));
    let mut whole = whole.into_generator().into_root_schema_for::<ModelFile>();
    let part = settings().with_transform(RecursiveTransform(Partial));
    let mut part = part.into_generator().into_root_schema_for::<ModelFile>().to_value();
    let is_item = |schema: &serde_json::Value| {
        let variants =
            schema["oneOf"].as_array().map_or(std::slice::from_ref(schema), Vec::as_slice);
        variants.iter().all(|variant| variant["properties"]["enabled"].is_object())
    };
    let definitions = whole.get("$defs").and_then(|all| all.as_object()).into_iter().flatten();
    let items = definitions.filter(|(_, schema)| is_item(schema)).map(|(name, _)| name.clone());
    let items = items.collect();
    RecursiveTransform(SwitchedOff { items }).transform(&mut whole);
    let mut schema = whole.to_value();
    let mut whole = serde_json::Map::new();
    if let Some(root) = schema.as_object_mut() {
        for keyword in ["properties", "required", "additionalProperties"] {
            whole.extend(root.shift_remove(keyword).map(|value| (keyword.to_owned(), value)));
        }
        if let (Some(all), Some(parts)) = (root["$defs"].as_object_mut(), part["$defs"].as_object())
        {
            all.extend(parts.iter().map(|(name, schema)| (format!("Part{name}"), schema.clone())));
        }
        let holds_parts = json!([{ "required": ["extends"] }, { "required": ["patterns"] }]);
        root.insert("if".to_owned(), json!({ "anyOf": holds_parts }));
        let then = json!({
            "properties": part["properties"].take(),
            "required": ["holonom"],
            "anyOf": [{ "required": ["extends"] }, { "required": whole["required"] }],
            "additionalProperties": false,
        });
        root.insert("then".to_owned(), then);
        root.insert("else".to_owned(), whole.into());
    }
    format!("{schema:#}\n")
}
