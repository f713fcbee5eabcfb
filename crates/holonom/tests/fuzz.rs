//! Searches that go on for as long as one gives them: texts, new values and random mechanisms. Two minutes of
//! each with `--features holonom/long`, or `FUZZ_SECONDS` seconds; what they find is kept by proptest beside
//! this file and tried first from then on.

#[path = "engine/random/mod.rs"]
mod random;

use std::time::{Duration, Instant};

use holonom::io::{Document, Syntax};
use holonom::reduction::ParametrizationKind;
use holonom::simulation::{Memory, Options, Problem, Status, run};
use proptest::prelude::*;
use proptest::test_runner::{RngAlgorithm, TestCaseError, TestRng, TestRunner};

const FILES: [&str; 5] = [
    include_str!("engine/files/double_pendulum.toml"),
    include_str!("engine/files/spatial.toml"),
    include_str!("engine/files/alternatives.toml"),
    include_str!("engine/files/planar.toml"),
    "holonom = 1\ndimension = \"planar\"\nunits = { length = \"mm\", angle = \"deg\" }\ngravity = [0.0, -9810.0]\n\
     [patterns.chain]\nover.i = { from = 1, to = 3 }\n\
     bodies.\"link_{i}\" = { mass = 1.0, inertia = 100.0, position = [\"=100*i\", 0.0] }\n\
     joints.\"pin_{i}\" = { type = \"revolute\", between = [\"ground\", \"link_{i}\"], point = [\"=90*i\", 0.0] }\n\
     [initial.joints]\npin_1 = { angle = 20.0, angular_velocity = 5.0 }\n",
];

/// Cases between two looks at the clock.
const ROUND: u32 = 8;

/// Seconds of each search: those that are asked for, two minutes among the long tests, else two seconds.
fn seconds() -> f64 {
    let asked = std::env::var("FUZZ_SECONDS").ok().and_then(|text| text.parse().ok());
    asked.unwrap_or(if cfg!(feature = "long") { 120.0 } else { 2.0 })
}

/// Tries cases until the time is over; a failing one is made small and told.
fn search<S: Strategy>(cases: &S, test: impl Fn(S::Value) -> Result<(), TestCaseError>) {
    let until = Instant::now() + Duration::from_secs_f64(seconds());
    let config = ProptestConfig { cases: ROUND, ..ProptestConfig::with_source_file(file!()) };
    // The same cases in the same order, of which a longer search sees more.
    let mut runner =
        TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    while Instant::now() < until {
        if let Err(error) = runner.run(cases, &test) {
            panic!("{error}");
        }
    }
}

fn parse(text: &str, syntax: Syntax) -> Option<Document> {
    match Document::parse(text, syntax, "model", &mut |_| Err("no other file".to_owned())) {
        Ok(document) => Some(document),
        Err(errors) => {
            assert!(!errors.errors.is_empty() && errors.errors.iter().all(|e| !e.help.is_empty()));
            None
        }
    }
}

/// A text of the catalogue with some bytes replaced by others or by pieces of syntax.
fn damaged() -> impl Strategy<Value = (String, bool)> {
    let pieces = prop_oneof![
        Just("=".to_owned()),
        Just("[[".to_owned()),
        Just("\"a.b\"".to_owned()),
        Just("{i}".to_owned()),
        Just("nan".to_owned()),
        Just("-1e300".to_owned()),
        Just("\u{1b}".to_owned()),
        Just("\n[units]\n".to_owned()),
        Just("\"=2*k\"".to_owned()),
        Just("}".to_owned()),
        "[ -~]{0,6}",
        "\\PC{0,3}",
    ];
    let cut = (0.0..1.0f64, 0..12usize, pieces);
    (0..FILES.len(), prop::collection::vec(cut, 1..6), any::<bool>()).prop_map(
        |(file, cuts, json)| {
            let mut text: Vec<char> = FILES[file].chars().collect();
            if json {
                let document = parse(FILES[file], Syntax::Toml);
                text = document.map_or(text, |d| d.to_json().chars().collect());
            }
            for (at, length, piece) in cuts {
                let start = (at * text.len() as f64) as usize;
                let end = (start + length).min(text.len());
                text.splice(start..end, piece.chars());
            }
            (text.into_iter().collect(), json)
        },
    )
}

