//! What counts of the choices of a run: the call, then the model file, then defaults.

use crate::common::model_of;
use holonom::method::Code;
use holonom::model::{Model, Tolerance};
use holonom::reduction::ParametrizationKind;
use holonom::simulation::{
    Choices, Memory, Options, OutputTimes, Problem, RunError, ToleranceParts, run,
};

const ROD: &str = r#"
holonom = 1
dimension = "planar"
[bodies]
rod = { mass = 2.0, inertia = 0.1, position = [0.8, 0.0] }
[joints]
pin = { type = "revolute", between = ["ground", "rod"], point = [0.0, 0.0] }
"#;

fn stating(simulation: &str) -> Model {
    model_of(&format!("{ROD}{simulation}"))
}

#[test]
fn what_nothing_states_is_a_default() {
    let call = Choices { end_time: Some(2.0), ..Choices::default() };
    assert_eq!(call.resolve(&stating(""), 0.0), Ok(Options::new(2.0)));
    assert_eq!(Choices::default().resolve(&stating(""), 0.0), Err(RunError::NoEndTime));
}

#[test]
fn the_call_comes_before_the_file() {
    let model = stating(
        "[outputs]\nchannels = [\"rod.position\"]\ninterval = 0.5\n\
         [simulation]\nstart_time = 1.0\nend_time = 3.0\nmethod = \"state_space\"\n\
         formula = \"sdirk4_16\"\nprofile = \"thesis\"\ntolerance = 1e-6\nmax_steps = 7",
    );
    let file = Choices::default().resolve(&model, 1.0).unwrap();
    assert_eq!((file.end_time, file.max_steps, file.code), (3.0, 7, Code::SspSdirk16));
    assert_eq!(file.output, OutputTimes::Interval(0.5));
    assert_eq!(file.channels, ["rod.position"]);
    assert_eq!(file.parametrization, ParametrizationKind::Partitioning, "that of its profile");

    let call = Choices {
        end_time: Some(4.0),
        tolerance: ToleranceParts { rotation: Some(1e-3), ..ToleranceParts::default() },
        method: Some("descriptor".into()),
        output_times: Some(vec![2.0]),
        parametrization: Some("tangent_plane".into()),
        ..Choices::default()
    };
    let both = call.resolve(&model, 1.0).unwrap();
    let tolerance = Tolerance { rotation: 1e-3, ..Tolerance::uniform(1e-6) };
    assert_eq!((both.end_time, both.max_steps, both.tolerance), (4.0, 7, tolerance));
    assert_eq!(both.code, Code::InflSdirk, "a method of the call takes no formula of the file");
    assert_eq!(both.output, OutputTimes::Listed(vec![2.0]));
    assert_eq!(
        (both.parametrization, both.profile),
        (ParametrizationKind::TangentPlane, file.profile)
    );
    let formula = Choices { formula: Some("sdirk4_15".into()), ..Choices::default() };
    assert_eq!(formula.resolve(&model, 1.0).unwrap().code, Code::SspSdirk15);

    assert_eq!(Choices::default().start_time(&model, None), Ok(1.0));
    assert_eq!(Choices::default().start_time(&model, Some(2.0)), Ok(2.0));
    let late = Choices { start_time: Some(1.5), ..Choices::default() };
    assert_eq!(late.start_time(&model, None), Ok(1.5));
    let refused = RunError::StartTime { stated: 1.5, from: 2.0 };
    assert_eq!(late.start_time(&model, Some(2.0)), Err(refused));
}

#[test]
fn a_fixed_step_and_the_control_of_steps_replace_each_other() {
    let steps = |model: &Model, call: Choices| {
        let options = Choices { end_time: Some(1.0), ..call }.resolve(model, 0.0).unwrap();
        (options.fixed_step, options.max_step, options.initial_step)
    };
    let fixed = stating("[simulation]\nfixed_step = 0.1");
    let most = Choices { max_step: Some(0.01), ..Choices::default() };
    assert_eq!(steps(&fixed, most), (None, 0.01, None));
    let controlled = stating("[simulation]\nmax_step = 0.1\ninitial_step = 0.01");
    let by = Choices { fixed_step: Some(0.5), ..Choices::default() };
    assert_eq!(steps(&controlled, by), (Some(0.5), f64::INFINITY, None));
    assert_eq!(steps(&controlled, Choices::default()), (None, 0.1, Some(0.01)));
}

