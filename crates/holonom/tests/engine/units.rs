//! Files in units of their own.

use std::fmt::Write;

use holonom::error::ModelErrors;
use holonom::io::{Document, Syntax};

fn parse(text: &str) -> Result<Document, ModelErrors> {
    Document::parse(text, Syntax::Toml, "model.toml", &mut |_| Err("none".to_owned()))
}

/// The model, number by number, as text.
fn model(text: &str) -> String {
    described(parse(text))
}

fn described(document: Result<Document, ModelErrors>) -> String {
    let built = document.and_then(|document| document.build());
    let model = built.unwrap_or_else(|errors| panic!("{}", errors.render())).0;
    // Where it is not SI, a named table stands at the field that uses it.
    format!("{model:?}").replace("tables.path", "drivers.far.motion")
}

/// Pieces of a text: numbers, and what stands between them.
fn pieces(text: &str) -> Vec<Result<f64, &str>> {
    let numeric = |c: char| c.is_ascii_digit() || "+-.e".contains(c);
    let mut out = Vec::new();
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let end = rest.find(|c| numeric(c) != numeric(first)).unwrap_or(rest.len());
        let (piece, tail) = rest.split_at(end);
        out.push(piece.parse::<f64>().map_err(|_| piece));
        rest = tail;
    }
    out
}

fn assert_same(si: &str, other: &str) {
    let (si, other) = (model(si), model(other));
    let (a, b) = (pieces(&si), pieces(&other));
    assert_eq!(a.len(), b.len());
    for (a, b) in a.into_iter().zip(b) {
        match (a, b) {
            // The quotients of π with 180 of the file itself are rounded too.
            (Ok(a), Ok(b)) => {
                assert!((a - b).abs() <= 1e-15 * a.abs().max(b.abs()), "{a} {b}\n{si}");
            }
            (a, b) => assert_eq!(a, b),
        }
    }
}

