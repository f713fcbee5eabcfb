//! How a mechanism is drawn: configuration, joints, loops, drivers, force elements, loads.

use super::numbers::{self, IDENTITY, Random, add, norm, perpendicular, sub, unit};
use super::{
    Between, Body, Driver, Element, Joint, Kind, LONGEST, Law, Load, Mechanism, Motion, STIFF,
};

/// A motion of a size `most` that starts at `offset`.
fn motion(random: &mut Random, most: f64, offset: f64, mild: bool) -> Motion {
    let size = random.range(0.2, 1.0) * most * random.one_of(&[-1.0, 1.0]);
    match if mild { 0 } else { random.below(4) } {
        0 => Motion::Harmonic(size, random.logarithmic(1.0, 15.0), offset),
        1 => Motion::Polynomial(vec![offset, size, random.range(-1.0, 1.0) * size]),
        2 => Motion::Step(offset, offset + size, 0.1, random.range(0.5, 1.2)),
        _ => {
            // Longer than any run.
            let [a, b] = [random.range(1.0, 2.0), random.range(-2.0, 2.0)].map(|x| x * size);
            Motion::Table(LONGEST / 2.0, [offset, offset + a, offset + b])
        }
    }
}

impl Mechanism {
    /// The mechanism of a seed. `nudge` changes each independent speed by up to so many rad/s or m/s.
    pub(crate) fn new(seed: u64, nudge: f64) -> Self {
        Self::drawn(seed, nudge, false)
    }

    /// One of bodies that float, alone or a few joined together, with force elements between them.
    pub(crate) fn adrift(seed: u64, nudge: f64) -> Self {
        Self::drawn(seed, nudge, true)
    }

    /// One of either kind whose springs along a line or about an axis are stops with play.
    pub(crate) fn with_stops(seed: u64, nudge: f64) -> Self {
        let mut out = Self::drawn(seed, nudge, seed % 2 == 1);
        let mut random = Random::new(!seed);
        for element in &mut out.elements {
            let play = match element.law {
                Law::Tsda => random.logarithmic(0.02, 0.3),
                Law::Rsda => random.logarithmic(0.05, 0.8),
                Law::Maxwell | Law::Bushing(_) => continue,
            };
            element.gap = Some(play);
            element.stiffness = element.stiffness.clamp(1e2, 1e7);
        }
        out
    }

    fn drawn(seed: u64, nudge: f64, adrift: bool) -> Self {
        let mut random = Random::new(seed);
        let r = &mut random;
        let planar = r.chance(0.4);
        let down = if planar { [0.0, -9.81, 0.0] } else { [0.0, 0.0, -9.81] };
        let tyre = !planar && !adrift && r.chance(0.15);
        let mut out = Self {
            seed,
            planar,
            gravity: if tyre || r.chance(0.8) { down } else { [0.0; 3] },
            bodies: Vec::new(),
            joints: Vec::new(),
            elements: Vec::new(),
            loads: Vec::new(),
            drivers: Vec::new(),
            road: None,
            span: 1.0,
            fastest: 0.0,
            freedom: 0,
            adrift,
        };
        let bodies = if adrift { 2 + r.below(3) } else { 1 + r.below(3) + r.below(2) * r.below(4) };
        // Parallel axes in space: the loops are then redundant.
        let parallel = !planar && r.chance(0.15);
        for _ in 0..bodies {
            out.add_body(r, parallel);
        }
        if r.chance(0.5) {
            for _ in 0..=r.below(2) {
                out.add_loop(r, parallel);
            }
        }
        if r.chance(0.3) {
            out.add_driver(r);
        }
        if adrift {
            out.tie(r);
        }
        let more: &[usize] = if adrift { &[0, 0, 1] } else { &[0, 1, 1, 1, 2, 2, 3, 4] };
        for _ in 0..r.one_of(more) {
            // Most leave the mechanism something to move by.
            let stiffness = r.logarithmic(1.0, 1e10);
            for attempt in 0..5 {
                out.add_element(r, stiffness);
                if out.can_move() || (attempt == 4 && r.chance(0.3)) {
                    break;
                }
                out.elements.pop();
            }
        }
        out.add_branches();
        out.settle();
        if adrift {
            out.change_order(r);
        }
        if tyre {
            out.add_tyre(r);
        }
        for _ in 0..r.one_of(&[0, 0, 1, 2]) {
            out.add_load(r);
        }
        out.set_in_motion(r, nudge);
        out
    }

