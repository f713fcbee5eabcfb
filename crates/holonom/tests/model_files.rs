//! Model files to models. The independent truth is geometry done by hand.

use holonom::error::ModelErrors;
use holonom::io::{Document, Syntax};
use holonom::model::{ForceKind, JointKind, Model, Orientation};

fn build(text: &str) -> Result<Model, ModelErrors> {
    let mut none = |_: &str| Err("no other file".to_owned());
    let document = Document::parse(text, Syntax::Toml, "model.toml", &mut none)?;
    Ok(document.build()?.0)
}

fn model(text: &str) -> Model {
    build(text).unwrap_or_else(|errors| panic!("{}", errors.render()))
}

const DOUBLE_PENDULUM: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[parameters]
k1 = { value = 400.0, unit = "N m/rad" }
[bodies]
upper = { mass = 3.0, inertia = 1.0, position = [1.0, 0.0], angle = 6.283185307179586 }
lower = { mass = 0.3, inertia = 0.225, position = [3.448888739433602, -0.38822856765378233], angle = 6.021385919380436 }
[joints]
pivot = { type = "revolute", between = ["ground", "upper"], points_in_body = [[0.0, 0.0], [-1.0, 0.0]] }
elbow = { type = "revolute", between = ["upper", "lower"], point = [2.0, 0.0] }
[forces]
shoulder_spring = { type = "rsda", between = ["ground", "upper"], stiffness = "=k1", damping = 15.0, free_angle = 4.71238898038469 }
elbow_spring = { type = "rsda", between = ["upper", "lower"], stiffness = 3.0e5, damping = 5.0e4 }
pull = { type = "tsda", between = ["ground", "lower"], points = [[0.0, 1.0], [2.0, 0.0]], stiffness = 0.0, free_length = 1.0 }
[initial.bodies]
upper = { angular_velocity = 0.0 }
lower = { angular_velocity = 10.0 }
[simulation]
end_time = 2.0
"#;

#[test]
fn a_planar_model_has_its_points_in_body_axes() {
    let m = model(DOUBLE_PENDULUM);
    let JointKind::Revolute = m.joints[1].kind else { panic!() };
    let [a, b] = m.joints[1].frames;
    assert!((a.point[0] - 1.0).abs() < 1e-15 && a.point[1].abs() < 1e-15);
    // The half length of the lower rod is 1.5: its end lies at (-1.5, 0) of its frame.
    assert!((b.point[0] + 1.5).abs() < 1e-14 && b.point[1].abs() < 1e-14, "{:?}", b.point);
    let ForceKind::Rsda { frames, free_angle, .. } = &m.forces[0].kind else { panic!() };
    assert_eq!(frames[1].axes, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    assert_eq!(*free_angle, 4.71238898038469);
    assert_eq!(m.bodies[0].orientation, Orientation::Angle(6.283185307179586));
    assert_eq!(m.initial.bodies[1].angular_velocity, Some([0.0, 0.0, 10.0]));
    assert_eq!(m.initial.bodies[0].velocity, None);
}
