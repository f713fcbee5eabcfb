//! Rules that numbers of a model keep, whoever built it. Paths are those of a model file.

use super::{
    Body, Dimension, Driver, DriverKind, ElasticLaw, Force, ForceKind, Frame, InitialExtraState,
    Joint, JointKind, Model, Orientation, Shape, ShapeKind, SimulationDefaults,
};
use crate::error::{Code, Diagnostic, shown};
use crate::math::TimeFunction;
use crate::watch::{NAMED, checkpoint};

/// Farthest that a point may lie, and largest length, m: beyond, double precision no longer resolves
/// a tenth of a micrometre.
pub const FARTHEST: f64 = 1e9;
/// All violations of the rules, in the order of the model.
pub fn validate(model: &Model) -> Vec<Diagnostic> {
    let mut rules = Rules { errors: Vec::new() };
    if model.bodies.is_empty() {
        let help = "state one under [bodies]; one with `enabled = false` does not count";
        rules.refuse(Code::MissingField, "bodies", "the model has no bodies".to_owned(), help);
    }
    for body in &model.bodies {
        checkpoint(NAMED);
        rules.body(body, model.dimension);
    }
    for joint in &model.joints {
        checkpoint(NAMED);
        rules.joint(joint, model);
    }
    for force in &model.forces {
        checkpoint(NAMED);
        rules.force(force, model);
    }
    for driver in &model.drivers {
        rules.driver(driver, model);
    }
    if let Some(interval) = model.outputs.interval {
        rules.positive("outputs.interval", interval, "s");
    }
    rules.initial(model);
    rules.extra_states(model);
    rules.simulation(&model.simulation);
    rules.errors
}

pub(super) struct Rules {
    errors: Vec<Diagnostic>,
}

impl Rules {
    pub(super) fn refuse(&mut self, code: Code, path: &str, message: String, help: &str) {
        self.errors.push(Diagnostic::new(code, path, message).help(help));
    }

    fn positive(&mut self, path: &str, value: f64, unit: &str) {
        if !(value.is_finite() && value > 0.0) {
            let value = quantity(value, unit);
            let message = format!("`{path}` is {value}; expected a positive number");
            self.refuse(Code::OutOfRange, path, message, "");
        }
    }

    fn not_negative(&mut self, path: &str, value: f64, unit: &str) {
        if !(value.is_finite() && value >= 0.0) {
            let help = match unit {
                "kg" => "zero is allowed where other bodies give the motion a mass",
                u if u.starts_with('N') => "a negative one would feed energy into the motion",
                _ => "",
            };
            let value = quantity(value, unit);
            let message = format!("`{path}` is {value}; expected a number not below zero");
            self.refuse(Code::OutOfRange, path, message, help);
        }
    }

    fn body(&mut self, body: &Body, dimension: Dimension) {
        let item = format!("bodies.{}", body.name);
        self.not_negative(&format!("{item}.mass"), body.mass, "kg");
        for (field, point) in
            [("position", &body.position), ("center_of_mass", &body.center_of_mass)]
        {
            let path = format!("{item}.{field}");
            self.near(&path, &format!("`{path}`"), point);
        }
        if !is_far(body) {
            for (marker, point) in &body.markers {
                let path = format!("{item}.markers.{marker}");
                self.near(&path, &format!("`{path}`"), point);
            }
        }
        let path = format!("{item}.inertia");
        match dimension {
            Dimension::Planar => self.not_negative(&path, body.inertia[2][2], "kg m²"),
            Dimension::Spatial => {
                if let Err((message, help)) = inertia_rules(&body.inertia) {
                    self.refuse(Code::Inertia, &path, format!("`{path}` {message}"), help);
                }
            }
        }
        for shape in &body.shapes {
            self.shape(&format!("{item}.shapes.{}", shape.name), shape);
        }
        if let (Orientation::EulerParameters(_), Dimension::Planar)
        | (Orientation::Angle(_), Dimension::Spatial) = (body.orientation, dimension)
        {
            let message = format!("`{item}` has the orientation of the other dimension");
            self.refuse(Code::WrongDimension, &item, message, "");
        }
    }