#[test]
fn options_told_as_choices_are_the_same_options() {
    let model = stating("[simulation]\nend_time = 3.0\nmethod = \"DEABM\"");
    for call in [
        Choices::default(),
        Choices {
            method: Some("InflTrap".into()),
            newmark_gamma: Some(0.75),
            ..Choices::default()
        },
    ] {
        let mut options = call.resolve(&model, 1.0).unwrap();
        let told = Choices::of(&options, 1.0);
        options.dense_output = Some(options.stores_dense_output());
        options.repartition_factor = Some(options.repartition_factor());
        assert_eq!(told.resolve(&stating(""), 1.0), Ok(options));
    }
}

#[test]
fn unknown_words_are_refused_with_the_known_ones() {
    for (call, code, known) in [
        (
            Choices { method: Some("Euler".into()), ..Choices::default() },
            "unknown-method",
            "DOPRI5",
        ),
        (
            Choices { profile: Some("best".into()), ..Choices::default() },
            "option",
            "improved, thesis",
        ),
        (Choices { jacobian: Some("none".into()), ..Choices::default() }, "option", "differences"),
        (
            Choices { parametrization: Some("x".into()), ..Choices::default() },
            "option",
            "tangent_plane",
        ),
    ] {
        let error = call.resolve(&stating("[simulation]\nend_time = 1.0"), 0.0).unwrap_err();
        assert_eq!(error.code(), format!("simulation/{code}"));
        assert!(error.to_string().contains(known), "{error}");
    }
}

#[test] // truth: round-off of the times of the run
fn spans_and_first_steps_that_arithmetic_cannot_keep_are_refused() {
    let problem = Problem::new(stating(""));
    let refused = |options: Options| run(&problem, &options, None, &mut Memory::default()).err();
    for end_time in [f64::INFINITY, f64::NAN, 1e300] {
        let option = |error| matches!(error, RunError::Option { option: "end_time", .. });
        assert!(refused(Options::new(end_time)).is_some_and(option), "{end_time:e}");
    }
    let before = RunError::EndTime { end: -1.0, start: 0.0 };
    assert_eq!(refused(Options::new(-1.0)), Some(before));
    let new = || Options::new(1.0);
    let stated: [(&str, &dyn Fn(f64) -> Options); 2] = [
        ("initial_step", &|h| Options { initial_step: Some(h), ..new() }),
        ("fixed_step", &|h| Options { fixed_step: Some(h), max_steps: 10, ..new() }),
    ];
    for (name, small) in stated {
        let lost = |error| matches!(error, RunError::Step { option, .. } if option == name);
        assert!(refused(small(1e-300)).is_some_and(lost), "{name}");
        let lost = |error| matches!(error, RunError::Step { .. });
        assert!(!refused(small(1e-12)).is_some_and(lost), "{name}");
    }
    // The later end of the run has the coarser times.
    let far = Options { fixed_step: Some(1e-8), ..Options::new(1e9) };
    assert!(matches!(refused(far), Some(RunError::Step { option: "fixed_step", .. })));
    let late = Problem::new(stating("[simulation]\nstart_time = 1e9"));
    let output = OutputTimes::Interval(1e-6);
    let often = Options { output, ..Options::new(1e9 + 1.0) };
    let refusal = run(&late, &often, None, &mut Memory::default()).err();
    assert!(matches!(refusal, Some(RunError::Step { option: "interval", .. })), "{refusal:?}");
    let times = |times: &[f64]| Options { output: OutputTimes::Listed(times.to_vec()), ..new() };
    assert_eq!(refused(times(&[0.0, 1.0 + 1e-13])), None, "the end by round-off");
    let twice = refused(times(&[0.0, 1.0, 1.0 + 1e-13]));
    assert!(matches!(twice, Some(RunError::OutputTime { index: 2, .. })), "{twice:?}");
}
