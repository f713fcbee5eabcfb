//! Keeps the arrows between the rooms of the engine, and what no room may touch.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// What each room may use; the same table stands in ARCHITECTURE.md.
const MAY_USE: &[(&str, &[&str])] = &[
    ("math", &[]),
    ("model", &["math"]),
    ("topology", &["model"]),
    ("elements", &["math", "model"]),
    ("system", &["elements", "topology", "model", "math"]),
    ("reduction", &["system", "model", "math"]),
    ("newton", &["reduction", "system", "model", "math"]),
    ("formula", &[]),
    ("control", &[]),
    ("method", &["newton", "reduction", "system", "formula", "control", "model", "math"]),
    (
        "simulation",
        &["method", "newton", "reduction", "system", "formula", "control", "topology", "model"],
    ),
    (
        "analysis",
        &[
            "simulation",
            "method",
            "newton",
            "reduction",
            "system",
            "formula",
            "control",
            "elements",
            "topology",
            "model",
            "math",
        ],
    ),
    ("io", &["model", "simulation", "math"]),
];
/// Open to every room.
const COMMON: &[&str] = &["error", "testing", "threads", "watch"];
/// Rooms that may use the crate of matrices.
const MAY_USE_LINALG: &[&str] = &["system", "reduction", "newton", "analysis"];
/// The core takes readers and writers and has no network, no files and no environment.
const OUTSIDE: &[&str] =
    &["std::fs", "std::net", "std::env", "std::process", "println!", "eprintln!"];

#[test]
fn arrows_between_rooms_point_one_way() {
    let faults = faults(&source());
    assert!(faults.is_empty(), "\n{faults}");
}

#[test] // else a new room would be free of every rule
fn every_room_has_a_row() {
    let known: BTreeSet<_> = MAY_USE.iter().map(|row| row.0.to_owned()).collect();
    let built: BTreeSet<_> = fs::read_dir(source())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .map(|name| name.trim_end_matches(".rs").to_owned())
        .filter(|name| name != "lib" && !COMMON.contains(&name.as_str()))
        .collect();
    assert_eq!(built, known);
}

#[test] // else a newcomer would not find them
fn every_file_stands_in_the_table_of_its_room() {
    let mut missing = String::new();
    for &(room, _) in MAY_USE {
        let folder = source().join(room);
        let table = fs::read_to_string(folder.join("README.md")).unwrap_or_default();
        visit(&folder, &mut |file, _| {
            let within = file.strip_prefix(&folder).unwrap();
            let name = file.file_name().unwrap().to_string_lossy();
            let first = within.iter().next().unwrap().to_string_lossy();
            let told = table.contains(&*name) || table.contains(&format!("{first}/"));
            let is_test = name.starts_with("test") || name.ends_with("tests.rs");
            if !told && name != "mod.rs" && !is_test && first != "tests" {
                writeln!(missing, "{}", within.display()).unwrap();
            }
        });
    }
    assert!(missing.is_empty(), "in no README of its room:\n{missing}");
}

#[test] // a check that finds nothing in a faulty tree would be worth nothing
fn a_wrong_arrow_is_named_with_its_file_and_line() {
    let tree = Path::new(env!("CARGO_TARGET_TMPDIR")).join("faulty");
    let room = tree.join("formula");
    fs::create_dir_all(&room).unwrap();
    let text = "use crate::formula::Dirk;\nuse crate::{system};\nuse crate::model::Body;\n\
                // crate::system in a comment is no arrow\nuse holonom_linalg::dense;\n\
                let x = std::fs::read(y);\n#[cfg(test)]\nmod tests { use std::fs; }\n";
    fs::write(room.join("mod.rs"), text).unwrap();
    let found = faults(&tree);
    let expected = ["mod.rs:2: ", "mod.rs:3: ", "mod.rs:5: ", "mod.rs:6: "];
    assert_eq!(found.lines().count(), expected.len(), "\n{found}");
    for (line, place) in found.lines().zip(expected) {
        assert!(line.contains(place), "{line}");
    }
}

fn source() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

/// One line per arrow that the tables forbid; comments are not read.
fn faults(source: &Path) -> String {
    let mut faults = String::new();
    for &(room, allowed) in MAY_USE {
        for path in [source.join(room), source.join(room).with_extension("rs")] {
            visit(&path, &mut |file, text| {
                // Tests may read reference files, and solve by other means.
                let name = file.file_name().unwrap_or_default().to_string_lossy();
                let mut shipped = !name.contains("test");
                for (n, line) in text.lines().enumerate() {
                    shipped &= !line.contains("#[cfg(test)]");
                    let code = line.split("//").next().unwrap_or_default();
                    for fault in faults_of_line(room, allowed, code, shipped) {
                        let place = file.display();
                        writeln!(faults, "{place}:{}: `{room}` may not use `{fault}`", n + 1)
                            .unwrap();
                    }
                }
            });
        }
    }
    faults
}

fn faults_of_line(room: &str, allowed: &[&str], code: &str, shipped: bool) -> Vec<String> {
    let mut found = Vec::new();
    for (at, _) in code.match_indices("crate::") {
        let rest = &code[at + "crate::".len()..];
        let end = rest.find(|c: char| c != '_' && !c.is_alphanumeric());
        let used = &rest[..end.unwrap_or(rest.len())]; // empty for `crate::{…}`: refused
        if used != room && !COMMON.contains(&used) && !allowed.contains(&used) {
            found.push(format!("crate::{used}"));
        }
    }
    if shipped && code.contains("holonom_linalg") && !MAY_USE_LINALG.contains(&room) {
        found.push("holonom_linalg".into());
    }
    let outside = OUTSIDE.iter().filter(|name| shipped && code.contains(*name));
    found.extend(outside.map(ToString::to_string));
    found
}

fn visit(path: &Path, check: &mut dyn FnMut(&Path, &str)) {
    if path.is_dir() {
        let mut entries: Vec<_> =
            fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()).collect();
        entries.sort();
        for entry in &entries {
            visit(entry, check);
        }
    } else if path.is_file() && path.extension().is_some_and(|ending| ending == "rs") {
        check(path, &fs::read_to_string(path).unwrap());
    }
}
