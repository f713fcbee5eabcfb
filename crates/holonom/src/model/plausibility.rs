//! What is legal but looks like another unit: millimetres, degrees, grams.

use super::{Body, Dimension, DriverKind, ForceKind, Frame, JointKind, Model, Orientation};
use crate::error::{Code, Diagnostic, Warning, rounded, shown};
use crate::math::TimeFunction;
use crate::watch::{NAMED, checkpoint};

/// kg: heavier or lighter single bodies are rare.
const MASS: [f64; 2] = [1e-6, 1e6];
/// m: points of a body rarely lie farther from its origin.
const LENGTH: f64 = 1e3;
/// m/s²: gravity is about 9.81, in millimetres 9810.
const GRAVITY: f64 = 100.0;
/// m/s²: what gravity is on earth, and the units of length, m, in whose number it is stated by mistake.
const ON_EARTH: [f64; 2] = [9.77, 9.84];
const PARTS_OF_A_METRE: [f64; 4] = [1e-3, 1e-2, 0.0254, 0.3048];
/// Distance of a body over the size of the model: more loses digits that constraints need.
const DISTANCE: f64 = 1e7;
/// Part of the range of a table's points by which the curve through them may leave it.
const OVERSHOOT: f64 = 0.5;
/// Turns: more than a mechanism starts with.
const TURNS: f64 = 100.0;
/// A length over those around it: in millimetres it is 1000 times what it should be.
const LONG: f64 = 100.0;
/// A radius of gyration over the distance of a body's points from its centre: in kg mm² it is 1000 times what it should be,
/// and metres. A rotor that is smaller may have its axle next to its centre.
const WIDE: f64 = 200.0;
const WIDE_RADIUS: f64 = 1.0;
/// Of the radius: points nearer to the centre are there but for round-off.
const AT_CENTER: f64 = 1e-5;
/// m, and kg/m: what is larger and lighter is rare.
const LARGE_AND_LIGHT: [f64; 2] = [50.0, 0.1];
/// m: shorter displacements are not told from a long way of a small body.
const WAY: f64 = 10.0;

/// Base quantities whose unit a file states: their numbers are meant as they are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StatedUnits {
    /// Unit of length.
    pub length: bool,
    /// Unit of angles.
    pub angle: bool,
    /// Unit of mass.
    pub mass: bool,
}

/// Warnings about numbers that are legal but implausible. What looks like another unit is told where the file does not
/// state that unit.
pub fn implausible(model: &Model, stated: StatedUnits) -> Vec<Warning> {
    let mut out = Vec::new();
    let mut warn = |path: String, message: String, help: &str| {
        out.push(Diagnostic::new(Code::Implausible, path, message).help(help));
    };
    accelerated(&mut warn, model, stated.length);
    if !stated.mass {
        heavy(&mut warn, model);
    }
    if !(stated.length || stated.mass) {
        wide(&mut warn, model);
        light(&mut warn, model);
    }
    if !stated.angle {
        turned(&mut warn, model);
    }
    distant(&mut warn, model);
    if !stated.length {
        far(&mut warn, model);
        long_springs(&mut warn, model);
    }
    prescribed(&mut warn, model, stated);
    let start = model.simulation.start_time.unwrap_or(0.0);
    for table in motion_tables(model) {
        if let Some(end) = model.simulation.end_time
            && !table.covers(start, end)
        {
            let path = table.path;
            let [first, last, start, end] = [table.first, table.last, start, end].map(shown);
            let message = format!(
                "the table of `{path}` reaches from {first} s to {last} s; the run from {start} s to {end} s"
            );
            let help = "extend the table or shorten the run";
            out.push(Diagnostic::new(Code::ShortTable, path, message).help(help));
        }
    }
    for_motions(model, |path, function| {
        if let TimeFunction::Table { spline, .. } = function
            && let Some([found, given]) = overshoot(spline.knots(), function)
        {
            let [least, most] = given.map(shown);
            let message = format!(
                "the curve through the table of `{path}` reaches from {:.2e} to {:.2e} between its points, \
                 which lie from {least} to {most}",
                found[0], found[1]
            );
            let help = "a motion is the natural cubic spline through its points: give more of them where it is sudden, \
                        or use `smooth_step`";
            out.push(Diagnostic::new(Code::Implausible, path, message).help(help));
        }
    });
    out
}