    fn add_body(&mut self, r: &mut Random, parallel: bool) {
        let planar = self.planar;
        let index = self.bodies.len();
        let on_ground = if self.adrift { 0.1 } else { 0.25 };
        let parent = if index == 0 || r.chance(on_ground) { None } else { Some(r.below(index)) };
        let floats = self.adrift && (index == 1 || r.chance(0.6));
        let kind = match r.below(if planar { 12 } else { 16 }) {
            6..=7 => Kind::Translational,
            8 | 9 => Kind::Floating,
            10 if index > 0 => Kind::Fixed,
            12 if !parallel => Kind::Cylindrical,
            13 if !parallel => Kind::Universal,
            14 | 15 if !parallel => Kind::Spherical,
            _ => Kind::Revolute,
        };
        let kind = if floats { Kind::Floating } else { kind };
        let flat = planar || parallel;
        let parent = if kind == Kind::Floating { None } else { parent };
        let point = add(&self.at(parent), &r.vector(flat, 0.1, 0.6));
        // Some bodies turn about their own centre.
        let centered = r.chance(0.15);
        let center = if centered { point } else { add(&point, &r.vector(flat, 0.1, 0.5)) };
        let axis = match kind {
            Kind::Translational => r.unit(flat),
            _ if flat => [0.0, 0.0, 1.0],
            _ => r.unit(false),
        };
        let mass = r.logarithmic(0.4, 2.5);
        let angle = if r.chance(0.5) { r.range(-2.0, 2.0) } else { 0.0 };
        let axes = match (planar, angle == 0.0) {
            (_, true) => IDENTITY,
            (true, _) => numbers::turn(&[0.0, 0.0, angle]),
            (false, _) => r.rotation(false),
        };
        let mut moments = [0.0; 3];
        for x in moments.iter_mut().take(if planar { 2 } else { 3 }) {
            *x = mass * r.logarithmic(0.03, 0.3).powi(2);
        }
        let along = r.chance(0.5);
        self.bodies.push(Body {
            mass,
            center,
            principal: if along { axes } else { r.rotation(planar) },
            moments,
            axes,
            origin: if r.chance(0.5) { [0.0; 3] } else { r.vector(planar, 0.0, 0.3) },
            angle,
            velocity: [0.0; 3],
            angular_velocity: [0.0; 3],
        });
        let count = match (kind, planar) {
            (Kind::Floating, true) | (Kind::Spherical, _) => 3,
            (Kind::Floating, false) => 6,
            (Kind::Revolute | Kind::Translational, _) => 1,
            (Kind::Cylindrical | Kind::Universal, _) => 2,
            (Kind::Fixed | Kind::Distance, _) => 0,
        };
        let second = if kind == Kind::Universal { perpendicular(&axis) } else { axis };
        let first = self.coordinates();
        let point = if kind == Kind::Floating { center } else { point };
        self.joints.push(Joint {
            kind,
            between: [parent, Some(index)],
            points: [point; 2],
            axes: [axis, second],
            coordinates: Some((first, count)),
            reversed: false,
        });
    }

    /// Two different bodies, or the ground and a body.
    fn pair(&self, r: &mut Random) -> Between {
        let n = self.bodies.len();
        let second = r.below(n);
        let first = r.below(n + 1);
        if first == n || first == second {
            [None, Some(second)]
        } else {
            [Some(first), Some(second)]
        }
    }

    fn add_loop(&mut self, r: &mut Random, parallel: bool) {
        let flat = self.planar || parallel;
        let between = self.pair(r);
        let kind = match r.below(if self.planar { 6 } else { 8 }) {
            0..=1 => Kind::Distance,
            _ if flat => Kind::Revolute,
            2..=4 => Kind::Spherical,
            5 => Kind::Universal,
            6 => Kind::Cylindrical,
            _ => Kind::Revolute,
        };
        let near = self.at(between[1]);
        let point = add(&near, &r.vector(flat, 0.1, 0.4));
        let from = if between[0].is_none() { near } else { self.at(between[0]) };
        let other = match kind {
            Kind::Distance => add(&from, &r.vector(flat, 0.1, 0.6)),
            _ => point,
        };
        let axis = if flat { [0.0, 0.0, 1.0] } else { r.unit(false) };
        let second = if kind == Kind::Universal { perpendicular(&axis) } else { axis };
        if kind == Kind::Distance && norm(&sub(&point, &other)) < 0.1 {
            return;
        }
        let joint = Joint {
            kind,
            between,
            points: [other, point],
            axes: [axis, second],
            coordinates: None,
            reversed: false,
        };
        self.joints.push(joint);
        // At least one degree of freedom is left, and the loop is not nearly singular.
        let (rank, ratio) = self.hard_rank();
        if rank >= self.coordinates() || ratio < 3e-2 {
            self.joints.pop();
        }
    }

