//! A mechanism as text of the model file format, TOML.

use super::numbers::{V3, add, euler_parameters, norm, scale, sub, transpose};
use super::{Between, Driver, Element, Joint, Kind, Law, Load, Mechanism, Motion};
use std::fmt::Write as _;

impl Mechanism {
    /// The model file.
    pub(crate) fn text(&self) -> String {
        let mut out = format!("holonom = 1\ntitle = \"random mechanism {}\"\n", self.seed);
        let dimension = if self.planar { "planar" } else { "spatial" };
        line(&mut out, &format!("dimension = \"{dimension}\""));
        line(&mut out, &format!("gravity = {}", self.vector(&self.gravity)));
        if let Some(height) = self.road {
            line(
                &mut out,
                &format!("\n[roads]\nroad = {{ type = \"flat\", height = {height:?} }}"),
            );
        }
        line(&mut out, "\n[bodies]");
        for (i, body) in self.bodies.iter().enumerate() {
            let tensor = Self::inertia(body);
            let inertia =
                if self.planar { format!("{:?}", tensor[2][2]) } else { format!("{tensor:?}") };
            let turned = if self.planar {
                format!("angle = {:?}", body.angle)
            } else {
                format!("euler_parameters = {:?}", euler_parameters(&body.axes))
            };
            let position = self.vector(&Self::origin(body));
            let center = self.vector(&Self::center_of_mass(body));
            let mass = body.mass;
            line(
                &mut out,
                &format!(
                    "b{i} = {{ mass = {mass:?}, inertia = {inertia}, position = {position}, {turned}, center_of_mass = {center} }}"
                ),
            );
        }
        line(&mut out, "\n[joints]");
        for (i, joint) in self.joints.iter().enumerate() {
            if joint.kind != Kind::Floating {
                line(&mut out, &format!("j{i} = {{ {} }}", self.joint(joint)));
            }
        }
        line(&mut out, "\n[forces]");
        let mut extra = String::new();
        for (i, element) in self.elements.iter().enumerate() {
            line(&mut out, &format!("f{i} = {{ {} }}", self.element(element)));
            if element.law == Law::Maxwell {
                line(&mut extra, &format!("f{i} = {:?}", element.preload[0] / element.stiffness));
            }
        }
        for (i, load) in self.loads.iter().enumerate() {
            line(&mut out, &format!("l{i} = {{ {} }}", self.load(load)));
        }
        line(&mut out, "\n[drivers]");
        for (i, driver) in self.drivers.iter().enumerate() {
            line(&mut out, &format!("d{i} = {{ {} }}", self.driver(driver)));
        }
        line(&mut out, "\n[initial.extra_states]");
        out.push_str(&extra);
        line(&mut out, "\n[initial.bodies]");
        for (i, body) in self.bodies.iter().enumerate() {
            let velocity = self.vector(&body.velocity);
            let turning = if self.planar {
                format!("{:?}", body.angular_velocity[2])
            } else {
                format!("{:?}", body.angular_velocity)
            };
            line(
                &mut out,
                &format!("b{i} = {{ velocity = {velocity}, angular_velocity = {turning} }}"),
            );
        }
        line(&mut out, &format!("\n[simulation]\nend_time = {:?}", self.span));
        out
    }

    fn vector(&self, x: &V3) -> String {
        if self.planar { format!("{:?}", &x[..2]) } else { format!("{x:?}") }
    }

    fn joint(&self, joint: &Joint) -> String {
        let ordered = |pair: [V3; 2]| if joint.reversed { [pair[1], pair[0]] } else { pair };
        let Joint { kind, mut between, .. } = *joint;
        if joint.reversed {
            between.reverse();
        }
        let (points, axes) = (ordered(joint.points), ordered(joint.axes));
        let name = format!("{kind:?}").to_lowercase();
        let mut out = format!("type = \"{name}\", {}", self::between(between));
        match kind {
            Kind::Distance => {
                let [a, b] = points.map(|p| self.vector(&p));
                let _ = write!(out, ", points = [{a}, {b}]");
            }
            _ => {
                let _ = write!(out, ", point = {}", self.vector(&points[0]));
            }
        }
        match kind {
            Kind::Universal => {
                let [a, b] = axes.map(|p| self.vector(&p));
                let _ = write!(out, ", axes = [{a}, {b}]");
            }
            Kind::Translational | Kind::Cylindrical => {
                let _ = write!(out, ", axis = {}", self.vector(&axes[0]));
            }
            Kind::Revolute if !self.planar => {
                let _ = write!(out, ", axis = {}", self.vector(&axes[0]));
            }
            _ => {}
        }
        out
    }