    fn shape(&mut self, item: &str, shape: &Shape) {
        self.near(&format!("{item}.position"), &format!("`{item}`"), &shape.position);
        match &shape.kind {
            ShapeKind::Box { size } => {
                for (k, edge) in size.iter().enumerate() {
                    self.length(&format!("{item}.size[{k}]"), *edge);
                }
            }
            ShapeKind::Cylinder { radius, length } | ShapeKind::Capsule { radius, length } => {
                self.length(&format!("{item}.radius"), *radius);
                self.length(&format!("{item}.length"), *length);
            }
            ShapeKind::Sphere { radius } => self.length(&format!("{item}.radius"), *radius),
            ShapeKind::Mesh(surface) => {
                for vertex in &surface.vertices {
                    checkpoint(NAMED);
                    if vertex.iter().any(|x| !(0.0..=FARTHEST).contains(&x.abs())) {
                        self.near(&format!("{item}.vertices"), &format!("`{item}`"), vertex);
                        break;
                    }
                }
            }
        }
        if !(0.0..=1.0).contains(&shape.opacity) {
            let path = format!("{item}.opacity");
            let message = format!("`{path}` is {}; expected 0 to 1", shown(shape.opacity));
            self.refuse(Code::OutOfRange, &path, message, "");
        }
    }

    /// A positive length.
    fn length(&mut self, path: &str, value: f64) {
        self.positive(path, value, "m");
        self.within(path, value);
    }

    fn free_length(&mut self, item: &str, value: f64) {
        let path = format!("{item}.free_length");
        self.not_negative(&path, value, "m");
        self.within(&path, value);
    }

    pub(super) fn within(&mut self, path: &str, value: f64) {
        if value.abs() > FARTHEST {
            let message = format!("`{path}` is {} m; expected at most 1e9 m in size", shown(value));
            self.refuse(Code::OutOfRange, path, message, "lengths are in metres");
        }
    }

    fn near(&mut self, path: &str, what: &str, point: &[f64; 3]) {
        if let Some(&x) = point.iter().find(|x| !(0.0..=FARTHEST).contains(&x.abs())) {
            let message =
                format!("{what} has the coordinate {} m; expected at most 1e9 m in size", shown(x));
            self.refuse(Code::OutOfRange, path, message, "lengths are in metres");
        }
    }

    fn frames(&mut self, item: &str, frames: &[Frame; 2], model: &Model) {
        for (side, frame) in frames.iter().enumerate() {
            self.frame(&format!("{item}.between[{side}]"), frame, model);
        }
        if frames[0].body == frames[1].body {
            let path = format!("{item}.between");
            let message = format!("`{path}` connects a body with itself");
            self.refuse(Code::SameBody, &path, message, "name two different bodies");
        }
    }

    fn frame(&mut self, path: &str, frame: &Frame, model: &Model) {
        if frame.body.is_some_and(|body| body >= model.bodies.len()) {
            let message = format!("`{path}` is a body that is not there");
            self.refuse(Code::UnknownName, path, message, "");
        }
        if !frame.body.and_then(|i| model.bodies.get(i)).is_some_and(is_far) {
            let item = path.rsplit_once('.').map_or(path, |(item, _)| item);
            self.near(item, &format!("a point of `{item}`"), &frame.point);
        }
    }

    fn joint(&mut self, joint: &Joint, model: &Model) {
        let item = format!("joints.{}", joint.name);
        self.frames(&item, &joint.frames, model);
        match joint.kind {
            JointKind::Distance { length } => self.length(&format!("{item}.length"), length),
            JointKind::Cylindrical | JointKind::Universal | JointKind::Spherical
                if model.dimension == Dimension::Planar =>
            {
                let message = format!("`{item}` is of a type that exists in spatial models only");
                self.refuse(Code::WrongDimension, &item, message, "");
            }
            _ => {}
        }
    }

    fn driver(&mut self, driver: &Driver, model: &Model) {
        let item = format!("drivers.{}", driver.name);
        self.frames(&item, &driver.frames, model);
        self.motion(&format!("{item}.motion"), &driver.motion);
    }

    fn motion(&mut self, path: &str, motion: &TimeFunction) {
        let finite = |t: f64| motion.derivatives(t).iter().all(|x| x.is_finite());
        if let TimeFunction::Table { spline, .. } = motion
            && !spline.knots().iter().all(|&t| finite(t))
        {
            self.too_large(path);
        }
    }

