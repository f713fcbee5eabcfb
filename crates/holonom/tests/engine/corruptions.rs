//! Single-field corruptions of good models, and damaged texts. Whatever is done to a file, the answer
//! is a model of finite numbers or errors that name what was changed; never a panic.

use std::collections::BTreeSet;

use holonom::error::{Code, ModelErrors};
use holonom::io::{Document, Syntax, json_schema};
use holonom::model::Model;
use proptest::prelude::*;
use serde_json::{Value, json};

const FILES: [(&str, &str); 5] = [
    ("double_pendulum", include_str!("files/double_pendulum.toml")),
    ("spatial", include_str!("files/spatial.toml")),
    ("alternatives", include_str!("files/alternatives.toml")),
    ("planar", include_str!("files/planar.toml")),
    ("units", include_str!("files/units.toml")),
];

fn parse(text: &str, syntax: Syntax) -> Result<Document, ModelErrors> {
    Document::parse(text, syntax, "model", &mut |_: &str| Err("no other file".to_owned()))
}

fn build(text: &str, syntax: Syntax) -> Result<Model, ModelErrors> {
    Ok(parse(text, syntax)?.build()?.0)
}

/// The file as JSON, with what is switched off and all.
fn tree(text: &str) -> Value {
    let enabled = text.replace(", enabled = false", "");
    serde_json::from_str(&parse(&enabled, Syntax::Toml).unwrap().to_json()).unwrap()
}

/// Pointers to all values below the root.
fn pointers(value: &Value, at: &str, out: &mut Vec<String>) {
    let inner: Vec<(String, &Value)> = match value {
        Value::Object(map) => map.iter().map(|(k, v)| (format!("{at}/{k}"), v)).collect(),
        Value::Array(list) => {
            // Long lists are all alike inside: their ends stand for the rest.
            let ends = |i: usize| list.len() <= 3 || i == 0 || i + 1 == list.len();
            let entries = list.iter().enumerate().filter(|(i, _)| ends(*i));
            entries.map(|(i, v)| (format!("{at}/{i}"), v)).collect()
        }
        _ => Vec::new(),
    };
    for (pointer, value) in inner {
        out.push(pointer.clone());
        pointers(value, &pointer, out);
    }
}

/// Stands for a number that JSON cannot hold, put into the text afterwards.
const OVERFLOW: &str = "@overflow@";

fn replacements(old: &Value) -> Vec<Value> {
    let mut deep = json!(1.0);
    for _ in 0..5 {
        deep = json!([deep]);
    }
    let mut too_deep = deep.clone();
    for _ in 0..70 {
        too_deep = json!([too_deep]);
    }
    let mut out = vec![
        json!("text"),
        json!(""),
        json!("=nowhere"),
        json!("1.0"),
        json!("ground"),
        json!(null),
        json!(true),
        json!([]),
        json!({}),
        json!([null]),
        json!(-1.0),
        json!(0.0),
        json!(1e300),
        json!(-1e308),
        json!(1e-300),
        json!({ "type": "x" }),
        json!({ "value": 1.0 }),
        json!([1.0, 2.0]),
        json!([1.0, 2.0, 3.0]),
        json!([1e308, -1e308, 1e308]),
        json!(OVERFLOW),
        deep,
        too_deep,
    ];
    match old {
        Value::Number(x) => out.push(json!(-x.as_f64().unwrap())),
        Value::String(text) => out.push(json!(format!("{text}x"))),
        Value::Array(list) if !list.is_empty() => {
            out.push(json!(list[1..]));
            out.push(json!(list.iter().chain(&list[..1]).collect::<Vec<_>>()));
        }
        _ => {}
    }
    out
}

/// What a user would look for in the message: the field, or the item that it belongs to.
fn names(pointer: &str) -> Vec<&str> {
    let names: Vec<_> = pointer.split('/').filter(|p| p.parse::<usize>().is_err()).collect();
    // The first is empty, the second the section of the file.
    if names.len() > 2 { names[2..].to_vec() } else { names[1..].to_vec() }
}

#[track_caller]
fn answer(name: &str, pointer: &str, change: &str, tree: &Value) -> bool {
    let text = tree.to_string().replace(&format!("\"{OVERFLOW}\""), "1e999");
    let shown = || text.chars().take(300).collect::<String>();
    match build(&text, Syntax::Json) {
        Ok(model) => {
            let debug = format!("{model:?}");
            let finite = !debug.contains("NaN") && !debug.contains("inf");
            assert!(finite, "{name}{pointer} {change}: numbers of the model are not finite");
            true
        }
        Err(errors) => {
            let rendered = errors.render();
            let related = errors.errors.iter().any(|e| {
                let path = e.path.replace(['.', '['], "/").replace([']', '"'], "");
                let path = format!("/{path}");
                path.starts_with(pointer) || pointer.starts_with(&path) && e.path.len() > 1
            });
            assert!(
                related || names(pointer).iter().any(|name| rendered.contains(name)),
                "{name}{pointer} {change}: {rendered}\n{}",
                shown()
            );
            assert!(errors.errors.iter().all(|e| e.location.is_some()), "{name}{pointer} {change}");
            false
        }
    }
}

#[test]
fn every_single_corruption_is_legal_or_named() {
    let counts = std::thread::scope(|scope| {
        let threads = FILES.map(|(name, text)| scope.spawn(move || corrupt_everything(name, text)));
        threads.map(|thread| thread.join().unwrap())
    });
    let accepted: usize = counts.iter().map(|c| c.0).sum();
    let refused: usize = counts.iter().map(|c| c.1).sum();
    assert!(refused > 10_000 && accepted > 1_000, "{accepted} accepted, {refused} refused");
}

