//! Patterns. The independent truth is the same model with every item written by hand (by a loop here).

use std::fmt::Write as _;

use holonom::error::{Code, Diagnostic, ModelErrors};
use holonom::io::{Document, Syntax};
use holonom::model::Model;
use proptest::prelude::*;
use serde_json::json;

const HEAD: &str = "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, -9.81]\n";

fn document(text: &str) -> Result<Document, ModelErrors> {
    let mut none = |_: &str| Err("no other file".to_owned());
    Document::parse(text, Syntax::Toml, "model.toml", &mut none)
}

fn build(text: &str) -> Result<Model, ModelErrors> {
    Ok(document(&(HEAD.to_owned() + text))?.build()?.0)
}

#[track_caller]
fn model(text: &str) -> Model {
    build(text).unwrap_or_else(|errors| panic!("{}", errors.render()))
}

#[track_caller]
fn refusal(text: &str) -> Diagnostic {
    let errors = build(text).unwrap_err();
    assert_eq!(errors.errors.len(), 1, "{}", errors.render());
    errors.errors[0].clone()
}

/// Equal to the bit: `Debug` of a number is exact.
#[track_caller]
fn assert_same(a: &Model, b: &Model) {
    assert_eq!(format!("{a:#?}"), format!("{b:#?}"));
}

#[test]
fn the_chain_of_the_library_is_the_one_written_by_hand() {
    let mut text = String::from("title = \"Chain of 50 pendulums with stiff joints\"\n[bodies]\n");
    for i in 1..=50 {
        let tip =
            if i == 50 { ", markers = { tip = { point_in_body = [0.05, 0.0] } }" } else { "" };
        let x = format!("{}.{}5", (i - 1) / 10, (i - 1) % 10);
        let inertia = "8.333333333333336e-5";
        writeln!(
            text,
            "link_{i:02} = {{ mass = 0.1, inertia = {inertia}, position = [{x}, 0.0]{tip} }}"
        )
        .unwrap();
    }
    let pair = |i: usize| match i {
        1 => "\"ground\", \"link_01\"".to_owned(),
        i => format!("\"link_{:02}\", \"link_{i:02}\"", i - 1),
    };
    text += "[joints]\n";
    for i in 1..=50 {
        let x = if i == 1 { "0.0" } else { "0.05" };
        let between = pair(i);
        writeln!(text, "joint_{i:02} = {{ type = \"revolute\", between = [{between}], points_in_body = [[{x}, 0.0], [-0.05, 0.0]] }}").unwrap();
    }
    text += "[forces]\n";
    for i in 1..=50 {
        let between = pair(i);
        writeln!(text, "spring_{i:02} = {{ type = \"rsda\", between = [{between}], stiffness = 200.0, damping = 2.0 }}").unwrap();
    }
    text += "[initial]\nangular_velocity = 0.0\n[outputs]\ninterval = 0.01\nchannels = [\"link_50.tip.position\", \"link_01.angle\", \"link_50.angle\", \"joint_01.force\", \"energy.total\", \"energy.imbalance\"]\n[simulation]\nend_time = 1.0\n";
    let by_hand = model(&text);
    let mut library = crate::common::model("chain50");
    library.bodies.iter_mut().for_each(|body| body.shapes.clear());
    assert_same(&Model { simulation: by_hand.simulation.clone(), ..library.clone() }, &by_hand);
    assert_eq!(library.simulation.end_time, Some(1.0));
    // The free chain changes parameters of a file that it extends.
    let mut free = crate::common::model("chain50_free");
    free.bodies.iter_mut().for_each(|body| body.shapes.clear());
    let springs = free.forces.iter().map(|f| format!("{:?}", f.kind));
    assert!(
        free.forces.len() == 50 && springs.into_iter().all(|kind| kind.contains("Linear(0.0)"))
    );
    assert_same(
        &Model {
            title: library.title.clone(),
            forces: library.forces.clone(),
            simulation: library.simulation.clone(),
            ..free
        },
        &library,
    );
}