/// Ranges of a curve and of the points that it goes through, where it leaves theirs by more than half of it: a wave that is
/// sampled at few points does by less.
fn overshoot(times: &[f64], function: &TimeFunction) -> Option<[[f64; 2]; 2]> {
    const SAMPLES: usize = 8;
    let range = |values: &mut dyn Iterator<Item = f64>| {
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [x.min(a), x.max(b)])
    };
    let value = |t: f64| function.derivatives(t)[0];
    let given = range(&mut times.iter().map(|&t| value(t)));
    let between = times.windows(2).flat_map(|two| {
        checkpoint(NAMED);
        let step = (two[1] - two[0]) / SAMPLES as f64;
        (1..SAMPLES).map(move |k| two[0] + k as f64 * step)
    });
    let found = range(&mut between.map(value));
    let allowed = OVERSHOOT * (given[1] - given[0]);
    (found[0] < given[0] - allowed || found[1] > given[1] + allowed).then_some([found, given])
}

/// A table of times that a driver or an applied force follows.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionTable {
    /// Path of the motion in the model.
    pub path: String,
    /// Where the table is written: `tables.lift`, or the path of the motion.
    pub name: String,
    /// First time, s.
    pub first: f64,
    /// Last time, s.
    pub last: f64,
}

impl MotionTable {
    /// Whether the table holds all times of a run, up to round-off of its ends.
    pub fn covers(&self, start: f64, end: f64) -> bool {
        let slack = 1e-12 * (self.last - self.first).max(self.first.abs()).max(self.last.abs());
        start >= self.first - slack && end <= self.last + slack
    }
}

/// The tables of times of a model, one entry for each motion that follows one.
pub fn motion_tables(model: &Model) -> Vec<MotionTable> {
    let mut out = Vec::new();
    for_motions(model, |path, function| {
        let TimeFunction::Table { spline, name } = function else { return };
        let knots = spline.knots();
        let name = if name.is_empty() { path.clone() } else { name.clone() };
        let (first, last) = (knots[0], knots[knots.len() - 1]);
        out.push(MotionTable { path, name, first, last });
    });
    out.dedup();
    out
}

/// Starts and ends, s, of the smooth steps of applied forces.
pub fn force_ramps(model: &Model) -> Vec<[f64; 2]> {
    let mut out = Vec::new();
    for_motions(model, |path, function| {
        if let TimeFunction::SmoothStep { from, to, start, end } = function
            && from != to
            && path.starts_with("forces.")
        {
            out.push([*start, *end]);
        }
    });
    out
}

/// Angular frequencies, rad/s, of the harmonic forces and torques, each once.
pub fn force_frequencies(model: &Model) -> Vec<f64> {
    frequencies_where(model, |path| path.starts_with("forces."))
}

/// The same of drivers, too.
pub fn frequencies(model: &Model) -> Vec<f64> {
    frequencies_where(model, |_| true)
}

fn frequencies_where(model: &Model, counts: impl Fn(&str) -> bool) -> Vec<f64> {
    let mut out = Vec::new();
    for_motions(model, |path, function| {
        if let TimeFunction::Harmonic { amplitude, angular_frequency, .. } = function
            && *amplitude != 0.0
            && *angular_frequency != 0.0
            && counts(&path)
            && !out.contains(&angular_frequency.abs())
        {
            out.push(angular_frequency.abs());
        }
    });
    out
}

/// The functions of time, of drivers and applied forces, that are no constants.
pub fn changing_motions(model: &Model) -> Vec<&TimeFunction> {
    let mut out = Vec::new();
    for_motions(model, |_, function| {
        if !function.is_constant() {
            out.push(function);
        }
    });
    out
}