    fn add_driver(&mut self, r: &mut Random) {
        let joint = r.below(self.joints.len());
        let Joint { kind, between, coordinates, .. } = self.joints[joint];
        let rotation = match kind {
            Kind::Revolute => true,
            Kind::Translational => false,
            Kind::Cylindrical => r.chance(0.5),
            _ => return,
        };
        let Some((first, _)) = coordinates else { return };
        // A cylindrical joint turns by its first coordinate and slides by its second.
        let coordinate = first + usize::from(kind == Kind::Cylindrical && !rotation);
        let offset = if self.planar && rotation { self.angle_between(between) } else { 0.0 };
        let mild = self.has_loops();
        let most = match (rotation, mild) {
            (true, true) => 0.2,
            (true, false) => 3.0,
            (false, true) => 0.02,
            (false, false) => 0.15,
        };
        let motion = motion(r, most, offset, mild);
        let explicit = r.chance(0.3);
        self.drivers.push(Driver { joint, coordinate, rotation, explicit, motion });
        // It is neither implied nor nearly contradicted by loops.
        let (rank, ratio) = self.hard_rank();
        let driver = self.drivers.pop();
        let most = if mild { 0.1 } else { 3e-2 };
        if rank == self.hard_rank().0 + 1 && ratio > most {
            self.drivers.extend(driver);
        }
    }

    /// Ties what floats to the bodies before it, by force elements alone.
    fn tie(&mut self, r: &mut Random) {
        let roots: Vec<Option<usize>> = (0..self.bodies.len()).map(|b| self.root(b)).collect();
        for root in (1..roots.len()).filter(|&b| roots[b] == Some(b)) {
            let joined: Vec<usize> =
                (root..roots.len()).filter(|&b| roots[b] == Some(root)).collect();
            for _ in 0..10 {
                let between = [Some(r.below(root)), Some(r.one_of(&joined))];
                let law = match r.below(if self.planar { 4 } else { 7 }) {
                    0..=2 => Law::Tsda,
                    3 => Law::Maxwell,
                    _ => Law::Bushing(r.chance(0.5)),
                };
                let stiffness =
                    if r.chance(0.5) { r.logarithmic(1.0, 1e3) } else { r.logarithmic(1e3, 1e7) };
                let before = self.elements.len();
                self.add_element_of(r, law, between, stiffness);
                if self.elements.len() > before && self.can_move() {
                    break;
                }
                self.elements.truncate(before);
            }
        }
    }

    /// Lets about every second joint and element name its second body first.
    fn change_order(&mut self, r: &mut Random) {
        let driven: Vec<usize> = self.drivers.iter().map(|d| d.joint).collect();
        for (at, joint) in self.joints.iter_mut().enumerate() {
            joint.reversed = r.chance(0.5) && !driven.contains(&at);
        }
        for element in &mut self.elements {
            if r.chance(0.5) {
                element.between.reverse();
                element.points.reverse();
            }
        }
    }

    fn add_element(&mut self, r: &mut Random, stiffness: f64) {
        let between = self.pair(r);
        let law = match r.below(if self.planar { 7 } else { 9 }) {
            0..=3 => Law::Tsda,
            4 => Law::Maxwell,
            5 | 6 => Law::Rsda,
            _ => Law::Bushing(r.chance(0.5)),
        };
        self.add_element_of(r, law, between, stiffness);
    }