const SPATIAL: &str = r#"
holonom = 1
dimension = "spatial"
UNITS
gravity = [0.0, 0.0, <-9.81 m/s²>]
[parameters]
length = { value = <0.3 m> }
[bodies.a]
mass = <2.5 kg>
inertia = [[<0.02 kg m²>, 0.0, 0.0], [0.0, <0.02 kg m²>, 0.0], [0.0, 0.0, <0.03 kg m²>]]
position = ["=length", 0.0, 0.0]
axis_angle = { axis = [0.0, 0.0, 2.0], angle = <0.5 rad> }
markers = { tip = { point_in_body = [<0.1 m>, 0.0, 0.0] } }
[bodies.b]
mass = <1.5 kg>
inertia = [[<0.02 kg m²>, 0.0, 0.0], [0.0, <0.02 kg m²>, 0.0], [0.0, 0.0, <0.03 kg m²>]]
position = ["=2*length", 0.0, 0.0]
[joints]
hinge = { type = "revolute", between = ["ground", "a"], point = [0.0, 0.0, 0.0], axis = [0.0, 1.0, 0.0] }
slide = { type = "translational", between = ["a", "b"], point = ["=length", 0.0, 0.0], axis = [1.0, 0.0, 0.0] }
[forces]
spring = { type = "tsda", between = ["ground", "a"], points = [[0.0, 0.0, <1.0 m>], "a.tip"], stiffness = <4000.0 N/m>, damping = <40.0 N s/m>, free_length = <0.8 m> }
law = { type = "tsda", between = ["ground", "b"], points = [[0.0, 0.0, <1.0 m>], [<0.7 m>, 0.0, 0.0]], force = { table = "curve" }, free_length = <0.8 m> }
turn = { type = "rsda", between = ["ground", "a"], axis = [0.0, 1.0, 0.0], stiffness = <70.0 N m/rad>, damping = <0.7 N m s/rad>, free_angle = <0.2 rad> }
bush = { type = "bushing", between = ["a", "b"], point = [<0.4 m>, 0.0, 0.0], stiffness_matrix = [[<5.0 N/m>, 0.0, 0.0, <0.1 N>, 0.0, 0.0], [0.0, <5.0 N/m>, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, <5.0 N/m>, 0.0, 0.0, 0.0], [<0.1 N>, 0.0, 0.0, <2.0 N m>, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, <2.0 N m>, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, <2.0 N m>]], rotational_damping = [<0.3 N m s/rad>, 0.0, 0.0] }
push = { type = "point_force", on = "b", point = [<0.6 m>, 0.0, 0.0], force = { type = "harmonic", amplitude = <12.0 N>, angular_frequency = <3.0 rad/s>, phase = <0.3 rad> }, direction = [1.0, 0.0, 0.0] }
motor = { type = "torque", on = "a", torque = [0.0, { type = "polynomial", coefficients = [<1.0 N m>, <2.0 N m>] }, 0.0] }
tyre = { type = "tyre", on = "b", point = [<0.6 m>, 0.0, <0.3 m>], radius = <0.3 m>, stiffness = <2000.0 N/m>, road = "bump", lateral = { cornering_stiffness = <900.0 N/rad>, regularization_speed = <0.5 m/s>, axis = [0.0, 1.0, 0.0] } }
[drivers]
far = { joint = "slide", coordinate = "translation", motion = { type = "table", table = "path" } }
round = { joint = "hinge", coordinate = "rotation", motion = { type = "smooth_step", from = 0.0, to = <0.4 rad>, start = 0.0, end = 2.0 } }
[tables]
curve = { x = [<-0.1 m>, 0.0, <0.1 m>], y = [<-7.0 N>, 0.0, <9.0 N>] }
path = { x = [0.0, 1.0, 5.0], y = [0.0, <0.02 m>, <0.05 m>] }
[roads]
bump = { type = "smooth_bump", height = <0.05 m>, half_length = <0.4 m>, center = <2.0 m> }
[initial]
velocity = [<4.0 m/s>, 0.0, 0.0]
[initial.bodies.b]
position = [<0.61 m>, 0.0, 0.0]
angular_velocity = [0.0, <0.2 rad/s>, 0.0]
[initial.joints]
hinge = { angle = <0.1 rad>, angular_velocity = <0.2 rad/s> }
[simulation]
end_time = 2.0
tolerance = { relative = 1e-5, translation = <1e-5 m>, rotation = <1e-5 rad> }
"#;

/// The text with every `<number unit>` in units of its own; `factors` of m, rad, kg and N by hand.
fn written(units: &str, factors: [(f64, f64); 4]) -> String {
    let mut out = String::new();
    let mut rest = SPATIAL.replace("UNITS", units);
    while let Some((before, after)) = rest.split_once('<') {
        let (inside, tail) = after.split_once('>').unwrap();
        let (number, unit) = inside.split_once(' ').unwrap();
        let mut x: f64 = number.parse().unwrap();
        let mut above = true;
        for symbol in unit.replace('/', " / ").split_whitespace() {
            above &= symbol != "/";
            let squared = symbol.ends_with('²');
            let known = ["m", "rad", "kg", "N"];
            let Some(k) = known.iter().position(|s| *s == symbol.trim_end_matches('²')) else {
                continue;
            };
            for _ in 0..=u8::from(squared) {
                let (n, d) = factors[k];
                x = if above { x * d / n } else { x * n / d };
            }
        }
        out += before;
        write!(out, "{x:?}").unwrap();
        rest = tail.to_owned();
    }
    out + &rest
}

const ONE: (f64, f64) = (1.0, 1.0);