/// Changes every value of a file in every way; the numbers of accepted and refused files.
fn corrupt_everything(name: &str, text: &str) -> (usize, usize) {
    let good = tree(text);
    let mut all = Vec::new();
    pointers(&good, "", &mut all);
    let mut legal = Vec::new();
    for pointer in &all {
        let old = good.pointer(pointer).unwrap();
        for new in replacements(old) {
            let mut changed = good.clone();
            *changed.pointer_mut(pointer).unwrap() = new.clone();
            legal.push(answer(name, pointer, &format!("= {new:.60}"), &changed));
        }
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        let mut without = good.clone();
        let mut renamed = good.clone();
        match (without.pointer_mut(parent).unwrap(), renamed.pointer_mut(parent).unwrap()) {
            (Value::Object(map), Value::Object(other)) => {
                map.shift_remove(key);
                legal.push(answer(name, pointer, "removed", &without));
                let value = other.shift_remove(key).unwrap();
                other.insert(format!("{key}x"), value);
                let accepted = answer(name, pointer, "renamed", &renamed);
                legal.push(accepted);
                // Names of items may be free; names of fields are not.
                let sections = ["/initial", "/outputs", "/simulation"];
                let is_item = parent.matches('/').count() == 1 && !sections.contains(&parent);
                let repeated = ["bodies", "joints", "forces", "drivers", "tables"];
                let is_repeated = parent.starts_with("/patterns/")
                    && repeated.iter().any(|of| parent.ends_with(&format!("/{of}")));
                let inner =
                    ["/markers", "/shapes", "/branches"].iter().any(|of| parent.ends_with(of));
                let is_free = is_item || is_repeated || inner;
                assert!(!accepted || is_free, "{name}{pointer} renamed is accepted");
            }
            (Value::Array(list), _) => {
                list.remove(key.parse().unwrap());
                legal.push(answer(name, pointer, "removed", &without));
            }
            _ => unreachable!(),
        }
    }
    let accepted = legal.iter().filter(|legal| **legal).count();
    (accepted, legal.len() - accepted)
}

#[test]
fn a_type_cannot_be_the_one_of_the_other_dimension() {
    for (name, text) in FILES {
        let mut tree = tree(text);
        let other = if tree["dimension"] == "planar" { "spatial" } else { "planar" };
        tree["dimension"] = json!(other);
        let errors = build(&tree.to_string(), Syntax::Json).unwrap_err();
        assert!(errors.errors.iter().all(|e| e.code == Code::WrongDimension), "{name}: {errors}");
    }
}

#[test] // the schema promises these fields: a file that uses them must be accepted
fn every_field_of_the_schema_is_used_by_an_accepted_file() {
    let mut used = BTreeSet::new();
    for (name, text) in FILES {
        assert!(
            build(text, Syntax::Toml).is_ok(),
            "{name}: {}",
            build(text, Syntax::Toml).unwrap_err()
        );
        let mut all = Vec::new();
        pointers(&tree(text), "", &mut all);
        used.extend(all.iter().map(|pointer| pointer.rsplit('/').next().unwrap().to_owned()));
    }
    let schema: Value = serde_json::from_str(&json_schema()).unwrap();
    let mut known = BTreeSet::new();
    fields(&schema, &mut known);
    // What names other files is tested where such files are.
    let elsewhere = ["extends", "file", "enabled"];
    let missing: Vec<_> =
        known.difference(&used).filter(|f| !elsewhere.contains(&f.as_str())).collect();
    assert!(missing.is_empty(), "{missing:?}");
}

fn fields(schema: &Value, names: &mut BTreeSet<String>) {
    if let Some(map) = schema["properties"].as_object() {
        names.extend(map.keys().cloned());
    }
    match schema {
        Value::Object(map) => map.values().for_each(|v| fields(v, names)),
        Value::Array(list) => list.iter().for_each(|v| fields(v, names)),
        _ => {}
    }
}

fn damaged(text: &str, cuts: &[(usize, usize, String)]) -> String {
    let mut text: Vec<char> = text.chars().collect();
    for (at, length, insert) in cuts {
        let at = at % (text.len() + 1);
        let end = (at + length).min(text.len());
        text.splice(at..end, insert.chars());
    }
    text.into_iter().collect()
}

fn cuts() -> impl Strategy<Value = Vec<(usize, usize, String)>> {
    let piece = prop_oneof![
        Just(String::new()),
        "[\\[\\]{}\",:.=0-9eE+-]{1,4}",
        "\\PC{1,3}",
        Just("\u{0}".to_owned()),
        Just("\\u00".to_owned()),
        Just("1e400".to_owned()),
    ];
    proptest::collection::vec((any::<usize>(), 0..6_usize, piece), 1..4)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_toml_never_panics(file in 0..FILES.len(), cuts in cuts()) {
        let text = damaged(FILES[file].1, &cuts);
        if let Err(errors) = build(&text, Syntax::Toml) {
            prop_assert!(!errors.render().is_empty());
        }
    }

    // Independent truth: serde_json decides what JSON is.
    #[test]
    fn json_is_what_json_is(file in 0..FILES.len(), cuts in cuts()) {
        let text = damaged(&tree(FILES[file].1).to_string(), &cuts);
        let is_json = serde_json::from_str::<Value>(&text);
        match build(&text, Syntax::Json) {
            Ok(_) => prop_assert!(is_json.is_ok(), "accepted: {}", text),
            Err(errors) => {
                let syntax = errors.errors.iter().any(|e| e.code == Code::Syntax);
                let overflow = errors.errors.iter().any(|e| e.code == Code::NotFinite);
                prop_assert_eq!(syntax, is_json.is_err() && !overflow, "{}\n{}", errors, text);
            }
        }
    }
}