/// Tells all functions of time with their paths.
fn for_motions<'a>(model: &'a Model, mut add: impl FnMut(String, &'a TimeFunction)) {
    for driver in &model.drivers {
        add(format!("drivers.{}.motion", driver.name), &driver.motion);
    }
    for force in &model.forces {
        let (field, functions) = match &force.kind {
            ForceKind::PointForce { force, .. } => ("force", force),
            ForceKind::Torque { torque, .. } => ("torque", torque),
            _ => continue,
        };
        for function in functions {
            add(format!("forces.{}.{field}", force.name), function);
        }
    }
}

/// Gravity that is not that of any place, or that of the earth in another unit than the file's, whatever that is.
fn accelerated(warn: &mut impl FnMut(String, String, &str), model: &Model, is_stated: bool) {
    let gravity = model.gravity.iter().map(|x| x * x).sum::<f64>().sqrt();
    if gravity > GRAVITY && !is_stated {
        let message = format!("`gravity` is {} m/s²", shown(gravity));
        warn("gravity".into(), message, "on earth it is 9.81 m/s²; are lengths in millimetres?");
    }
    let of_earth = |part: &f64| (ON_EARTH[0] * part..=ON_EARTH[1] * part).contains(&gravity);
    if PARTS_OF_A_METRE.iter().any(of_earth) {
        let message = format!("`gravity` is {} m/s²", shown(gravity));
        let help =
            "gravity is in the file's unit of length, too: on earth 9.81 m/s², or 9810 mm/s²";
        warn("gravity".into(), message, help);
    }
}

/// Masses of single bodies.
fn heavy(warn: &mut impl FnMut(String, String, &str), model: &Model) {
    for body in &model.bodies {
        checkpoint(NAMED);
        if body.mass > MASS[1] || (body.mass > 0.0 && body.mass < MASS[0]) {
            let message = format!("the mass of `{}` is {} kg", body.name, shown(body.mass));
            warn(format!("bodies.{}.mass", body.name), message, "masses are in kilograms");
        }
    }
}

/// Angles of bodies and of springs.
fn turned(warn: &mut impl FnMut(String, String, &str), model: &Model) {
    for body in &model.bodies {
        checkpoint(NAMED);
        angle(warn, format!("bodies.{}.angle", body.name), body.orientation);
    }
    for (body, initial) in model.bodies.iter().zip(&model.initial.bodies) {
        if let Some(orientation) = initial.orientation {
            angle(warn, format!("initial.bodies.{}.angle", body.name), orientation);
        }
    }
    for force in &model.forces {
        if let ForceKind::Rsda { free_angle, .. } = &force.kind {
            let path = format!("forces.{}.free_angle", force.name);
            angle(warn, path, Orientation::Angle(*free_angle));
        }
    }
}

/// Points of items far from the origins of their bodies.
fn far(warn: &mut impl FnMut(String, String, &str), model: &Model) {
    let mut look = |item: String, frames: &[Frame]| {
        checkpoint(NAMED);
        for frame in frames {
            let Some(body) = frame.body.and_then(|i| model.bodies.get(i)) else { continue };
            let length = frame.point.iter().map(|x| x * x).sum::<f64>().sqrt();
            if length > LENGTH {
                let message = format!(
                    "a point of `{item}` lies {} m from the origin of `{}`",
                    rounded(length),
                    body.name
                );
                warn(item.clone(), message, "lengths are in metres; are they in millimetres?");
            }
        }
    };
    for joint in &model.joints {
        look(format!("joints.{}", joint.name), &joint.frames);
    }
    for force in &model.forces {
        let item = format!("forces.{}", force.name);
        match &force.kind {
            ForceKind::Tsda { frames, .. }
            | ForceKind::Rsda { frames, .. }
            | ForceKind::Maxwell { frames, .. }
            | ForceKind::Bushing { frames, .. } => look(item, frames),
            ForceKind::Tyre(tyre) => look(item, &[tyre.frame]),
            ForceKind::PointForce { frame, .. } => look(item, &[*frame]),
            ForceKind::Torque { .. } => {}
        }
    }
}