const ROW: &str = r#"
[parameters]
count = { value = 3 }
length = { value = 0.5 }
[patterns.row]
over.i = { from = 1, to = "=count" }
bodies."link_{i}" = { mass = "=i*length", inertia = 0.01, position = ["=(i - 1)*length", 0.0], markers = { "tip_{i}" = { point = ["=i*length", 0] } } }
joints."joint_{i}" = { type = "revolute", between = ["link_{i-1}", "link_{i}"], point = ["=(i - 1)*length", 0] }
tables."law_{i}" = { x = [-1, 0, 1], y = ["=-i", 0, "=i"] }
forces."spring_{i}" = { type = "rsda", between = ["ground", "link_{i}"], torque = { table = "law_{i}" } }
drivers."hold_{i:03}" = { on = "link_{i}", coordinate = "rotation", motion = { type = "harmonic", amplitude = "=i", angular_frequency = 2.0 } }
initial.bodies."link_{i}" = { angular_velocity = "=2*i" }
outputs.channels = ["link_{i}.tip_{i}.position"]
[bodies]
base = { mass = 1.0, inertia = 1.0, position = [0.0, 1.0] }
[joints]
joint_1 = { between = ["ground", "link_1"] }
[outputs]
channels = ["base.position"]
"#;

fn row_by_hand(count: usize) -> String {
    let mut text = "[outputs]\nchannels = [\"base.position\"".to_owned();
    for i in 1..=count {
        write!(text, ", \"link_{i}.tip_{i}.position\"").unwrap();
    }
    text += "]\n[bodies]\nbase = { mass = 1.0, inertia = 1.0, position = [0.0, 1.0] }\n";
    for i in 1..=count {
        let (x, mass) = ((i as f64 - 1.0) * 0.5, i as f64 * 0.5);
        writeln!(text, "[bodies.link_{i}]\nmass = {mass}\ninertia = 0.01\nposition = [{x}, 0.0]")
            .unwrap();
        writeln!(text, "markers = {{ tip_{i} = {{ point = [{mass}, 0.0] }} }}").unwrap();
        let before = if i == 1 { "ground".to_owned() } else { format!("link_{}", i - 1) };
        writeln!(text, "[joints.joint_{i}]\ntype = \"revolute\"").unwrap();
        writeln!(text, "between = [\"{before}\", \"link_{i}\"]\npoint = [{x}, 0]").unwrap();
        writeln!(text, "[tables.law_{i}]\nx = [-1, 0, 1]\ny = [-{i}, 0, {i}]").unwrap();
        writeln!(
            text,
            "[forces.spring_{i}]\ntype = \"rsda\"\nbetween = [\"ground\", \"link_{i}\"]"
        )
        .unwrap();
        writeln!(text, "torque = {{ table = \"law_{i}\" }}").unwrap();
        writeln!(text, "[drivers.hold_{i:03}]\non = \"link_{i}\"\ncoordinate = \"rotation\"")
            .unwrap();
        writeln!(text, "[drivers.hold_{i:03}.motion]\ntype = \"harmonic\"\namplitude = {i}")
            .unwrap();
        writeln!(text, "angular_frequency = 2.0\n[initial.bodies.link_{i}]").unwrap();
        writeln!(text, "angular_velocity = {}", 2 * i).unwrap();
    }
    text
}

#[cfg(feature = "long")] // half a gigabyte is written before the limit is met
#[test]
fn what_expressions_grow_to_counts() {
    let mass = "*i".repeat(30_000);
    let body =
        format!("\"b_{{i}}\" = {{ mass = \"=0{mass}\", inertia = 1.0, position = [0.0, 0.0] }}");
    let found = refusal(&one("{ from = 10_001, to = 15_000 }", &body));
    assert_eq!((found.code, found.path.as_str()), (Code::TooLarge, "patterns.p"));
}

#[test]
fn titles_of_repeated_items_are_texts_with_numbers() {
    let titled =
        r#"{ title = "part {i} of {{3}}", mass = 1.0, inertia = 1.0, position = [0.0, 0.0] }"#;
    let text = one("{ from = 1, to = 2 }", &format!("\"b_{{i}}\" = {titled}"));
    let plain = document(&(HEAD.to_owned() + &text)).unwrap().to_plain_json().unwrap();
    let plain: serde_json::Value = serde_json::from_str(&plain).unwrap();
    let title = |body: &str| plain["bodies"][body]["title"].as_str().unwrap().to_owned();
    assert_eq!([title("b_1"), title("b_2")], ["part 1 of {3}", "part 2 of {3}"]);
}

