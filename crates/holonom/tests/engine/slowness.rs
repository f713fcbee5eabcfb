//! What limited the steps of a run is told.

use crate::common::model_of;
use holonom::simulation::{Memory, Options, Problem, run};

#[test] // independent truth: of two oscillators that know nothing of each other the faster one needs the steps
fn the_fast_one_of_two_oscillators_limits_the_steps() {
    let text = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
slow = { mass = 1.0, inertia = 1.0, position = [1.0, 0.0] }
fast = { mass = 1.0, inertia = 1.0, position = [1.0, 1.0] }
[joints]
slow_rail = { type = "translational", between = ["ground", "slow"], point = [1.0, 0.0], axis = [1.0, 0.0] }
fast_rail = { type = "translational", between = ["ground", "fast"], point = [1.0, 1.0], axis = [1.0, 0.0] }
[forces]
soft = { type = "tsda", between = ["ground", "slow"], points = [[0.0, 0.0], [1.0, 0.0]], stiffness = 1.0, free_length = 0.9 }
hard = { type = "tsda", between = ["ground", "fast"], points = [[0.0, 1.0], [1.0, 1.0]], stiffness = 400.0, free_length = 0.9 }
"#;
    let problem = Problem::new(model_of(text));
    let mut rows = Memory::default();
    let summary = run(&problem, &Options::new(5.0), None, &mut rows).unwrap();
    let limited = summary.limited_by(problem.system().as_ref());
    let (name, count) = limited.coordinate.unwrap();
    assert_eq!(name, "fast_rail.displacement");
    assert!(count <= limited.steps && limited.steps <= summary.statistics.steps);
    assert!(10 * count > 9 * limited.steps, "{count} of {}", limited.steps);
    let rejected = summary.statistics.rejected_error + summary.statistics.rejected_newton;
    assert!(limited.rejected_steps <= rejected);
    if let Some((coordinate, force, _)) = limited.rejected {
        assert_eq!(
            (coordinate.as_str(), force.as_deref()),
            ("fast_rail.displacement", Some("hard"))
        );
    }
}