/// Bodies whose inertia belongs to something far larger than their points, or than any body.
fn wide(warn: &mut impl FnMut(String, String, &str), model: &Model) {
    let mut reach = vec![0.0f64; model.bodies.len()];
    for frame in model.joints.iter().flat_map(|joint| &joint.frames) {
        let Some(b) = frame.body else { continue };
        let center = &model.bodies[b].center_of_mass;
        let square: f64 = frame.point.iter().zip(center).map(|(x, c)| (x - c) * (x - c)).sum();
        reach[b] = reach[b].max(square.sqrt());
    }
    for (body, reach) in model.bodies.iter().zip(reach) {
        checkpoint(NAMED);
        let radius = (largest_inertia(body, model.dimension) / body.mass).sqrt();
        // r² = J/m is the radius of gyration; no body is that large.
        if body.mass > 0.0 && radius > LENGTH {
            let message = format!("the radius of gyration of `{}` is {radius:.4e} m", body.name);
            let path = format!("bodies.{}.inertia", body.name);
            warn(path, message, "inertia is in kg m²; is it in kg mm²?");
        }
        let is_wide = radius > WIDE_RADIUS.max(WIDE * reach) && radius <= LENGTH;
        if body.mass > 0.0 && reach > AT_CENTER * radius && is_wide {
            let message = format!(
                "the radius of gyration of `{}` is {radius:.4e} m, its joints lie within {reach:.4e} m of its centre of mass",
                body.name
            );
            let path = format!("bodies.{}.inertia", body.name);
            warn(path, message, "inertia is in kg m²; is it in kg mm²?");
        }
    }
}

/// A large model that weighs next to nothing.
fn light(warn: &mut impl FnMut(String, String, &str), model: &Model) {
    let size = model.characteristic_length();
    let mass: f64 = model.bodies.iter().map(|body| body.mass).sum();
    let [large, light] = LARGE_AND_LIGHT;
    let Some(first) = model.bodies.first().filter(|_| size > large && mass < light * size) else {
        return;
    };
    let rough = |x: f64| shown(format!("{x:.1e}").parse().unwrap_or(x));
    let message =
        format!("bodies are about {} m large and weigh {} kg in all", rough(size), rough(mass));
    let path = format!("bodies.{}", first.name);
    warn(path, message, "lengths are in metres; are they in millimetres?");
}

/// J of a body about its centre of mass, the largest, kg m².
fn largest_inertia(body: &Body, dimension: Dimension) -> f64 {
    match dimension {
        Dimension::Planar => body.inertia[2][2],
        Dimension::Spatial => (0..3).map(|k| body.inertia[k][k]).fold(0.0, f64::max),
    }
}

/// Positions far from the origin are coarse: of two nearby points the difference keeps few digits.
fn distant(warn: &mut impl FnMut(String, String, &str), model: &Model) {
    let size = model.characteristic_length();
    let designed = model.bodies.iter().map(|body| ("bodies", &body.name, &body.position));
    let started = model.bodies.iter().zip(&model.initial.bodies).filter_map(|(body, stated)| {
        Some(("initial.bodies", &body.name, stated.position.as_ref()?))
    });
    // Of equal ones the last is taken: where bodies start as designed, that is the design.
    let all = started.chain(designed).map(|(of, name, point)| (farthest(0.0, point), of, name));
    let Some((distance, of, name)) = all.max_by(|a, b| a.0.total_cmp(&b.0)) else { return };
    if distance <= DISTANCE * size {
        return;
    }
    let message = format!(
        "`{name}` lies {distance:.4e} m from the origin, {:.1e} times the model's size of {size:.4e} m: \
         positions keep {:.1e} m of their last digit",
        distance / size,
        distance * f64::EPSILON
    );
    warn(format!("{of}.{name}.position"), message, "put the origin of the ground near the model");
}

/// Lengths of springs and rods far beyond the distance of their points and the size of the model.
fn long_springs(warn: &mut impl FnMut(String, String, &str), model: &Model) {
    let size = size(model);
    let springs = model.forces.iter().filter_map(|force| match &force.kind {
        ForceKind::Tsda { frames, free_length, .. }
        | ForceKind::Maxwell { frames, free_length, .. } => {
            Some((format!("forces.{}.free_length", force.name), frames, *free_length))
        }
        _ => None,
    });
    let rods = model.joints.iter().filter_map(|joint| match joint.kind {
        JointKind::Distance { length } => {
            Some((format!("joints.{}.length", joint.name), &joint.frames, length))
        }
        _ => None,
    });
    for (path, frames, length) in springs.chain(rods) {
        checkpoint(NAMED);
        let distance = model.design_distance(frames);
        if length > LONG * distance.max(size) {
            let message = format!(
                "`{path}` is {} m, while its points are {} m apart in the design configuration",
                shown(length),
                shown(distance)
            );
            warn(path, message, "lengths are in metres; is it in millimetres?");
        }
    }
}