    fn law(&mut self, item: &str, law: &ElasticLaw, unit: &str) {
        match law {
            ElasticLaw::Linear(stiffness) => {
                self.not_negative(&format!("{item}.stiffness"), *stiffness, unit);
            }
            ElasticLaw::Table(cubic) => {
                let finite = |&x: &f64| {
                    let (value, slope) = cubic.value_and_slope(x);
                    value.is_finite() && slope.is_finite() && cubic.integral(x).is_finite()
                };
                if !cubic.knots().iter().all(finite) {
                    self.too_large(item);
                }
            }
        }
    }

    fn too_large(&mut self, path: &str) {
        let message = format!("the table of `{path}` holds numbers too large to interpolate");
        self.refuse(Code::Table, path, message, "look for a slip in an exponent");
    }

    fn force(&mut self, force: &Force, model: &Model) {
        let item = &format!("forces.{}", force.name);
        let at = |field: &str| format!("{item}.{field}");
        match &force.kind {
            ForceKind::Tsda { frames, law, damping, free_length } => {
                self.frames(item, frames, model);
                self.law(item, law, "N/m");
                self.not_negative(&at("damping"), *damping, "N s/m");
                self.free_length(item, *free_length);
            }
            ForceKind::Rsda { frames, law, damping, .. } => {
                self.frames(item, frames, model);
                self.law(item, law, "N m/rad");
                self.not_negative(&at("damping"), *damping, "N m s/rad");
            }
            ForceKind::Maxwell { frames, stiffness, damping, free_length } => {
                self.frames(item, frames, model);
                self.positive(&at("stiffness"), *stiffness, "N/m");
                self.positive(&at("damping"), *damping, "N s/m");
                self.free_length(item, *free_length);
            }
            ForceKind::Bushing { frames, stiffness, damping, branches } => {
                self.frames(item, frames, model);
                self.bushing(item, [stiffness, damping], branches);
            }
            ForceKind::Tyre(tyre) => {
                self.frame(&at("on"), &tyre.frame, model);
                self.length(&at("radius"), tyre.radius);
                self.not_negative(&at("stiffness"), tyre.stiffness, "N/m");
                self.not_negative(&at("damping"), tyre.damping, "N s/m");
                self.length(&at("smoothing"), tyre.smoothing);
                if let Some(lateral) = &tyre.lateral {
                    let path = at("lateral.cornering_stiffness");
                    self.not_negative(&path, lateral.cornering_stiffness, "N/rad");
                    let path = at("lateral.regularization_speed");
                    self.positive(&path, lateral.regularization_speed, "m/s");
                }
            }
            ForceKind::PointForce { frame, force, .. } => {
                self.frame(&at("on"), frame, model);
                for f in force {
                    self.motion(&at("force"), f);
                }
            }
            ForceKind::Torque { torque, .. } => {
                for f in torque {
                    self.motion(&at("torque"), f);
                }
            }
        }
    }

    /// Where bodies and joints are stated to start.
    fn initial(&mut self, model: &Model) {
        for (body, stated) in model.bodies.iter().zip(&model.initial.bodies) {
            if let Some(position) = &stated.position {
                let path = format!("initial.bodies.{}.position", body.name);
                self.near(&path, &format!("`{path}`"), position);
            }
        }
        for stated in &model.initial.joints {
            if stated.kind == DriverKind::Translation && !stated.is_rate {
                let joint = &model.joints[stated.joint].name;
                self.within(&format!("initial.joints.{joint}.{}", stated.field), stated.value);
            }
        }
        for (name, stated) in &model.initial.extra_states {
            if let InitialExtraState::Spring(extension) = stated {
                self.within(&format!("initial.extra_states.{name}"), *extension);
            }
        }
    }

    fn simulation(&mut self, s: &SimulationDefaults) {
        let start = s.start_time.unwrap_or(0.0);
        if let Some(end) = s.end_time
            && !(end.is_finite() && end >= start)
        {
            let path = "simulation.end_time";
            let [end, start] = [end, start].map(shown);
            let message =
                format!("`{path}` is {end} s; expected a time not before the start, {start} s");
            self.refuse(Code::OutOfRange, path, message, "");
        }
        let times = [
            ("fixed_step", s.fixed_step),
            ("max_step", s.max_step),
            ("initial_step", s.initial_step),
            ("max_seconds", s.max_seconds),
        ];
        for (field, value) in times {
            if let Some(value) = value {
                self.positive(&format!("simulation.{field}"), value, "s");
            }
        }
        if let Some(t) = s.tolerance {
            if t.relative == t.translation && t.relative == t.rotation {
                self.positive("simulation.tolerance", t.relative, "");
            } else {
                self.positive("simulation.tolerance.relative", t.relative, "");
                self.positive("simulation.tolerance.translation", t.translation, "m");
                self.positive("simulation.tolerance.rotation", t.rotation, "rad");
            }
        }
        if let Some(factor) = s.repartition_factor
            && !(factor.is_finite() && factor > 1.0)
        {
            let path = "simulation.repartition_factor";
            let message = format!("`{path}` is {}; expected a number above 1", shown(factor));
            self.refuse(Code::OutOfRange, path, message, "");
        }
    }
}