#[test] // independent truth: the same model with every number converted by hand
fn a_model_in_other_units_is_the_same_model() {
    let si = written("", [ONE; 4]);
    let pi = std::f64::consts::PI;
    for (units, factors) in [
        ("units = { length = \"m\" }", [ONE; 4]),
        (
            "units = { length = \"mm\", angle = \"deg\", mass = \"t\" }",
            [(1.0, 1000.0), (pi, 180.0), (1000.0, 1.0), ONE],
        ),
        (
            "units = { length = \"cm\", mass = \"g\", force = \"kN\" }",
            [(1.0, 100.0), ONE, (1.0, 1000.0), (1000.0, 1.0)],
        ),
        (
            "units = { length = \"in\", mass = \"lb\" }",
            [(0.0254, 1.0), ONE, (0.45359237, 1.0), ONE],
        ),
    ] {
        assert_same(&si, &written(units, factors));
    }
}

#[test] // independent truth: the model itself, read again
fn merged_and_plain_texts_are_the_same_model() {
    let pi = std::f64::consts::PI;
    let own = "units = { length = \"mm\", angle = \"deg\", mass = \"g\" }";
    let factors = [(1.0, 1000.0), (pi, 180.0), (1.0, 1000.0), ONE];
    for (units, factors, length) in [("", [ONE; 4], 0.3), (own, factors, 300.0)] {
        let half = "[parameters]\nhalf = { value = \"=length/2\", title = \"not used\" }";
        let text = written(units, factors).replace("[parameters]", half);
        let document = parse(&text).unwrap();
        let plain = document.to_plain_json().unwrap();
        assert!(!plain.contains("\"units\"") && !plain.contains("\"="), "{plain}");
        let parameters = serde_json::from_str::<serde_json::Value>(&plain).unwrap();
        assert_eq!(parameters["parameters"]["half"]["value"], 0.5 * length);
        for json in [document.to_json(), plain] {
            let read = Document::parse(&json, Syntax::Json, "m.json", &mut |_| Err(String::new()));
            assert_eq!(described(read), model(&text));
        }
    }
}

#[test]
fn values_are_set_in_the_units_of_the_file() {
    let text = written("units = { length = \"mm\" }", [(1.0, 1000.0), ONE, ONE, ONE]);
    let set = |path: &str, x: f64| {
        let document = parse(&text).unwrap().with_values(&[(path, serde_json::json!(x))]).unwrap();
        document.build().unwrap().0
    };
    assert_eq!(set("bodies.b.position[0]", 700.0).bodies[1].position[0], 0.7);
    assert_eq!(set("parameters.length", 250.0).bodies[1].position[0], 0.5);
}

#[test]
fn messages_speak_of_the_units_of_the_file() {
    let text = written("units = { length = \"mm\" }", [(1.0, 1000.0), ONE, ONE, ONE]);
    let render = |text: &str| parse(text).and_then(|d| d.build()).unwrap_err().render();
    let wrong = text.replace("radius = 300.0", "radius = \"wide\"");
    assert!(render(&wrong).contains("expected a number (mm)"), "{}", render(&wrong));
    let wrong = text.replace("length = \"mm\"", "length = \"miles\"");
    assert!(render(&wrong).contains("`units.length`"), "{}", render(&wrong));
    let wrong = text.replace("length = \"mm\"", "time = \"ms\"");
    assert!(render(&wrong).contains("has no field `time`"), "{}", render(&wrong));
}

#[test]
fn files_that_extend_each_other_have_the_same_units() {
    let base = written("units = { length = \"mm\" }", [(1.0, 1000.0), ONE, ONE, ONE]);
    let read = |units: &str| {
        let text = format!(
            "holonom = 1\nextends = \"base.toml\"\n{units}\n[bodies.b]\nposition = [700.0, 0.0, 0.0]\n"
        );
        Document::parse(&text, Syntax::Toml, "m.toml", &mut |_| Ok(base.clone()))
    };
    let (model, _) = read("").unwrap().build().unwrap();
    assert_eq!(model.bodies[1].position[0], 0.7);
    assert!(read("units = { length = \"mm\" }").is_ok());
    let text = read("units = { length = \"m\" }").unwrap_err().render();
    assert!(text.contains("m.toml:3") && text.contains("leave `units` out here"), "{text}");
}