    fn element(&self, element: &Element) -> String {
        let Element { law, stiffness, preload, points, .. } = element;
        let elastic = |field: &str| match element.gap {
            None => format!("stiffness = {stiffness:?}"),
            Some(gap) => {
                let x = [-1.0 - gap, -gap, gap, 1.0 + gap];
                format!("{field} = {{ x = {x:?}, y = {:?} }}", [-stiffness, 0.0, 0.0, *stiffness])
            }
        };
        let damping = element.damping * stiffness;
        let mut out = between(element.between);
        let axes = transpose(&element.axes);
        match law {
            Law::Tsda | Law::Maxwell => {
                let name = if *law == Law::Tsda { "tsda" } else { "maxwell" };
                let [a, b] = points.map(|p| self.vector(&p));
                let length = norm(&sub(&points[1], &points[0]));
                let deformed = if element.gap.is_some() { 0.0 } else { preload[0] / stiffness };
                let (free, elastic) = ((length - deformed).max(0.0), elastic("force"));
                let _ = write!(
                    out,
                    ", type = \"{name}\", points = [{a}, {b}], {elastic}, damping = {damping:?}, free_length = {free:?}"
                );
            }
            Law::Rsda => {
                let angle = if self.planar { self.angle_between(element.between) } else { 0.0 };
                let deformed = if element.gap.is_some() { 0.0 } else { preload[0] / stiffness };
                let (free, elastic) = (angle - deformed, elastic("torque"));
                let _ = write!(
                    out,
                    ", type = \"rsda\", {elastic}, damping = {damping:?}, free_angle = {free:?}"
                );
                if !self.planar {
                    let _ = write!(out, ", axis = {:?}", axes[2]);
                }
            }
            Law::Bushing(turning) => {
                let shift = (0..3)
                    .fold([0.0; 3], |sum, k| add(&sum, &scale(&axes[k], preload[k] / stiffness)));
                let [first, second] = element.between;
                let a = self.in_body(first, &points[0]);
                let b = self.in_body(second, &add(&points[1], &shift));
                let _ = write!(
                    out,
                    ", type = \"bushing\", points_in_body = [{a:?}, {b:?}], axes = [{:?}, {:?}], stiffness = {:?}, damping = {:?}",
                    axes[0], axes[1], [*stiffness; 3], [damping; 3]
                );
                if *turning {
                    let k = stiffness * element.lever;
                    let _ = write!(
                        out,
                        ", rotational_stiffness = {:?}, rotational_damping = {:?}",
                        [k; 3],
                        [k * element.rotational_damping; 3]
                    );
                }
                if let Some([ratio, time]) = element.branch {
                    let k = ratio * stiffness;
                    let about = if *turning { k * element.lever } else { 0.0 };
                    let _ = write!(
                        out,
                        ", branches = {{ only = {{ stiffness = {:?}, rotational_stiffness = {:?}, damping = {:?}, rotational_damping = {:?} }} }}",
                        [k; 3],
                        [about; 3],
                        [k * time; 3],
                        [about * time; 3]
                    );
                }
            }
        }
        out
    }

    fn load(&self, load: &Load) -> String {
        match load {
            Load::Force { on, point, axes, motions } => {
                let motions: Vec<String> = motions.iter().map(function).collect();
                format!(
                    "type = \"point_force\", on = \"b{on}\", point = {}, axes = \"{axes}\", force = [{}]",
                    self.vector(point),
                    motions.join(", ")
                )
            }
            Load::Torque { between: [first, second], axis, axes, motion } => {
                let on = match (first, second) {
                    (None, Some(on)) => format!("on = \"b{on}\""),
                    _ => between([*first, *second]),
                };
                let axis = if self.planar {
                    String::new()
                } else {
                    format!(", axis = {axis:?}, axes = \"{axes}\"")
                };
                format!("type = \"torque\", {on}, torque = {}{axis}", function(motion))
            }
            Load::Tyre { on, point, radius, stiffness, damping, lateral } => {
                let lateral = lateral.map_or(String::new(), |axis| {
                    format!(
                        ", lateral = {{ cornering_stiffness = 50.0, regularization_speed = 0.5, axis = {axis:?} }}"
                    )
                });
                format!(
                    "type = \"tyre\", on = \"b{on}\", point = {point:?}, radius = {radius:?}, stiffness = {stiffness:?}, damping = {damping:?}, smoothing = 0.01, road = \"road\"{lateral}"
                )
            }
        }
    }

    fn driver(&self, driver: &Driver) -> String {
        let joint = &self.joints[driver.joint];
        let what = if driver.rotation { "rotation" } else { "translation" };
        let mut out = format!("coordinate = \"{what}\", motion = {}", function(&driver.motion));
        if !driver.explicit {
            let _ = write!(out, ", joint = \"j{}\"", driver.joint);
            return out;
        }
        let _ = write!(out, ", {}", between(joint.between));
        if !driver.rotation {
            let _ = write!(out, ", point = {}", self.vector(&joint.points[0]));
        }
        if !(driver.rotation && self.planar) {
            let _ = write!(out, ", axis = {}", self.vector(&joint.axes[0]));
        }
        out
    }
}

fn line(out: &mut String, text: &str) {
    out.push_str(text);
    out.push('\n');
}

fn between(between: Between) -> String {
    let [first, second] = between.map(|b| b.map_or("ground".to_owned(), |b| format!("b{b}")));
    format!("between = [\"{first}\", \"{second}\"]")
}

fn function(motion: &Motion) -> String {
    match motion {
        Motion::Constant(value) => format!("{value:?}"),
        Motion::Polynomial(c) => format!("{{ type = \"polynomial\", coefficients = {c:?} }}"),
        Motion::Harmonic(amplitude, w, offset) => format!(
            "{{ type = \"harmonic\", amplitude = {amplitude:?}, angular_frequency = {w:?}, offset = {offset:?} }}"
        ),
        Motion::Step(from, to, start, end) => format!(
            "{{ type = \"smooth_step\", from = {from:?}, to = {to:?}, start = {start:?}, end = {end:?} }}"
        ),
        Motion::Table(h, y) => {
            format!("{{ type = \"table\", x = {:?}, y = {y:?} }}", [0.0, *h, 2.0 * h])
        }
    }
}