/// Characteristic length, or how far from the origin a body is stated to start, m.
fn size(model: &Model) -> f64 {
    let stated = model.initial.bodies.iter().filter_map(|body| body.position.as_ref());
    stated.fold(model.characteristic_length(), farthest)
}

fn farthest(m: f64, p: &[f64; 3]) -> f64 {
    p.iter().fold(m, |m, x| m.max(x.abs()))
}

/// Values that joints start with and that drivers prescribe. Tables, rates and how far a driver slides say nothing:
/// wheels turn far, and vehicles drive far.
fn prescribed(
    warn: &mut impl FnMut(String, String, &str),
    model: &Model,
    StatedUnits { length, angle: in_angle, .. }: StatedUnits,
) {
    let points = model.joints.iter().flat_map(|j| &j.frames);
    let points = points.chain(model.drivers.iter().flat_map(|d| &d.frames));
    let points = points.map(|frame| &frame.point).chain(model.bodies.iter().map(|b| &b.position));
    let size = points.fold(size(model), farthest);
    let mut look = |path: String, kind: DriverKind, value: f64| match kind {
        DriverKind::Rotation if !in_angle => angle(warn, path, Orientation::Angle(value)),
        DriverKind::Translation if !length && value.abs() > WAY.max(LONG * size) => {
            let message = format!(
                "`{path}` is {} m; the points of the model lie within {} m",
                shown(value),
                shown(size)
            );
            warn(path, message, "lengths are in metres; is it in millimetres?");
        }
        _ => {}
    };
    for stated in model.initial.joints.iter().filter(|stated| !stated.is_rate) {
        let joint = &model.joints[stated.joint].name;
        look(format!("initial.joints.{joint}.{}", stated.field), stated.kind, stated.value);
    }
    for driver in &model.drivers {
        let path = format!("drivers.{}.motion", driver.name);
        let mut part = |field: &str, value: f64| look(format!("{path}{field}"), driver.kind, value);
        match &driver.motion {
            TimeFunction::Constant(value) => part("", *value),
            TimeFunction::Polynomial { coefficients, .. } => {
                part(".coefficients[0]", coefficients.first().copied().unwrap_or(0.0));
            }
            TimeFunction::Harmonic { amplitude, offset, phase, .. } => {
                part(".amplitude", *amplitude);
                part(".offset", *offset);
                look(format!("{path}.phase"), DriverKind::Rotation, *phase);
            }
            TimeFunction::SmoothStep { from, to, .. } => {
                part(".from", *from);
                if driver.kind == DriverKind::Rotation {
                    part(".to", *to);
                }
            }
            TimeFunction::Table { .. } => {}
        }
    }
}

fn angle(warn: &mut impl FnMut(String, String, &str), path: String, orientation: Orientation) {
    if let Orientation::Angle(angle) = orientation
        && let Some((message, help)) = implausible_angle(&path, angle)
    {
        warn(path, message, &help);
    }
}

/// What is said of an angle that looks like degrees, rad, and what to try. 90 is 14.3 turns: whole multiples of 5 beyond one turn
/// are degrees more often than radians.
pub fn implausible_angle(path: &str, angle: f64) -> Option<(String, String)> {
    let turns = angle.abs() / std::f64::consts::TAU;
    (turns > TURNS || (turns > 1.0 && angle % 5.0 == 0.0)).then(|| {
        let (number, radians) = (shown(angle), shown(angle.to_radians()));
        let turns = if turns < 1e7 { format!("{turns:.1}") } else { rounded(turns) };
        let message = format!("`{path}` is {number} rad, {turns} turns");
        (message, format!("angles are in radians: {number} degrees are {radians} rad"))
    })
}