/// Whether a body is too far away: so are its points, which is reported once, at the body.
fn is_far(body: &Body) -> bool {
    body.position.iter().any(|x| x.abs() > FARTHEST)
}

fn quantity(value: f64, unit: &str) -> String {
    if unit.is_empty() { shown(value) } else { format!("{} {unit}", shown(value)) }
}

pub(super) type Rule = Result<(), (String, &'static str)>;

/// Relative slack of symmetry, definiteness and the triangle inequality: digits of a file.
pub(super) const SLACK: f64 = 1e-9;

/// An inertia tensor is symmetric, positive semidefinite and keeps the triangle inequality: the
/// largest principal moment is at most the sum of the others. With tr the trace, that is
/// ½ tr(J) I − J, the tensor of second moments of mass, being positive semidefinite.
fn inertia_rules(j: &[[f64; 3]; 3]) -> Rule {
    let trace = j[0][0] + j[1][1] + j[2][2];
    let size = j.iter().flatten().fold(0.0, |m: f64, x| m.max(x.abs()));
    if let Some((r, c)) = asymmetric(j, SLACK * size) {
        let (a, b) = (shown(j[r][c]), shown(j[c][r]));
        let message = format!("is not symmetric: [{r}][{c}] is {a}, [{c}][{r}] is {b}");
        return Err((
            message,
            "off-diagonal entries are minus the products of inertia, on both sides",
        ));
    }
    for k in 0..3 {
        if j[k][k] < -SLACK * size {
            let message = format!("has the negative moment {} about axis {k}", shown(j[k][k]));
            return Err((message, "moments of inertia are sums of mass times distance squared"));
        }
    }
    let mut second = j.map(|row| row.map(|x| -x));
    for k in 0..3 {
        second[k][k] += 0.5 * trace;
    }
    if semidefinite(&second, SLACK * size) {
        return Ok(()); // J = tr(S) I − S is then positive semidefinite too
    }
    let diagonal = [j[0][0], j[1][1], j[2][2]];
    let (k, largest) =
        (0..3).map(|k| (k, diagonal[k])).fold((0, f64::MIN), |m, x| if x.1 > m.1 { x } else { m });
    let message = if largest > trace - largest {
        let (largest, others) = (shown(largest), shown(trace - largest));
        format!(
            "violates the triangle inequality: {largest} about axis {k} exceeds the sum {others} of the others"
        )
    } else {
        "violates the triangle inequality for its principal moments".to_owned()
    };
    Err((
        message,
        "no distribution of mass has this inertia: check units, signs and the reference point (centre of mass)",
    ))
}

pub(super) fn matrix_rules(k: &[[f64; 6]; 6]) -> Rule {
    // Rows of lengths and of angles differ in size: scaled by the diagonal, all have size one.
    for i in 0..6 {
        if k[i][i] < 0.0 {
            let entry = shown(k[i][i]);
            let message = format!("has the negative entry {entry} on its diagonal at [{i}][{i}]");
            return Err((message, "give a positive semidefinite matrix"));
        }
    }
    let scale = |i: usize| if k[i][i] > 0.0 { k[i][i].sqrt() } else { 1.0 };
    let mut scaled = *k;
    for i in 0..6 {
        for j in 0..6 {
            scaled[i][j] /= scale(i) * scale(j);
        }
    }
    let size = scaled.iter().flatten().fold(0.0, |m: f64, x| m.max(x.abs()));
    if let Some((r, c)) = asymmetric(&scaled, SLACK * size) {
        let message = format!(
            "is not symmetric: [{r}][{c}] is {}, [{c}][{r}] is {}",
            shown(k[r][c]),
            shown(k[c][r])
        );
        return Err((message, "give the same number on both sides of the diagonal"));
    }
    if semidefinite(&scaled, SLACK * size) {
        return Ok(());
    }
    Err((
        "is not positive semidefinite: some deformation would give energy away".to_owned(),
        "check signs and the size of the off-diagonal entries",
    ))
}

fn asymmetric<const N: usize>(a: &[[f64; N]; N], slack: f64) -> Option<(usize, usize)> {
    let pairs = (0..N).flat_map(|r| (r + 1..N).map(move |c| (r, c)));
    pairs.into_iter().find(|&(r, c)| (a[r][c] - a[c][r]).abs() > slack)
}

/// Whether a symmetric matrix has no eigenvalue below −slack: Cholesky with diagonal pivoting of
/// A + slack I, where a vanishing pivot must leave a vanishing rest.
pub(super) fn semidefinite<const N: usize>(a: &[[f64; N]; N], slack: f64) -> bool {
    let mut a = *a;
    for i in 0..N {
        a[i][i] += slack;
    }
    for k in 0..N {
        let pivot = (k..N).fold(k, |m, i| if a[i][i] > a[m][m] { i } else { m });
        a.swap(k, pivot);
        for row in &mut a {
            row.swap(k, pivot);
        }
        let d = a[k][k];
        if d <= 0.0 {
            return (k..N).all(|i| (k..N).all(|j| a[i][j].abs() <= slack));
        }
        for i in k + 1..N {
            let factor = a[i][k] / d;
            for j in k + 1..N {
                a[i][j] -= factor * a[k][j];
            }
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test] // independent truth: bodies whose second moments of mass are known
    fn inertia_of_real_bodies_is_accepted_and_others_refused() {
        let diagonal = |a: f64, b: f64, c: f64| [[a, 0.0, 0.0], [0.0, b, 0.0], [0.0, 0.0, c]];
        // rod (flat limit), sphere, disc (a flat body keeps the inequality as equality), nothing
        for j in [
            diagonal(0.0, 1.0, 1.0),
            diagonal(2.0, 2.0, 2.0),
            diagonal(1.0, 1.0, 2.0),
            diagonal(0.0, 0.0, 0.0),
            diagonal(1e-12, 1e-12, 2e-12),
        ] {
            assert!(inertia_rules(&j).is_ok(), "{j:?}");
        }
        for j in [diagonal(1.0, 1.0, 2.01), diagonal(-1.0, 1.0, 1.0), diagonal(1.0, 0.0, 0.0)] {
            assert!(inertia_rules(&j).is_err(), "{j:?}");
        }
        // Two particles of 1 kg at ±(1, 1, 0): J = 2 (r·r I − r rᵀ), a rod turned by 45 degrees.
        let rod = [[2.0, -2.0, 0.0], [-2.0, 2.0, 0.0], [0.0, 0.0, 4.0]];
        assert!(inertia_rules(&rod).is_ok());
        let mut wrong_sign_size = rod;
        wrong_sign_size[0][1] = 2.5;
        wrong_sign_size[1][0] = 2.5;
        assert!(inertia_rules(&wrong_sign_size).is_err());
        assert!(inertia_rules(&[[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]).is_err());
    }

    #[test] // independent truth: B Bᵀ has no negative eigenvalue, and B Bᵀ − c u uᵀ may have one
    fn semidefinite_matrices_are_told_from_indefinite_ones() {
        let mut seed = 1_u64;
        let mut random = || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        for rank in 1..=6 {
            for _ in 0..50 {
                let b: Vec<[f64; 6]> = (0..rank).map(|_| [0; 6].map(|_| random())).collect();
                let mut k = [[0.0; 6]; 6];
                for i in 0..6 {
                    for j in 0..6 {
                        k[i][j] = b.iter().map(|row| row[i] * row[j]).sum();
                    }
                }
                assert!(matrix_rules(&k).is_ok(), "rank {rank}");
                let norm: f64 = (0..6).map(|i| k[i][i]).sum();
                let mut less = k;
                let u = [0; 6].map(|_| random());
                let uu: f64 = u.iter().map(|x| x * x).sum();
                for i in 0..6 {
                    for j in 0..6 {
                        // uᵀ (K − 1.1 tr(K) u uᵀ/|u|²) u ≤ (1 − 1.1) tr(K) |u|² < 0
                        less[i][j] -= 1.1 * norm * u[i] * u[j] / uu;
                    }
                }
                assert!(matrix_rules(&less).is_err(), "rank {rank}");
            }
        }
    }
}
