//! What a run refuses is refused by the check before it, and unstated initial velocities are told.

use crate::common::model_of;
use holonom::simulation::{Choices, Problem, check_run};
use holonom::system::Sample;

fn checked(text: &str) -> Result<Vec<String>, String> {
    let problem = Problem::new(model_of(text));
    let options = Choices::of_file(problem.model()).map_err(|e| e.to_string())?;
    let warnings = check_run(&problem, &options).map_err(|e| e.to_string())?;
    Ok(warnings.into_iter().map(|w| format!("{} {}", w.code, w.message)).collect())
}

const ARM: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
arm = { mass = 1.0, inertia = 0.1, position = [0.0, 0.0] }
rider = { mass = 1.0, inertia = 0.1, position = [2.0, 0.0] }
[joints]
hinge = { type = "revolute", between = ["ground", "arm"], point = [0.0, 0.0] }
rail = { type = "translational", between = ["arm", "rider"], point = [2.0, 0.5], axis = [0.0, 1.0] }
"#;

#[test] // independent truth: what is stated, what follows from it, and what is left
fn chosen_velocities_are_told_and_determined_ones_are_not() {
    let turning = format!("{ARM}[initial.bodies]\narm = {{ angular_velocity = 2.0 }}\n");
    let found = checked(&turning).unwrap();
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].starts_with("model/not-stated") && found[0].contains("`rail.displacement`"));
    assert!(!found[0].contains("hinge"), "{found:?}");
    // Stated, also as zero, it is no choice.
    let stated = format!("{turning}[initial.joints]\nrail = {{ velocity = 0.0 }}\n");
    assert_eq!(checked(&stated).unwrap(), Vec::<String>::new());
    // At rest nothing is worth a word.
    assert_eq!(checked(ARM).unwrap(), Vec::<String>::new());
    let problem = Problem::new(model_of(&turning));
    let chosen = problem.chosen_velocities();
    let channel = problem.channel("rail.rate").unwrap();
    let mut rate = [0.0];
    let state = &problem.assemble().unwrap().state;
    problem.system().channel(&channel, &Sample::new(state), &mut rate);
    assert!((chosen[0].rate - rate[0]).abs() < 1e-12 && rate[0].abs() > 0.1, "{chosen:?}");
}

#[test] // independent truth: rigid turning at 2 rad/s would move the rider at 4 m/s, which nothing says
fn a_rate_that_follows_from_no_statement_is_told_where_all_bodies_are_said_to_turn() {
    for stated in [
        "[initial]\nangular_velocity = 2.0\n",
        "[initial.bodies]\narm = { angular_velocity = 2.0 }\nrider = { angular_velocity = 2.0 }\n",
    ] {
        let found = checked(&format!("{ARM}{stated}")).unwrap();
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].contains("`rail.displacement` -4 m/s"), "{found:?}");
    }
}

#[test] // truth: the velocity of the origin is stated, wherever the mass lies
fn a_velocity_that_is_stated_is_no_choice_where_the_mass_lies_elsewhere() {
    for [dimension, body] in [
        [
            "spatial",
            "inertia = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], position = [0.0, 0.0, 0.0], center_of_mass = [0.1, 0.3, -0.2]",
        ],
        ["planar", "inertia = 1.0, position = [0.0, 0.0], center_of_mass = [0.1, 0.3]"],
    ] {
        let [gravity, velocity] = match dimension {
            "planar" => ["[0.0, -9.81]", "[15.0, 0.0]"],
            _ => ["[0.0, 0.0, -9.81]", "[15.0, 0.0, 0.0]"],
        };
        let found = checked(&format!(
            "holonom = 1\ndimension = \"{dimension}\"\ngravity = {gravity}\n\
             [bodies]\nbox = {{ mass = 1.0, {body} }}\n[initial]\nvelocity = {velocity}\n"
        ));
        assert_eq!(found.unwrap(), Vec::<String>::new(), "{dimension}");
    }
}

#[test]
fn stated_values_that_contradict_each_other_are_named() {
    for (stated, expected) in [
        (
            "[initial.joints]\nhinge = { angle = 0.5 }\n[initial.bodies]\narm = { angle = 0.3 }\n",
            "what is stated of body `arm`",
        ),
        (
            "[initial]\nangular_velocity = 0.0\n[initial.joints]\nhinge = { angular_velocity = 1.0 }\n",
            "what is stated of body `arm`",
        ),
    ] {
        let error = checked(&format!("{ARM}{stated}")).unwrap_err();
        assert!(error.contains(expected) && !error.contains("driver"), "{error}");
    }
}

#[test] // independent truth: the rail as it was designed, 2 m from the hinge
fn what_is_beyond_a_stated_joint_is_carried_along_also_where_its_body_says_the_same() {
    let joint = "[initial.joints]\nhinge = { angle = 0.5 }\n";
    for stated in [joint.to_owned(), format!("{joint}[initial.bodies]\narm = {{ angle = 0.5 }}\n")]
    {
        let problem = Problem::new(model_of(&format!("{ARM}{stated}")));
        let channel = problem.channel("rail.displacement").unwrap();
        let mut displacement = [f64::NAN];
        let state = &problem.assemble().unwrap().state;
        problem.system().channel(&channel, &Sample::new(state), &mut displacement);
        assert!(displacement[0].abs() < 1e-9, "{displacement:?}");
        assert!((state.q[3] - 2.0 * 0.5f64.cos()).abs() < 1e-9, "{:?}", state.q);
    }
}

#[test]
fn choices_of_the_file_that_a_run_refuses_are_refused() {
    for (rest, expected) in [
        ("[outputs]\nchannels = [\"arm.positon\"]\n", "did you mean `arm.position`?"),
        ("[simulation]\nend_time = 1.0\ntolerance = 1e-18\n", "below the round-off"),
        ("[simulation]\nend_time = 1e9\n[outputs]\ninterval = 1e-3\n", "output rows"),
        ("[simulation]\nmethod = \"ForRosen\"\njacobian = \"differences\"\n", "exact Jacobian"),
    ] {
        let error = checked(&format!("{ARM}{rest}")).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn ends_of_a_spring_at_one_place_are_refused_where_it_pushes() {
    let with = |free: &str| {
        format!(
            "{ARM}[forces]\ns = {{ type = \"tsda\", between = [\"ground\", \"rider\"], points = [[2.0, 0.0], \
             [2.0, 0.0]], stiffness = 10.0, free_length = {free} }}\n"
        )
    };
    let error = checked(&with("0.5")).unwrap_err();
    assert!(error.starts_with("the ends of spring `s` coincide at the start"), "{error}");
    assert!(checked(&with("0.0")).is_ok());
    // In series with a damper its force does not follow from the length.
    for free in ["0.5", "0.0"] {
        let series = with(free)
            .replace("tsda", "maxwell")
            .replace("free_length", "damping = 2.0, free_length");
        let error = checked(&series).unwrap_err();
        assert!(
            error.starts_with("the ends of `s`, a spring and a damper in series, coincide"),
            "{error}"
        );
        assert!(checked(&series.replacen("[2.0, 0.0]]", "[2.0, 0.1]]", 1)).is_ok());
    }
}
