//! The committed pages are what the code says. `HOLONOM_WRITE=1 cargo test` rewrites them.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use holonom::error::{Code, Severity};
use holonom::io::{Document, Syntax, json_schema, reference_markdown};

fn page(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../docs").join(name)
}

#[track_caller]
fn assert_page(name: &str, expected: &str) {
    let path = page(name);
    if std::env::var_os("HOLONOM_WRITE").is_some() {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, expected).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(found == expected, "docs/{name} is old: run HOLONOM_WRITE=1 cargo test -p holonom");
}

#[test]
fn the_reference_page_is_what_the_schema_says() {
    assert_page("model-file.md", &reference_markdown());
}

#[test]
fn the_page_of_errors_lists_every_code_of_models() {
    let (begin, end) = ("<!-- model codes -->\n", "<!-- end of model codes -->");
    let path = page("errors.md");
    let text = std::fs::read_to_string(&path).unwrap();
    let (before, rest) = text.split_once(begin).unwrap();
    let (_, after) = rest.split_once(end).unwrap();
    let rows: Vec<String> = Code::ALL
        .iter()
        .map(|code| {
            let severity = match code.severity() {
                Severity::Error => "error",
                Severity::Warning => "warning",
            };
            format!("| `{}` | {severity} | {} |\n", code.as_str(), code.meaning())
        })
        .collect();
    let head = "| code | severity | meaning |\n| --- | --- | --- |\n";
    assert_page("errors.md", &format!("{before}{begin}{head}{}{end}{after}", rows.concat()));
}

/// Texts of the sources of a folder, tests left out.
fn sources(folder: &Path, ending: &str, out: &mut Vec<String>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, ending, out);
        } else if path.extension().is_some_and(|e| e == ending) {
            out.push(std::fs::read_to_string(path).unwrap());
        }
    }
}

/// Codes of the form `family/some-words` between quotation marks, models' left out.
fn codes(text: &str, quote: char, out: &mut BTreeSet<String>) {
    const FAMILIES: [&str; 6] = ["assembly", "simulation", "usage", "file", "result", "holonom"];
    for part in text.split(quote) {
        let words =
            |s: &str| !s.is_empty() && s.chars().all(|c| c.is_ascii_lowercase() || c == '-');
        if let Some((family, name)) = part.split_once('/')
            && FAMILIES.contains(&family)
            && words(name)
        {
            out.insert(part.to_owned());
        }
    }
}

#[test] // independent truth: the texts between quotation marks in the sources
fn the_page_of_errors_lists_every_code_of_runs_files_and_commands() {
    let root = page("..");
    let mut texts = Vec::new();
    for crate_name in ["holonom", "holonom-py"] {
        sources(&root.join("crates").join(crate_name).join("src"), "rs", &mut texts);
    }
    sources(&root.join("python/holonom"), "py", &mut texts);
    let (mut used, mut listed) = (BTreeSet::new(), BTreeSet::new());
    texts.iter().for_each(|text| codes(text, '"', &mut used));
    let text = std::fs::read_to_string(page("errors.md")).unwrap();
    codes(&text, '`', &mut listed);
    assert!(used.len() > 25, "{used:?}");
    assert_eq!(used, listed);
}

#[test]
fn the_readme_names_every_code_and_parametrization() {
    let text = std::fs::read_to_string(page("../README.md")).unwrap();
    let codes = holonom::method::CODES.iter().map(|i| format!("`{}`", i.name));
    let choices =
        holonom::reduction::ParametrizationKind::ALL.iter().map(|(_, name)| format!("\"{name}\""));
    for name in codes.chain(choices) {
        assert!(text.contains(&name), "{name}");
    }
}

/// Fenced blocks of a language.
fn blocks<'a>(text: &'a str, language: &str) -> Vec<&'a str> {
    let fence = format!("```{language}\n");
    text.split(&fence).skip(1).map(|rest| rest.split("```").next().unwrap()).collect()
}

#[test]
fn the_examples_of_the_reference_page_are_models() {
    let text = reference_markdown();
    let toml = blocks(&text, "toml");
    assert_eq!(toml.len(), 4);
    let base = toml[0];
    let json = blocks(&text, "json");
    let all = toml.iter().map(|t| (Syntax::Toml, t)).chain(json.iter().map(|t| (Syntax::Json, t)));
    for (syntax, example) in all {
        let mut files = |_: &str| Ok(base.to_owned());
        let (_, warnings) = Document::parse(example, syntax, "docs/model-file.md", &mut files)
            .and_then(|document| document.build())
            .unwrap_or_else(|errors| panic!("{}", errors.render()));
        assert!(warnings.is_empty(), "{}", warnings[0].render());
    }
}

#[test] // the page shows a message: it is the message of the program
fn the_message_of_the_reference_page_is_real() {
    let text = reference_markdown();
    let wrong = blocks(&text, "toml")[0].replace("\"rod\"], point", "\"rod\"], pont");
    let mut none = |_: &str| Err(String::new());
    let errors = Document::parse(&wrong, Syntax::Toml, "model.toml", &mut none)
        .and_then(|document| document.build())
        .unwrap_err();
    assert!(text.contains(&errors.errors[0].render()), "{}", errors.errors[0].render());
    let chain = blocks(&text, "toml")[3];
    let wrong = chain.replace("mass = \"=mass\"", "mass = \"=mass*(1 - i/32)\"");
    let errors = Document::parse(&wrong, Syntax::Toml, "model.toml", &mut none)
        .and_then(|document| document.build())
        .unwrap_err();
    let found = errors.errors[0].render();
    assert!(text.contains(found.lines().next().unwrap()), "{found}");
}

#[test]
fn the_json_schema_is_one_and_every_field_is_on_the_reference_page() {
    let schema: serde_json::Value = serde_json::from_str(&json_schema()).unwrap();
    assert_eq!(schema["$schema"], "https://json-schema.org/draft/2020-12/schema");
    let mut names = BTreeSet::new();
    properties(&schema, &mut names);
    assert!(names.len() > 90, "{}", names.len());
    let page = reference_markdown();
    // The reader takes expressions for all numbers but whole ones.
    let fields = |of: &str| &schema["$defs"][of]["properties"];
    for (of, field) in [("Parameter", "value"), ("Outputs", "interval")] {
        assert_eq!(fields(of)[field]["type"], serde_json::json!(["number", "string"]));
    }
    for name in names {
        let said_once = ["type", "title", "enabled"].contains(&name.as_str());
        assert!(said_once || page.contains(&format!("| `{name}`")), "{name}");
    }
}

fn properties(schema: &serde_json::Value, names: &mut BTreeSet<String>) {
    if let Some(map) = schema["properties"].as_object() {
        names.extend(map.keys().cloned());
    }
    match schema {
        serde_json::Value::Object(map) => map.values().for_each(|v| properties(v, names)),
        serde_json::Value::Array(list) => list.iter().for_each(|v| properties(v, names)),
        _ => {}
    }
}