#[test] // truth: an answer with places and help, never a panic; what is read is read again alike
fn damaged_texts_are_models_or_answered() {
    search(&damaged(), |(text, json)| {
        let syntax = if json { Syntax::Json } else { Syntax::Toml };
        let Some(document) = parse(&text, syntax) else { return Ok(()) };
        let built = document.build();
        let again = parse(&document.to_json(), Syntax::Json).map(|d| d.build());
        match (built, again) {
            (Ok((a, _)), Some(Ok((b, _)))) => prop_assert_eq!(a, b),
            (Ok(_), _) => return Err(TestCaseError::fail("the merged text is not the model")),
            (Err(errors), _) => {
                prop_assert!(errors.errors.iter().all(|e| !e.help.is_empty()));
                let escapes = errors.to_string().contains(|c: char| c.is_control() && c != '\n');
                prop_assert!(!escapes, "a control character: {:?}", errors.to_string());
            }
        }
        Ok(())
    });
}

#[test] // truth: a model or an answer, never a panic
fn any_value_may_be_set_at_any_path() {
    let names = prop_oneof![
        Just("bodies".to_owned()),
        Just("joints".to_owned()),
        Just("initial".to_owned()),
        Just("units".to_owned()),
        Just("length".to_owned()),
        Just("pin_1".to_owned()),
        Just("angle".to_owned()),
        Just("patterns".to_owned()),
        Just("chain".to_owned()),
        Just("\"link_{i}\"".to_owned()),
        Just("mass".to_owned()),
        Just("forces".to_owned()),
        Just("parameters".to_owned()),
        Just("position[0]".to_owned()),
        "[a-z\"\\\\.\\[\\]]{1,6}",
        "\\PC{1,4}",
    ];
    let values = prop_oneof![
        any::<f64>().prop_map(|x| serde_json::json!(x)),
        any::<bool>().prop_map(|b| serde_json::json!(b)),
        "\\PC{0,8}".prop_map(|t| serde_json::json!(t)),
        Just(serde_json::json!([1.0, 2.0])),
        Just(serde_json::json!({"x": 1.0})),
        Just(serde_json::Value::Null),
        Just(serde_json::json!("mm")),
    ];
    let cases = (0..FILES.len(), prop::collection::vec(names, 1..5), values);
    search(&cases, |(file, steps, value)| {
        let Some(document) = parse(FILES[file], Syntax::Toml) else { return Ok(()) };
        let outcome = document.with_values(&[(steps.join("."), value)]).and_then(|d| d.build());
        if let Err(errors) = outcome {
            prop_assert!(errors.errors.iter().all(|e| !e.help.is_empty()), "{}", errors);
        }
        Ok(())
    });
}

#[test] // truth: the joints, whose residuals every chart has to keep
fn random_mechanisms_run_in_every_chart() {
    search(&any::<u64>(), |seed| {
        let Some(document) = parse(&random::Mechanism::new(seed, 0.0).text(), Syntax::Toml) else {
            return Ok(());
        };
        let Ok((model, _)) = document.build() else { return Ok(()) };
        let problem = Problem::new(model);
        for (parametrization, name) in ParametrizationKind::ALL {
            let mut rows = Memory::default();
            let options =
                Options { parametrization: *parametrization, max_steps: 200, ..Options::new(0.02) };
            let Ok(summary) = run(&problem, &options, None, &mut rows) else { continue };
            let finite = summary.end.q.iter().chain(&summary.end.v).all(|x| x.is_finite());
            prop_assert!(finite, "seed {} in {}: not finite", seed, name);
            if summary.status == Status::Completed {
                let ratio = summary.statistics.residual_ratio;
                prop_assert!(
                    ratio < 1e4,
                    "seed {} in {}: residuals {:e} of the bound",
                    seed,
                    name,
                    ratio
                );
            }
        }
        Ok(())
    });
}