    fn add_element_of(&mut self, r: &mut Random, law: Law, between: Between, stiffness: f64) {
        let planar = self.planar;
        let mut between = between;
        let mut damping = if r.chance(0.3) { 0.0 } else { r.logarithmic(1e-6, 0.1) };
        let mut law = law;
        let near = self.at(between[1]);
        let mut points = [near; 2];
        let mut axes = if planar || r.chance(0.5) { IDENTITY } else { r.rotation(false) };
        match law {
            Law::Tsda | Law::Maxwell => {
                let from = if between[0].is_none() { near } else { self.at(between[0]) };
                points = [
                    add(&from, &r.vector(planar, 0.1, 0.6)),
                    add(&near, &r.vector(planar, 0.0, 0.3)),
                ];
                if norm(&sub(&points[0], &points[1])) < 0.1 {
                    return;
                }
                if law == Law::Maxwell {
                    damping = r.logarithmic(1e-4, 0.1);
                }
            }
            Law::Rsda if !planar => {
                // In space the angle of a joint's own axis.
                let joints = self.joints.iter();
                let turning: Vec<&Joint> = joints
                    .filter(|j| matches!(j.kind, Kind::Revolute | Kind::Cylindrical))
                    .collect();
                if turning.is_empty() {
                    return;
                }
                let joint = turning[r.below(turning.len())];
                between = joint.between;
                let h = joint.axes[0];
                let f = perpendicular(&h);
                let g = numbers::cross(&h, &f);
                axes = numbers::transpose(&[f, g, h]);
            }
            Law::Rsda => {}
            Law::Bushing(turning) => {
                points = [add(&near, &r.vector(false, 0.0, 0.3)); 2];
                // The bushing's angles are meant for less than half a turn.
                law = Law::Bushing(turning && stiffness > 1e4);
            }
        }
        let lever = r.logarithmic(0.03, 0.3).powi(2);
        let settled = stiffness > STIFF && (damping < 1e-4 || r.chance(0.6));
        let settled = settled || law == Law::Bushing(true);
        let scaled = if law == Law::Rsda { stiffness * lever } else { stiffness };
        let rows = if matches!(law, Law::Bushing(_)) { 3 } else { 1 };
        self.elements.push(Element {
            law,
            between,
            points,
            axes,
            stiffness: scaled,
            lever,
            damping,
            rotational_damping: damping.max(1e-4),
            settled,
            branch: None,
            gap: None,
            preload: (0..rows)
                .map(|_| {
                    r.range(-1.0, 1.0) * (0.05 * scaled).min(if rows == 1 { 5.0 } else { 3.0 })
                })
                .collect(),
        });
    }

    /// Makes some bushings viscoelastic, by numbers of their own.
    fn add_branches(&mut self) {
        let r = &mut Random::new(self.seed.rotate_left(32) ^ 0x5eed);
        for element in &mut self.elements {
            if matches!(element.law, Law::Bushing(_)) && r.chance(0.4) {
                element.branch = Some([r.logarithmic(0.1, 3.0), r.logarithmic(1e-3, 10.0)]);
            }
        }
    }

    /// What rings for long starts at rest: next to it all stiff elements do.
    fn settle(&mut self) {
        let rings =
            |e: &Element| e.stiffness > STIFF && (e.damping < 1e-3 || e.law == Law::Maxwell);
        if self.elements.iter().any(rings) {
            self.elements.iter_mut().filter(|e| e.stiffness > STIFF).for_each(|e| e.settled = true);
        }
    }

    fn add_tyre(&mut self, r: &mut Random) {
        let on = r.below(self.bodies.len());
        let point = self.bodies[on].center;
        let radius = r.range(0.1, 0.4);
        self.road = Some(point[2] - radius * r.range(0.98, 1.1));
        let stiffness = r.logarithmic(1e3, 1e5);
        let damping = r.logarithmic(1e-4, 1e-2) * stiffness;
        let lateral = r.chance(0.4).then(|| unit(&[r.range(-0.2, 0.2), 1.0, 0.0]));
        self.loads.push(Load::Tyre { on, point, radius, stiffness, damping, lateral });
    }

    fn add_load(&mut self, r: &mut Random) {
        let on = r.below(self.bodies.len());
        let axes = r.one_of(&["ground", "body"]);
        // What sets in at once would make an undamped stiff element ring.
        let calm = self.elements.iter().any(|e| e.stiffness > STIFF);
        let function = |r: &mut Random, most: f64| {
            if !calm && r.chance(0.3) {
                Motion::Constant(r.range(-most, most))
            } else {
                motion(r, most, 0.0, false)
            }
        };
        if r.chance(0.5) {
            let point = add(&self.bodies[on].center, &r.vector(self.planar, 0.0, 0.3));
            let count = if self.planar { 2 } else { 3 };
            let motions = (0..count).map(|_| function(r, 8.0)).collect();
            self.loads.push(Load::Force { on, point, axes, motions });
        } else {
            let between = if r.chance(0.5) { self.pair(r) } else { [None, Some(on)] };
            let axis = if self.planar { [0.0, 0.0, 1.0] } else { r.unit(false) };
            let motion = function(r, 0.5);
            self.loads.push(Load::Torque { between, axis, axes, motion });
        }
    }
}
