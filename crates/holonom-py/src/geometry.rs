//! A model as it is drawn: where its bodies stand, and where joints and forces sit on them.

use holonom::elements::road_height;
use holonom::model::{
    Body, BodyIndex, Dimension, DriverKind, ElasticLaw, Force, ForceKind, Frame, Joint, JointKind,
    Model, Orientation, Road, Shape, ShapeKind, Tyre,
};
use serde_json::{Map, Value, json};

pub(crate) fn geometry(model: &Model) -> String {
    let mut elements: Vec<Value> = model.joints.iter().map(joint).collect();
    elements.extend(model.forces.iter().map(|one| force(model, one)));
    elements.extend(model.drivers.iter().map(|driver| {
        let kind = match driver.kind {
            DriverKind::Translation => "translation",
            DriverKind::Rotation => "rotation",
        };
        element("drivers", &driver.name, kind, &driver.frames, json!({}))
    }));
    json!({
        "dimension": match model.dimension {
            Dimension::Planar => "planar",
            Dimension::Spatial => "spatial",
        },
        "gravity": model.gravity,
        "bodies": model.bodies.iter().map(body).collect::<Vec<_>>(),
        "elements": elements,
    })
    .to_string()
}

/// Heights of the road under a tyre, m; None where the model has no such tyre.
pub(crate) fn road_heights(model: &Model, tyre: &str, places: &[f64]) -> Option<Vec<f64>> {
    let found = model.forces.iter().find(|force| force.name == tyre)?;
    let ForceKind::Tyre(tyre) = &found.kind else { return None };
    Some(places.iter().map(|x| road_height(&tyre.road, tyre.radius, *x)).collect())
}

fn body(body: &Body) -> Value {
    let orientation = match body.orientation {
        Orientation::Angle(angle) => [(0.5 * angle).cos(), 0.0, 0.0, (0.5 * angle).sin()],
        Orientation::EulerParameters(p) => p,
    };
    let markers: Map<String, Value> =
        body.markers.iter().map(|(name, point)| (name.clone(), json!(point))).collect();
    json!({
        "name": body.name, "mass": body.mass, "inertia": body.inertia,
        "position": body.position, "euler_parameters": orientation,
        "center_of_mass": body.center_of_mass, "markers": markers,
        "shapes": body.shapes.iter().map(shape).collect::<Vec<_>>(),
    })
}

fn shape(shape: &Shape) -> Value {
    let (kind, more) = match &shape.kind {
        ShapeKind::Box { size } => ("box", json!({"size": size})),
        ShapeKind::Cylinder { radius, length } => {
            ("cylinder", json!({"radius": radius, "length": length}))
        }
        ShapeKind::Sphere { radius } => ("sphere", json!({"radius": radius})),
        ShapeKind::Capsule { radius, length } => {
            ("capsule", json!({"radius": radius, "length": length}))
        }
        ShapeKind::Mesh(surface) => {
            ("mesh", json!({"vertices": surface.vertices, "faces": surface.faces}))
        }
    };
    let mut value = json!({
        "name": shape.name, "type": kind, "position": shape.position, "axes": shape.axes,
        "color": shape.color, "opacity": shape.opacity,
    });
    if let (Value::Object(value), Value::Object(more)) = (&mut value, more) {
        value.extend(more);
    }
    value
}

fn element(collection: &str, name: &str, kind: &str, frames: &[Frame], more: Value) -> Value {
    let frames: Vec<Value> = frames
        .iter()
        .map(|frame| json!({"body": frame.body, "point": frame.point, "axes": frame.axes}))
        .collect();
    let mut value = json!({"collection": collection, "name": name, "type": kind, "frames": frames});
    if let (Value::Object(value), Value::Object(more)) = (&mut value, more) {
        value.extend(more);
    }
    value
}

fn joint(joint: &Joint) -> Value {
    let (kind, more) = match joint.kind {
        JointKind::Fixed => ("fixed", json!({})),
        JointKind::Revolute => ("revolute", json!({})),
        JointKind::Translational => ("translational", json!({})),
        JointKind::Cylindrical => ("cylindrical", json!({})),
        JointKind::Universal => ("universal", json!({})),
        JointKind::Spherical => ("spherical", json!({})),
        JointKind::Distance { length } => ("distance", json!({"length": length})),
    };
    element("joints", &joint.name, kind, &joint.frames, more)
}

fn force(model: &Model, force: &Force) -> Value {
    let element = |kind, frames: &[Frame], more| element("forces", &force.name, kind, frames, more);
    match &force.kind {
        ForceKind::Tsda { frames, law, damping, free_length } => {
            let more = json!({
                "elastic": elastic(law), "damped": *damping > 0.0, "free_length": free_length,
            });
            element("tsda", frames, more)
        }
        ForceKind::Rsda { frames, law, damping, free_angle } => {
            let more = json!({
                "elastic": elastic(law), "damped": *damping > 0.0, "free_angle": free_angle,
            });
            element("rsda", frames, more)
        }
        ForceKind::Maxwell { frames, free_length, .. } => {
            element("maxwell", frames, json!({"free_length": free_length}))
        }
        ForceKind::Bushing { frames, .. } => element("bushing", frames, json!({})),
        ForceKind::Tyre(tyre) => element("tyre", &[tyre.frame], rolling(tyre)),
        ForceKind::PointForce { frame, .. } => element("point_force", &[*frame], json!({})),
        ForceKind::Torque { body, reaction, .. } => {
            let frames = [at_center(model, *reaction), at_center(model, *body)];
            element("torque", &frames, json!({}))
        }
    }
}

/// Whether a law gives a force at all.
fn elastic(law: &ElasticLaw) -> bool {
    !matches!(law, ElasticLaw::Linear(stiffness) if *stiffness == 0.0)
}

/// Where a torque is drawn: it has no point of its own.
fn at_center(model: &Model, body: BodyIndex) -> Frame {
    let point = body.map_or([0.0; 3], |index| model.bodies[index].center_of_mass);
    Frame { body, point, axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] }
}

fn rolling(tyre: &Tyre) -> Value {
    let road = match tyre.road {
        Road::Flat { height } => json!({"type": "flat", "height": height}),
        Road::SmoothBump { height, half_length, center } => json!({
            "type": "smooth_bump", "height": height, "half_length": half_length, "center": center,
        }),
        Road::HalfCylinder { radius, center } => {
            json!({"type": "half_cylinder", "radius": radius, "center": center})
        }
    };
    json!({"radius": tyre.radius, "road": road, "axis": tyre.lateral.map(|lateral| lateral.axis)})
}