#[test]
fn a_whole_item_beside_a_range_is_no_exception() {
    let own = "[bodies.link_0]\nmass = 7.0\ninertia = 1.0\nposition = [0.0, 0.0]\n";
    let m = model(&(ROW.to_owned() + own));
    assert_eq!((m.bodies.len(), m.bodies[1].mass), (5, 7.0));
}

#[test]
fn every_section_is_repeated_and_plain_items_come_first() {
    let m = model(ROW);
    assert_same(&m, &model(&row_by_hand(3)));
    let names: Vec<_> = m.bodies.iter().map(|b| b.name.as_str()).collect();
    assert_eq!(names, ["base", "link_1", "link_2", "link_3"]);
    // Where the patterns stand in the file does not matter.
    let (before, after) = ROW.split_once("[bodies]").unwrap();
    assert_same(&m, &model(&format!("[bodies]{after}{before}")));
}

#[test]
fn new_values_may_change_numbers_exceptions_and_how_often() {
    let text = HEAD.to_owned() + ROW;
    let with = |values: &[(&str, serde_json::Value)]| {
        let changed = document(&text).unwrap().with_values(values);
        changed.and_then(|d| d.build()).map(|(model, _)| model)
    };
    for count in [1, 2, 7] {
        let path = "parameters.count";
        assert_same(&with(&[(path, json!(count))]).unwrap(), &model(&row_by_hand(count)));
    }
    let to = |n: u32| ("patterns.row.over.i.to", json!(n));
    assert_same(&with(&[to(5)]).unwrap(), &model(&row_by_hand(5)));
    // One value of all repetitions, and of one; lists are stated as a whole.
    let all = r#"patterns.row.bodies."link_{i}".inertia"#;
    let m = with(&[(all, json!("=i")), ("bodies.link_2.inertia", json!(9.0))]).unwrap();
    assert_eq!(m.bodies[1..].iter().map(|b| b.inertia[2][2]).collect::<Vec<_>>(), [1.0, 9.0, 3.0]);
    let m = with(&[("bodies.link_3.position[1]", json!(4.0))]).unwrap();
    assert_eq!(m.bodies[3].position, [1.0, 4.0, 0.0]);
    let m = with(&[("forces.spring_2.damping", json!(4.0))]).unwrap(); // not written anywhere yet
    assert!(format!("{:?}", m.forces[1]).contains("damping: 4.0"));
    // The order of the call does not matter.
    let m = with(&[("initial.bodies.link_4.angle", json!(0.1)), to(4)]).unwrap();
    assert_eq!(m.bodies.len(), 5);
    assert!(m.initial.bodies[4].orientation.is_some());
    let m = with(&[("joints.joint_3.enabled", json!(false))]).unwrap();
    assert_eq!(m.joints.len(), 2);
    for (path, part) in [
        ("bodies.link_4.mass", "did you mean `link_1`"),
        ("bodies.link_2.mas", "`mass`"),
        ("forces.spring_2.stifness", "`stiffness`"),
        ("initial.bodies.link_4.angle", "no `link_4`"),
        (r#"patterns.row.bodies."link_{i}".mas"#, "`mass`"),
        (r#"patterns.row.bodies."link_{j}".mass"#, "`link_{i}`"),
        ("patterns.row.over.j.to", "`i`"),
        ("bodies.link_3.position[2]", "2 entries"),
    ] {
        let errors = with(&[(path, json!(1.0))]).unwrap_err();
        assert_eq!(errors.errors[0].code, Code::UnknownPath, "{path}");
        assert!(errors.render().contains(part), "{path}: {}", errors.render());
    }
    let errors = with(&[("parameters.count", json!(2.5))]).unwrap_err();
    let found = &errors.errors[0];
    assert_eq!((found.code, found.path.as_str()), (Code::OutOfRange, "patterns.row.over.i.to"));
    assert!(found.message.contains("2.5") && found.message.contains("parameter `count`"));
}

#[test]
fn a_variant_changes_ranges_and_items() {
    let base = HEAD.to_owned() + ROW;
    let build = |variant: &str| {
        let text = format!("holonom = 1\nextends = \"../row/model.toml\"\n{variant}");
        let mut files = |_: &str| Ok(base.clone());
        let read = Document::parse(&text, Syntax::Toml, "v/model.toml", &mut files);
        read.and_then(|d| d.build()).unwrap_or_else(|e| panic!("{}", e.render())).0
    };
    assert_same(&build(""), &model(ROW));
    assert_same(
        &build("[patterns.row.over.i]\nto = 6\n[parameters]\ncount = { value = 2 }"),
        &model(&row_by_hand(6)),
    );
    let lighter =
        build("[patterns.row.bodies]\n\"link_{i}\" = { mass = 0.5 }\n[bodies]\nlink_3.mass = 2.0");
    assert_eq!(lighter.bodies.iter().map(|b| b.mass).collect::<Vec<_>>(), [1.0, 0.5, 0.5, 2.0]);
    let without = build("[joints]\njoint_2 = { enabled = false }\n");
    assert_eq!(
        without.joints.iter().map(|j| j.name.as_str()).collect::<Vec<_>>(),
        ["joint_1", "joint_3"]
    );
    let none = build("[patterns.row]\nenabled = false\n[joints]\njoint_1 = { enabled = false }\n");
    assert_eq!((none.bodies.len(), none.joints.len()), (1, 0));
}

#[test]
fn the_merged_text_keeps_patterns_and_the_plain_text_writes_them_out() {
    let text = HEAD.to_owned() + ROW + "[forces]\nspring_2 = { enabled = false }\n";
    let first = document(&text).unwrap();
    let m = first.build().unwrap().0;
    assert_eq!(m.forces.len(), 2);
    let json = |text: &str| {
        let mut none = |_: &str| Err(String::new());
        Document::parse(text, Syntax::Json, "x.json", &mut none).unwrap()
    };
    let again = json(&first.to_json());
    assert_eq!(first.to_json(), again.to_json());
    assert_same(&m, &again.build().unwrap().0);
    let more = again.with_values(&[("parameters.count", json!(9))]).unwrap().build().unwrap().0;
    assert_eq!(more.bodies.len(), 10);
    let plain = first.to_plain_json().unwrap();
    assert!(!plain.contains("patterns") && plain.contains("\"link_3\""));
    assert_same(&m, &json(&plain).build().unwrap().0);
}

#[test]
fn indices_nest_and_divide() {
    let m = model(
        r#"
[patterns.grid]
over.i = { from = 0, to = 2 }
over.j = { from = 0, to = "=i" }
bodies."node_{i}_{j}" = { mass = 1.0, inertia = "=10*i + j", position = ["=i", "=-j"] }
[patterns.tree]
over.i = { from = 1, to = 7 }
bodies."b{i}" = { mass = 1.0, inertia = 1.0, position = ["=i", "=floor(log(i)/log(2) + 1e-9)"] }
joints."t{i}" = { type = "revolute", between = ["b{i//2}", "b{i}"], point = ["=i//2", "=i % 2"] }
[patterns.nothing]
over.i = { from = 1, to = 0 }
bodies."x{i}" = { mass = 1.0, inertia = 1.0, position = [0.0, 0.0] }
[joints]
t1 = { between = ["ground", "b1"] }
"#,
    );
    let names: Vec<_> = m.bodies.iter().map(|b| b.name.as_str()).collect();
    let nodes = ["node_0_0", "node_1_0", "node_1_1", "node_2_0", "node_2_1", "node_2_2"];
    assert_eq!(names[..6], nodes);
    assert_eq!(m.bodies[4].inertia[2][2], 21.0);
    assert_eq!(m.bodies[4].position, [2.0, -1.0, 0.0]);
    let parents: Vec<_> = m.joints.iter().map(|j| j.frames[0].body.map(|b| names[b])).collect();
    let of = |name| Some(name);
    assert_eq!(parents, [None, of("b1"), of("b1"), of("b2"), of("b2"), of("b3"), of("b3")]);
    assert_eq!(names.len(), 13);
}

/// A pattern of one body, with something to change.
fn one(range: &str, body: &str) -> String {
    format!("[patterns.p]\nover.i = {range}\nbodies.{body}\n")
}

const FINE: &str = r#""b_{i}" = { mass = 1.0, inertia = 1.0, position = [0.0, 0.0] }"#;

#[test]
fn what_cannot_be_repeated_is_refused_with_place_and_index() {
    let body = |name: &str, mass: &str| {
        format!("\"{name}\" = {{ mass = {mass}, inertia = 1.0, position = [0.0, 0.0] }}")
    };
    let range = "{ from = 1, to = 3 }";
    let at = "patterns.p.over.i.to";
    for (text, code, path, parts) in [
        (
            one(range, &body("b_{i/2}", "1.0")),
            Code::Expression,
            r#"patterns.p.bodies."b_{i/2}""#,
            &["0.5", "whole", "i = 1"][..],
        ),
        (
            one(range, &body("b_{j}", "1.0")),
            Code::UnknownName,
            r#"patterns.p.bodies."b_{j}""#,
            &["`j`", "i = 1"],
        ),
        (
            one(range, &body("b_{i", "1.0")),
            Code::Expression,
            r#"patterns.p.bodies."b_{i""#,
            &["`}`"],
        ),
        (
            one(range, &body("b_{i:x}", "1.0")),
            Code::Expression,
            r#"patterns.p.bodies."b_{i:x}""#,
            &[":x"],
        ),
        (
            one(range, &body("b_{i}", "\"=2 - i\"")),
            Code::OutOfRange,
            r#"patterns.p.bodies."b_{i}".mass"#,
            &["`bodies.b_3.mass` is -1", "i = 3", "=2 - i"],
        ),
        (
            one(range, &body("b_{i}", "\"=1/(i - 2)\"")),
            Code::NotFinite,
            r#"patterns.p.bodies."b_{i}".mass"#,
            &["=1/(2 - 2)", "i = 2"],
        ),
        (
            one(range, &body("b_{i}", "\"=2*i +\"")),
            Code::Expression,
            r#"patterns.p.bodies."b_{i}".mass"#,
            &["the end", "i = 1 and 2 more"],
        ),
        (
            one(range, &body("b_{i}", "\"=j\"")),
            Code::UnknownName,
            r#"patterns.p.bodies."b_{i}".mass"#,
            &["`j`", "i = 1 and 2 more"],
        ),
        (
            one(range, r#""b_{i}" = { mass = 1.0, inertia = 1.0, position = [0, 0], masss = 1 }"#),
            Code::UnknownField,
            r#"patterns.p.bodies."b_{i}".masss"#,
            &["did you mean `mass`", "i = 1 and 2 more"],
        ),
        (
            one(range, r#""b_{i}" = { mass = 1.0, inertia = 1.0 }"#),
            Code::MissingField,
            r#"patterns.p.bodies."b_{i}".position"#,
            &["i = 1 and 2 more"],
        ),
        // An exception of an item that the range does not reach: one finding, not one per field.
        (
            one(range, FINE) + "[bodies.b_7]\nmass = 2.0\n",
            Code::UnknownName,
            "bodies.b_7",
            &["`patterns.p` makes no `bodies.b_7`", "(i = 1 to 3)"],
        ),
        (
            one("{ from = 1, to = 0 }", FINE) + "[bodies.b_1]\nmass = 2.0\n",
            Code::UnknownName,
            "bodies.b_1",
            &["makes no `bodies.b_1` (no i)"],
        ),
        (
            one(range, FINE) + "[joints.pin]\nbetween = [\"ground\", \"b_1\"]\n",
            Code::MissingField,
            "joints.pin.type",
            &["`type`"],
        ),
        (
            one(range, &body("b {i}", "1.0")),
            Code::BadName,
            r#"patterns.p.bodies."b {i}""#,
            &["' '", "i = 1 and 2 more"],
        ),
        (one("{ from = 3, to = 1 }", FINE), Code::OutOfRange, at, &["from 3 to 1"]),
        (one("{ from = 1, to = 2.5 }", FINE), Code::OutOfRange, at, &["2.5", "whole"]),
        (one("{ from = 1, to = \"=1/2\" }", FINE), Code::OutOfRange, at, &["0.5", "=1/2"]),
        (one("{ from = 1, to = \"=n\" }", FINE), Code::UnknownName, at, &["`n`"]),
        (one("{ from = 1, to = \"=(1\" }", FINE), Code::Expression, at, &["`)`"]),
        (one("{ from = 1, to = \"n\" }", FINE), Code::WrongType, at, &["number"]),
        (one("{ from = 1 }", FINE), Code::MissingField, at, &["`to`"]),
        (
            one("{ from = 1, to = 3, step = 2 }", FINE),
            Code::UnknownField,
            "patterns.p.over.i.step",
            &["`step`"],
        ),
        (one("{ from = 1, to = 1e9 }", FINE), Code::TooLarge, at, &["100000"]),
        (
            one("{ from = 1, to = 50_000 }", FINE)
                + "[patterns.q]\nover.i = { from = 1, to = 50_001 }\nbodies.\"c_{i}\" = {}",
            Code::TooLarge,
            "patterns.q",
            &["`bodies`"],
        ),
        (
            one(
                "{ from = 1, to = 100_000 }",
                &format!("\"b_{{i}}\" = {{ title = \"{}\" }}", "x".repeat(60_000)),
            ),
            Code::TooLarge,
            "patterns.p",
            &["values"],
        ),
        (
            one(range, FINE) + "[patterns.q]\nover.j = { from = 3, to = 4 }\nbodies.\"b_{j}\" = {}",
            Code::DuplicateName,
            r#"patterns.q.bodies."b_{j}""#,
            &["bodies.b_3", "j = 3", "i = 3", r#"patterns.p.bodies."b_{i}""#],
        ),
        (
            one(range, &body("b_{i//2}", "1.0")),
            Code::DuplicateName,
            r#"patterns.p.bodies."b_{i//2}""#,
            &["bodies.b_1", "i = 2", "i = 3"],
        ),
        (
            one(range, FINE) + "[parameters]\nb_2 = { value = 1 }",
            Code::DuplicateName,
            "parameters.b_2",
            &["bodies.b_2"],
        ),
        (
            one(range, FINE) + "[parameters]\ni = { value = 1 }",
            Code::BadName,
            "patterns.p.over.i",
            &["parameter"],
        ),
        (
            one(range, FINE) + "over.x-y = { from = 1, to = 2 }",
            Code::BadName,
            "patterns.p.over.x-y",
            &["x-y"],
        ),
        ("[patterns.p]\nover = {}".to_owned(), Code::OutOfRange, "patterns.p.over", &["over.i"]),
        ("[patterns.p]\n".to_owned(), Code::MissingField, "patterns.p.over", &["over"]),
        (one(range, FINE) + "rods.x = 1", Code::UnknownField, "patterns.p.rods", &["`rods`"]),
        (
            one(range, FINE) + "initial.velocity = [0, 0]",
            Code::UnknownField,
            "patterns.p.initial.velocity",
            &["velocity"],
        ),
        (
            one(range, FINE) + "initial.bodies.\"c_{i}\" = { angle = 1.0 }",
            Code::UnknownName,
            r#"patterns.p.initial.bodies."c_{i}""#,
            &["c_1", "i = 1 and 2 more"],
        ),
        (
            one(range, FINE) + "outputs.channels = [\"energy.total\", \"c_{i}.position\"]",
            Code::UnknownName,
            "patterns.p.outputs.channels[1]",
            &["c_1", "i = 1 and 2 more"],
        ),
        (
            one(range, FINE)
                + "joints.\"j_{i}\" = { type = \"fixed\", between = [\"b_{i-1}\", \"b_{i}\"], point = [0, 0] }",
            Code::UnknownName,
            r#"patterns.p.joints."j_{i}".between[0]"#,
            &["b_0", "i = 1)"],
        ),
    ] {
        let found = refusal(&text);
        let rendered = found.render();
        assert_eq!((found.code, found.path.as_str()), (code, path), "{rendered}");
        for part in parts {
            assert!(rendered.contains(part), "{part}: {rendered}");
        }
        assert!(found.location.is_some(), "{rendered}");
    }
}

#[test]
fn an_exception_is_marked_where_it_is_stated() {
    let text =
        one("{ from = 1, to = 3 }", FINE) + "[bodies]\nb_2 = { mass = -1 }\nb_3 = { mas = 1 }";
    let errors = build(&text).unwrap_err().errors;
    let found: Vec<_> =
        errors.iter().map(|e| (e.path.as_str(), e.location.as_ref().unwrap().line)).collect();
    assert_eq!(found, [("bodies.b_3.mas", 9)], "{errors:?}");
    let errors = build(&text.replace("mas =", "mass =")).unwrap_err().errors;
    assert_eq!(
        (errors[0].path.as_str(), errors[0].location.as_ref().unwrap().line),
        ("bodies.b_2.mass", 8)
    );
}

#[test]
fn a_warning_is_said_once() {
    let text = HEAD.to_owned()
        + &one(
            "{ from = 1, to = 500 }",
            &FINE.replace("mass = 1.0, inertia = 1.0", "mass = 1e-8, inertia = 0"),
        );
    let (_, warnings) = document(&text).unwrap().build().unwrap();
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert_eq!(warnings[0].path, r#"patterns.p.bodies."b_{i}".mass"#);
    assert!(warnings[0].message.contains("`b_1`") && warnings[0].message.contains("499 more"));
    assert_eq!(warnings[0].location.as_ref().unwrap().line, 6);
}

#[test]
fn numbers_are_expressions_outside_of_patterns_too() {
    let body = |mass: &str| {
        format!(
            "[bodies]\nb = {{ mass = \"{mass}\", inertia = 1.0, position = [0, 0] }}\n[parameters]\nk = {{ value = 3 }}\nk-2 = {{ value = 5 }}\n"
        )
    };
    for (mass, value) in
        [("=2*k", 6.0), ("=k-2", 5.0), ("=k - 2", 1.0), ("= sqrt(k + 1)/pi*pi", 2.0)]
    {
        let m = model(&body(mass));
        assert_eq!(m.bodies[0].mass, value, "{mass}");
    }
    let errors = build(&body("=2*k-3 + q").replace("k-2", "q-2")).unwrap_err();
    assert!(errors.render().contains("`q`"), "{}", errors.render());
    // A parameter that only arithmetic uses is used.
    let text = HEAD.to_owned() + &body("=2*k").replace("k-2 =", "#");
    assert!(document(&text).unwrap().build().unwrap().1.is_empty());
}

#[test]
fn an_index_that_is_put_in_makes_no_name_of_a_parameter() {
    let text = r#"
[parameters]
k = { value = 10 }
k-2 = { value = 99 }
[patterns.p]
over.i = { from = 1, to = 3 }
bodies."b{i}" = { mass = 1.0, inertia = 1.0, position = ["=k-i", "=k-{i + 1}"] }
"#;
    // What braces make is a name on purpose.
    let m = model(&text.replace("\"=k-{i + 1}\"", "\"=i-k\""));
    let positions: Vec<_> = m.bodies.iter().map(|body| body.position).collect();
    assert_eq!(positions, [[9.0, -9.0, 0.0], [8.0, -8.0, 0.0], [7.0, -7.0, 0.0]]);
    assert_eq!(model(text).bodies[0].position, [9.0, 99.0, 0.0]);
}

#[test]
fn parameters_are_expressions_of_each_other_in_any_order() {
    let text = HEAD.to_owned()
        + r#"
[parameters]
volume = { value = "=area*length" }
area = { value = "=pi*r-i^2" }
length = { value = "=2*count" }
count = { value = 3 }
r-i = { value = 0.5 }
radius = { value = "=r-i" }
density = { value = "=mass/volume" }
mass = { value = 6 }
[patterns.row]
over.i = { from = 1, to = "=length/2" }
bodies."b_{i}" = { mass = "=i*mass", inertia = "=radius", position = ["=volume", "=density"] }
"#;
    // `r-i` can stand alone only.
    let errors = document(&text).unwrap().build().unwrap_err();
    assert!(errors.render().contains("`r-i` can stand alone only"), "{}", errors.render());
    assert_eq!(errors.errors.len(), 1, "what follows from it is not reported");
    let d = document(&text.replace("pi*r-i^2", "pi*radius^2")).unwrap();
    let (m, warnings) = d.build().unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    let volume = std::f64::consts::PI * 0.25 * 6.0;
    assert_eq!(m.bodies.len(), 3);
    assert_eq!((m.bodies[2].mass, m.bodies[2].position), (18.0, [volume, 6.0 / volume, 0.0]));
    // What is set carries on to what depends on it, and an expression can be set.
    let set = [("parameters.count", json!(4)), ("parameters.mass", json!("=2*density0"))];
    let errors = d.with_values(&set).unwrap().build().unwrap_err();
    assert_eq!(errors.errors[0].path, "parameters.mass.value");
    let set = [("parameters.count", json!(4)), ("parameters.mass", json!("=2*count"))];
    let m = d.with_values(&set).unwrap().build().unwrap().0;
    assert_eq!((m.bodies.len(), m.bodies[3].mass), (4, 32.0));
    // No number comes of it: said once, where it is written.
    for (radius, code) in [("=1/0", Code::NotFinite), ("=sqrt(-count)", Code::NotFinite)] {
        let d = d.with_values(&[("parameters.radius", json!(radius))]).unwrap();
        let errors = d.build().unwrap_err().errors;
        assert_eq!((errors.len(), errors[0].code), (1, code), "{errors:?}");
        assert_eq!(errors[0].path, "parameters.radius.value");
    }
}

#[test] // linear in the number of links: a quadratic step would take minutes here
fn a_long_chain_is_the_one_written_by_hand() {
    let n = 20_000;
    let text = format!(
        "[patterns.chain]\nover.i = {{ from = 1, to = {n} }}\nbodies.\"link_{{i}}\" = {{ mass = 0.1, inertia = 1.0e-4, position = [\"=i - 0.5\", 0.0] }}\n\
         joints.\"j_{{i}}\" = {{ type = \"revolute\", between = [\"link_{{i - 1}}\", \"link_{{i}}\"], point = [\"=i - 1\", 0.0] }}\n\
         [joints]\nj_1.between = [\"ground\", \"link_1\"]\n"
    );
    let mut by_hand = "[bodies]\n".to_owned();
    for i in 1..=n {
        writeln!(
            by_hand,
            "link_{i} = {{ mass = 0.1, inertia = 1.0e-4, position = [{}, 0.0] }}",
            i as f64 - 0.5
        )
        .unwrap();
    }
    by_hand += "[joints]\nj_1 = { type = \"revolute\", between = [\"ground\", \"link_1\"], point = [0, 0] }\n";
    for i in 2..=n {
        writeln!(by_hand, "j_{i} = {{ type = \"revolute\", between = [\"link_{}\", \"link_{i}\"], point = [{}, 0] }}", i - 1, i - 1).unwrap();
    }
    assert_eq!(model(&text), model(&by_hand));
    let errors = build(&text.replace("{i - 1}", "{i - 2}")).unwrap_err();
    assert_eq!(errors.errors.len() + errors.omitted, 1, "{}", errors.render());
    let values: Vec<_> = (1..=n).map(|i| (format!("bodies.link_{i}.mass"), json!(0.2))).collect();
    let text = HEAD.to_owned() + &text;
    let heavy = document(&text).unwrap().with_values(&values).unwrap().build().unwrap().0;
    assert!(heavy.bodies.iter().all(|body| body.mass == 0.2));
    let light = HEAD.to_owned()
        + &by_hand.replace("mass = 0.1, inertia = 1.0e-4", "mass = 1e-8, inertia = 0");
    let warnings = document(&light).unwrap().build().unwrap().1;
    assert_eq!(warnings.len(), n);
    assert_eq!(warnings[n - 1].location.as_ref().unwrap().line, 3 + 1 + n);
}

proptest! {
    #[test]
    fn a_pattern_is_the_text_written_by_hand(
        from in -3i64..4, count in 1i64..6, wide in 1i64..4, digits in 1usize..4,
        (a, b, c) in (-2.0..2.0f64, 0.1..3.0f64, 1i64..4), but in 0i64..30,
    ) {
        let (to, last) = (from + count - 1, wide - 1);
        let mut text = format!(
            "[parameters]\nb = {{ value = {b} }}\nhigh = {{ value = {last} }}\n[patterns.p]\n\
             over.i = {{ from = {from}, to = {to} }}\nover.j = {{ from = 0, to = \"=high\" }}\n"
        );
        writeln!(text, "bodies.\"b_{{i:0{digits}}}_{{{c}*j + (i % 2)}}\" = {{ mass = \"=b + i^2\", inertia = {b}, position = [\"={a}*(i - j)/{c}\", \"=b*j - i\"] }}").unwrap();
        let mut by_hand = "[bodies]\n".to_owned();
        let mut items = 0;
        for i in from..=to {
            for j in 0..=last {
                let name = format!("b_{i:0digits$}_{}", c * j + i.rem_euclid(2));
                let (x, y) = (i as f64, j as f64);
                let other = items == but;
                let mass = if other { 7.0 } else { b + x * x };
                if other {
                    write!(text, "[bodies]\n{name}.mass = 7.0\n").unwrap();
                }
                writeln!(by_hand, "{name} = {{ mass = {mass:?}, inertia = {b}, position = [{:?}, {:?}] }}", a * (x - y) / c as f64, b * y - x).unwrap();
                items += 1;
            }
        }
        let (found, expected) = (build(&text).unwrap(), build(&by_hand).unwrap());
        prop_assert_eq!(format!("{found:?}"), format!("{expected:?}"));
        prop_assert_eq!(found.bodies.len() as i64, count * wide);
    }
}
