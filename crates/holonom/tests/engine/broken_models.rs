//! Broken model files and the messages they bring. The texts beside the files are what a user should
//! read: they were read by a person when they were committed. `HOLONOM_WRITE=1 cargo test` rewrites
//! them after a change; read them again then.

use std::path::{Path, PathBuf};

use holonom::error::ModelErrors;
use holonom::io::{Document, Syntax, limits};

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/engine/broken")
}

/// Reads files of the folder and no others, as a command does with its tree of models.
fn open(path: &str) -> Result<String, String> {
    if path.starts_with("..") {
        return Err("it lies outside the folder of models".to_owned());
    }
    std::fs::read_to_string(folder().join(path)).map_err(|_| "there is no such file".to_owned())
}

fn refusal(name: &str, text: &str) -> ModelErrors {
    Document::parse(text, Syntax::of_file(name), name, &mut open)
        .and_then(|document| document.build())
        .map(|_| panic!("{name} is accepted"))
        .unwrap_err()
}

fn names() -> Vec<String> {
    let is_model = |p: &Path| p.extension().is_some_and(|e| e == "toml" || e == "json");
    let mut names: Vec<String> = std::fs::read_dir(folder())
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| is_model(path))
        .map(|path| path.file_name().unwrap().to_str().unwrap().to_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn every_broken_file_is_refused_with_its_message() {
    let names = names();
    assert!(names.len() >= 50, "the catalogue has {} files", names.len());
    let mut different = Vec::new();
    for name in names {
        let text = std::fs::read_to_string(folder().join(&name)).unwrap();
        let found = refusal(&name, &text).render();
        let beside = folder().join(format!("{name}.txt"));
        if std::env::var_os("HOLONOM_WRITE").is_some() {
            std::fs::write(&beside, &found).unwrap();
        }
        if std::fs::read_to_string(&beside).unwrap_or_default() != found {
            different.push(format!("{name}:\n{found}"));
        }
    }
    assert!(different.is_empty(), "{}", different.join("\n"));
}

#[test]
fn every_message_says_where_and_errors_are_in_file_order() {
    for name in names() {
        let text = std::fs::read_to_string(folder().join(&name)).unwrap();
        let errors = refusal(&name, &text);
        let mut last = (String::new(), 0, 0);
        for error in &errors.errors {
            let at = error.location.as_ref().unwrap_or_else(|| panic!("{name}: {error}"));
            assert!(!error.help.is_empty(), "{name} says nothing to try: {error}");
            assert!(error.render().chars().count() < 2000, "{name}: an endless message");
            assert!(!error.message.contains(|c: char| c.is_control()), "{name}: {error}");
            let here = (at.file.clone(), at.line, at.column);
            assert!(last.0 != here.0 || last <= here, "{name}: {last:?} {here:?}");
            last = here;
        }
    }
}

#[test]
fn sizes_beyond_the_limits_are_refused_before_they_cost_much() {
    let head = "holonom = 1\ndimension = \"planar\"\n";
    let big = format!("{head}title = \"{}\"\n", " ".repeat(limits::FILE_BYTES));
    assert_eq!(refusal("big.toml", &big).errors[0].code.as_str(), "model/too-large");
    let long_text = format!("{head}title = \"{}\"\n", "x".repeat(limits::TEXT_BYTES + 1));
    assert_eq!(refusal("text.toml", &long_text).errors[0].code.as_str(), "model/too-large");
    let list = format!("{head}gravity = [{}]\n", "0,".repeat(limits::LIST_ENTRIES + 1));
    assert_eq!(refusal("list.toml", &list).errors[0].code.as_str(), "model/too-large");
    let items: Vec<String> = (0..=limits::ITEMS).map(|i| format!("b{i}={{}}\n")).collect();
    let bodies = format!("{head}[bodies]\n{}", items.concat());
    assert_eq!(refusal("bodies.toml", &bodies).errors[0].code.as_str(), "model/too-large");
    for (open, close) in [("[", "]"), ("{\"a\":", "}")] {
        let (open, close) = (open.repeat(3_000_000), close.repeat(3_000_000));
        let deep = format!("{{\"holonom\":1,\"title\":{open}1{close}}}");
        assert_eq!(refusal("deep.json", &deep).errors[0].code.as_str(), "model/too-deep");
    }
    for deep in [
        format!("holonom = 1\nx = {}", "[".repeat(3_000_000)),
        format!("holonom = 1\nx = {}", "{a=".repeat(3_000_000)),
        format!("holonom = 1\n{} = 1", vec!["a"; 1_000_000].join(".")),
        format!("holonom = 1\n[{}]", vec!["a"; 1_000_000].join(".")),
    ] {
        assert_eq!(refusal("deep.toml", &deep).errors[0].code.as_str(), "model/too-deep");
    }
}
