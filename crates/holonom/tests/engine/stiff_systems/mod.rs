//! Bodies on rotational springs, bushings and springs of any stiffness, each as a model and as its equations in minimal
//! coordinates, which are integrated here.

use crate::common::integrate::space::turn;
use crate::common::integrate::{
    Accelerations, GRAVITY, Lagrange, Planar, Scalar, lagrange, motions, planar, radau, rate,
    slow_start, spun,
};
use crate::common::table::{Case, Kind, Truth, times, truth};
use std::f64::consts::FRAC_PI_2;

const END: f64 = 1.0;
const ROWS: usize = 20;

/// A body at rest, swinging, or turning several times: angle from the horizontal and its rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Motion {
    Rest,
    Swinging,
    Turning,
}
use Motion::{Rest, Swinging, Turning};

impl Motion {
    fn start(self) -> [f64; 2] {
        match self {
            Rest => [-FRAC_PI_2, 0.0],
            Swinging => [0.3, 4.0],
            Turning => [0.3, 20.0],
        }
    }
}

/// One stiffness, its damping in seconds times it, and whether the run starts on the slow manifold.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stiffness {
    pub(crate) k: f64,
    pub(crate) seconds: f64,
    pub(crate) on: bool,
}

impl Stiffness {
    fn c(&self) -> f64 {
        self.seconds * self.k
    }

    fn heavy(&self) -> bool {
        self.seconds > 1e-2
    }

    /// The start, and the truth at the rows: Radau IIA in minimal coordinates. Off the slow manifold the
    /// deformations change at 0.1 m/s, rad/s.
    fn integrate(&self, a: &Accelerations, stiff: &[usize], soft: &[f64]) -> Vec<Vec<f64>> {
        let mut y = slow_start(a, stiff, self.heavy(), soft);
        if !self.on {
            for &i in stiff {
                y[soft.len() / 2 + i] += 0.1;
            }
        }
        // Effective masses of the models here are above 0.1 kg, kg m².
        let frequency = (10.0 * self.k).sqrt();
        let light = 10.0 * self.c() < 0.6 * frequency;
        // With steps of 2.5 ms what turns at 20 rad/s is off by 4e-6, a 32nd of it with half of them.
        let smooth = if cfg!(feature = "long") { 1.25e-3 } else { 2.5e-3 };
        let longest = if light && frequency < 3000.0 { 0.2 / frequency } else { smooth };
        let first = 1e-3 / frequency.max(10.0 * self.c());
        radau(&rate(a), &y, &times(END, ROWS), first.min(longest), longest)
    }
}

/// The line of a body's initial state, moving in the plane z = 0.
fn stated(name: &str, [place, speed]: &[[f64; 3]; 2]) -> String {
    let [x, y, angle] = place;
    let [u, v, w] = speed;
    let p = turn([0.0, 0.0, *angle]);
    format!(
        "{name} = {{ position = [{x:e}, {y:e}, 0.0], euler_parameters = {p:?}, \
         velocity = [{u:e}, {v:e}, 0.0], angular_velocity = [0.0, 0.0, {w:e}] }}\n"
    )
}

/// The truths of bodies that move in the plane z = 0, by name and number.
fn truths<P: Planar>(
    p: &P,
    rows: &[Vec<f64>],
    bodies: &[([&'static str; 4], usize)],
) -> Vec<Truth> {
    let all: Vec<_> = rows.iter().map(|y| motions(p, y)).collect();
    bodies
        .iter()
        .flat_map(|&([position, orientation, velocity, turning], b)| {
            let place = all.iter().map(move |m| vec![m[b][0][0], m[b][0][1], 0.0]);
            let pose = all.iter().map(move |m| turn([0.0, 0.0, m[b][0][2]]).to_vec());
            let speed = all.iter().map(move |m| vec![m[b][1][0], m[b][1][1], 0.0]);
            let spin = all.iter().map(move |m| vec![0.0, 0.0, m[b][1][2]]);
            [
                truth(position, Kind::Point, place),
                truth(orientation, Kind::Orientation, pose),
                truth(velocity, Kind::Velocity, speed),
                truth(turning, Kind::Velocity, spin),
            ]
        })
        .collect()
}

const BODY: [&str; 4] =
    ["body.position", "body.euler_parameters", "body.velocity", "body.angular_velocity"];

fn head(bodies: &str) -> String {
    format!(
        "holonom = 1\ndimension = \"spatial\"\ngravity = [0.0, -{GRAVITY:?}, 0.0]\n[bodies]\n{bodies}\n"
    )
}

fn inertia(about_z: f64) -> String {
    let across = 0.8 * about_z;
    format!("[[{across:e}, 0.0, 0.0], [0.0, {across:e}, 0.0], [0.0, 0.0, {about_z:e}]]")
}

/// The shape of all cases: a stiffness, a motion.
pub(crate) type Build = fn(&Stiffness, Motion) -> Case;

/// Two arms about parallel axes with a rotational spring at the elbow: angle of the first, angle between them.
struct Elbow(Stiffness);

/// Half length of an arm of 1 kg and its moment of inertia.
const HALF: f64 = 0.3;
const ARM: f64 = 0.03;

impl Planar for Elbow {
    fn size(&self) -> usize {
        2
    }
    fn masses(&self) -> Vec<[f64; 2]> {
        vec![[1.0, ARM]; 2]
    }
    fn poses<T: Scalar>(&self, q: &[T]) -> Vec<[T; 3]> {
        let zero = T::from(0.0);
        let one = spun(q[0], [T::from(HALF), zero]);
        let both = q[0] + q[1];
        let two = spun(both, [T::from(HALF), zero]);
        let end = [one[0] * 2.0 + two[0], one[1] * 2.0 + two[1]];
        vec![[one[0], one[1], q[0]], [end[0], end[1], both]]
    }
    fn potential<T: Scalar>(&self, q: &[T]) -> T {
        q[1] * q[1] * (0.5 * self.0.k)
    }
    fn dissipation<T: Scalar>(&self, _: &[T], v: &[T]) -> T {
        v[1] * v[1] * (0.5 * self.0.c())
    }
}

pub(crate) fn elbow(stiffness: &Stiffness, motion: Motion) -> Case {
    let p = Elbow(*stiffness);
    let [angle, w] = motion.start();
    let rows = stiffness.integrate(&|q, v| planar(&p, q, v), &[1], &[angle, 0.0, w, 0.0]);
    let at = motions(&p, &rows[0]);
    let (j, k, c) = (inertia(ARM), stiffness.k, stiffness.c());
    let text = head(&format!(
        "arm = {{ mass = 1.0, inertia = {j}, position = [{HALF}, 0.0, 0.0] }}\n\
         body = {{ mass = 1.0, inertia = {j}, position = [{}, 0.0, 0.0] }}",
        3.0 * HALF
    )) + &format!(
        r#"
[joints]
shoulder = {{ type = "revolute", between = ["ground", "arm"], point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }}
elbow = {{ type = "revolute", between = ["arm", "body"], point = [{}, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }}
[forces]
spring = {{ type = "rsda", between = ["arm", "body"], axis = [0.0, 0.0, 1.0], stiffness = {k:e}, damping = {c:e} }}
[initial.bodies]
{}{}"#,
        2.0 * HALF,
        stated("arm", &at[0]),
        stated("body", &at[1]),
    );
    let names = ["arm.position", "arm.euler_parameters", "arm.velocity", "arm.angular_velocity"];
    Case::new(&text, END, truths(&p, &rows, &[(names, 0), (BODY, 1)]))
}

/// A body on a bushing: at rest and swinging on the ground, turning at the end of a crank. Coordinates: angle of the
/// crank, deformation in the crank's axes, angle of the bushing.
struct Bushed {
    stiffness: Stiffness,
    /// Rotational stiffness over the translational one, m².
    rotational: f64,
    crank: bool,
}

/// Length of the crank and its moment of inertia; centre of mass of the body from the bushing; moment of inertia.
const CRANK: [f64; 2] = [0.5, 0.64];
const BESIDE: [f64; 2] = [0.3, 0.12];

impl Planar for Bushed {
    fn size(&self) -> usize {
        3 + usize::from(self.crank)
    }
    fn masses(&self) -> Vec<[f64; 2]> {
        let crank = [2.0, CRANK[1]];
        let body = [1.0, BESIDE[1]];
        if self.crank { vec![crank, body] } else { vec![body] }
    }
    fn poses<T: Scalar>(&self, q: &[T]) -> Vec<[T; 3]> {
        let zero = T::from(0.0);
        let side = |angle| spun(angle, [T::from(BESIDE[0]), zero]);
        if !self.crank {
            let r = side(q[2]);
            return vec![[q[0] + r[0], q[1] + r[1], q[2]]];
        }
        let end = spun(q[0], [q[1] + CRANK[0], q[2]]);
        let r = side(q[0] + q[3]);
        vec![[zero, zero, q[0]], [end[0] + r[0], end[1] + r[1], q[0] + q[3]]]
    }
    fn potential<T: Scalar>(&self, q: &[T]) -> T {
        let [x, y, e] = [q[q.len() - 3], q[q.len() - 2], (q[q.len() - 1] * 0.5).sin() * 2.0];
        (x * x + y * y + e * e * self.rotational) * (0.5 * self.stiffness.k)
    }
    fn dissipation<T: Scalar>(&self, q: &[T], v: &[T]) -> T {
        let n = q.len();
        let [x, y, e] = [v[n - 3], v[n - 2], (q[n - 1] * 0.5).cos() * v[n - 1]];
        (x * x + y * y + e * e * self.rotational) * (0.5 * self.stiffness.c())
    }
}

pub(crate) fn three(x: f64) -> String {
    format!("[{x:e}, {x:e}, {x:e}]")
}

pub(crate) fn bushed(stiffness: &Stiffness, motion: Motion) -> Case {
    let crank = motion == Turning;
    let rotational = if motion == Swinging { 0.0 } else { 0.01 };
    let p = Bushed { stiffness: *stiffness, rotational, crank };
    let [angle, w] = motion.start();
    let (stiff, soft): (&[usize], Vec<f64>) = match motion {
        Rest => (&[0, 1, 2], vec![0.0; 6]),
        Swinging => (&[0, 1], vec![0.0, 0.0, angle, 0.0, 0.0, w]),
        Turning => (&[1, 2, 3], vec![angle, 0.0, 0.0, 0.0, w, 0.0, 0.0, 0.0]),
    };
    let rows = stiffness.integrate(&|q, v| planar(&p, q, v), stiff, &soft);
    let at = motions(&p, &rows[0]);
    let (k, c) = (stiffness.k, stiffness.c());
    let place = if crank { CRANK[0] } else { 0.0 };
    let mut bodies = format!(
        "body = {{ mass = 1.0, inertia = {}, position = [{}, 0.0, 0.0] }}",
        inertia(BESIDE[1]),
        place + BESIDE[0],
    );
    let mut joints = String::new();
    let mut initial = String::from("[initial.bodies]\n");
    if crank {
        let inertia = inertia(CRANK[1]);
        bodies = format!(
            "{bodies}\ncrank = {{ mass = 2.0, inertia = {inertia}, position = [0.0, 0.0, 0.0] }}"
        );
        joints += "[joints]\nbearing = { type = \"revolute\", between = [\"ground\", \"crank\"], \
                   point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }\n";
        initial += &stated("crank", &at[0]);
    }
    initial += &stated("body", &at[usize::from(crank)]);
    let text = head(&bodies)
        + &joints
        + &format!(
            "[forces]\nbushing = {{ type = \"bushing\", between = [\"{}\", \"body\"], \
             point = [{place}, 0.0, 0.0], stiffness = {}, damping = {}, rotational_stiffness = {}, \
             rotational_damping = {} }}\n",
            if crank { "crank" } else { "ground" },
            three(k),
            three(c),
            three(rotational * k),
            three(rotational * c),
        )
        + &initial;
    Case::new(&text, END, truths(&p, &rows, &[(BODY, usize::from(crank))]))
}

/// A body hung from the ground by two bushings on the z axis, its centre of mass beside it and out of the middle:
/// translation of the first bushing; turns about z, y′, x″.
struct Hinge(Stiffness);

/// Second bushing from the first, and the centre of mass, along z; centre of mass along x; principal moments.
const APART: f64 = 0.4;
const CENTER: [f64; 3] = [0.3, 0.0, 0.1];
const MOMENTS: [f64; 3] = [0.02, 0.05, 0.06];

impl Hinge {
    /// A vector of body axes in ground axes.
    fn ground<T: Scalar>(q: &[T], [x, y, z]: [T; 3]) -> [T; 3] {
        let [y, z] = spun(q[5], [y, z]);
        let [z, x] = spun(q[4], [z, x]);
        let [x, y] = spun(q[3], [x, y]);
        [x, y, z]
    }

    /// Angular velocity in body axes.
    fn spin<T: Scalar>(q: &[T], v: &[T]) -> [T; 3] {
        let ((s, c), (sx, cx)) = (q[4].sin_cos(), q[5].sin_cos());
        [v[5] - v[3] * s, v[4] * cx + v[3] * c * sx, v[3] * c * cx - v[4] * sx]
    }

    /// Velocity of a point fixed in the body.
    fn speed<T: Scalar>(q: &[T], v: &[T], x: [f64; 3]) -> [T; 3] {
        let [a, b, c] = Self::spin(q, v);
        let across = [b * x[2] - c * x[1], c * x[0] - a * x[2], a * x[1] - b * x[0]];
        let turning = Self::ground(q, across);
        [v[0] + turning[0], v[1] + turning[1], v[2] + turning[2]]
    }

    /// Deformation of the second bushing, without cancellation.
    fn second<T: Scalar>(q: &[T]) -> [T; 3] {
        let (s, cx) = (q[4].sin(), q[5].cos());
        let [x, y] = spun(q[3], [s * cx * APART, -q[5].sin() * APART]);
        let half = |angle: T| (angle * 0.5).sin().powi(2) * 2.0;
        let z = (half(q[4]) * half(q[5]) - half(q[4]) - half(q[5])) * APART;
        [q[0] + x, q[1] + y, q[2] + z]
    }
}

fn squares<T: Scalar>(x: &[T]) -> T {
    x.iter().map(|&x| x * x).sum()
}

impl Lagrange for Hinge {
    fn size(&self) -> usize {
        6
    }
    fn lagrangian<T: Scalar>(&self, q: &[T], v: &[T]) -> T {
        let spin = Self::spin(q, v);
        let turning: T = (0..3).map(|i| spin[i] * spin[i] * MOMENTS[i]).sum();
        let kinetic = (squares(&Self::speed(q, v, CENTER)) + turning) * 0.5;
        let high = q[1] + Self::ground(q, CENTER.map(T::from))[1];
        let elastic = (squares(&q[..3]) + squares(&Self::second(q))) * (0.5 * self.0.k);
        kinetic - elastic - high * GRAVITY
    }
    fn dissipation<T: Scalar>(&self, q: &[T], v: &[T]) -> T {
        let second = Self::speed(q, v, [0.0, 0.0, APART]);
        (squares(&v[..3]) + squares(&second)) * (0.5 * self.0.c())
    }
}

pub(crate) fn hinge(stiffness: &Stiffness, motion: Motion) -> Case {
    let l = Hinge(*stiffness);
    let [angle, w] = motion.start();
    let soft = [0.0, 0.0, 0.0, angle, 0.0, 0.0, 0.0, 0.0, 0.0, w, 0.0, 0.0];
    let rows = stiffness.integrate(&|q, v| lagrange(&l, q, v), &[0, 1, 2, 4, 5], &soft);
    let place = |y: &[f64]| -> Vec<f64> {
        Hinge::ground(&y[..6], CENTER).iter().zip(y).map(|(a, b)| a + b).collect()
    };
    let pose = |y: &[f64]| {
        let product = crate::common::integrate::space::product;
        let turns = product(turn([0.0, 0.0, y[3]]), turn([0.0, y[4], 0.0]));
        product(turns, turn([y[5], 0.0, 0.0]))
    };
    let speed = |y: &[f64]| Hinge::speed(&y[..6], &y[6..], CENTER);
    let spin = |y: &[f64]| Hinge::ground(&y[..6], Hinge::spin(&y[..6], &y[6..]));
    let (y, k, c) = (&rows[0], three(stiffness.k), three(stiffness.c()));
    let [a, b, d] = MOMENTS;
    let text = head(&format!(
        "body = {{ mass = 1.0, inertia = [[{a}, 0.0, 0.0], [0.0, {b}, 0.0], [0.0, 0.0, {d}]], \
         position = {CENTER:?} }}"
    )) + &format!(
        r#"
[forces]
one = {{ type = "bushing", between = ["ground", "body"], point = [0.0, 0.0, 0.0], stiffness = {k}, damping = {c} }}
two = {{ type = "bushing", between = ["ground", "body"], point = [0.0, 0.0, {APART}], stiffness = {k}, damping = {c} }}
[initial.bodies]
body = {{ position = {:?}, euler_parameters = {:?}, velocity = {:?}, angular_velocity = {:?} }}
"#,
        place(y),
        pose(y),
        speed(y),
        spin(y),
    );
    Case::new(
        &text,
        END,
        vec![
            truth(BODY[0], Kind::Point, rows.iter().map(|y| place(y))),
            truth(BODY[1], Kind::Orientation, rows.iter().map(|y| pose(y).to_vec())),
            truth(BODY[2], Kind::Velocity, rows.iter().map(|y| speed(y).to_vec())),
            truth(BODY[3], Kind::Velocity, rows.iter().map(|y| spin(y).to_vec())),
        ],
    )
}

/// A body on a spring alone, 1 m from the pivot: elongation and angle; its own angle beside them.
struct Spring(Stiffness);

impl Planar for Spring {
    fn size(&self) -> usize {
        3
    }
    fn masses(&self) -> Vec<[f64; 2]> {
        vec![[1.0, 0.02]]
    }
    fn poses<T: Scalar>(&self, q: &[T]) -> Vec<[T; 3]> {
        let [x, y] = spun(q[1], [q[0] + 1.0, T::from(0.0)]);
        vec![[x, y, q[2]]]
    }
    fn potential<T: Scalar>(&self, q: &[T]) -> T {
        q[0] * q[0] * (0.5 * self.0.k)
    }
    fn dissipation<T: Scalar>(&self, _: &[T], v: &[T]) -> T {
        v[0] * v[0] * (0.5 * self.0.c())
    }
}

fn spring(stiffness: &Stiffness, motion: Motion, spatial: bool) -> Case {
    let p = Spring(*stiffness);
    let [angle, w] = motion.start();
    let own = if motion == Rest { 0.0 } else { 1.0 };
    let soft = [0.0, angle, 0.0, 0.0, w, own];
    let rows = stiffness.integrate(&|q, v| planar(&p, q, v), &[0], &soft);
    let at = &motions(&p, &rows[0])[0];
    let (k, c) = (stiffness.k, stiffness.c());
    let force = |zero: &str| {
        format!(
            "[forces]\nspring = {{ type = \"tsda\", between = [\"ground\", \"body\"], \
             points_in_body = [{zero}, {zero}], stiffness = {k:e}, damping = {c:e}, \
             free_length = 1.0 }}\n[initial.bodies]\n"
        )
    };
    if spatial {
        let body = format!(
            "body = {{ mass = 1.0, inertia = {}, position = [1.0, 0.0, 0.0] }}",
            inertia(0.02)
        );
        let text = head(&body) + &force("[0.0, 0.0, 0.0]") + &stated("body", at);
        return Case::new(&text, END, truths(&p, &rows, &[(BODY, 0)]));
    }
    let [[x, y, angle], [u, v, w]] = at;
    let text = format!(
        "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, -{GRAVITY:?}]\n[bodies]\n\
         body = {{ mass = 1.0, inertia = 0.02, position = [1.0, 0.0] }}\n{}\
         body = {{ position = [{x:e}, {y:e}], angle = {angle:e}, velocity = [{u:e}, {v:e}], \
         angular_velocity = {w:e} }}\n",
        force("[0.0, 0.0]"),
    );
    let all: Vec<_> = rows.iter().map(|y| motions(&p, y)[0]).collect();
    let part = |k: usize| all.iter().map(move |m| m[k][..2].to_vec());
    Case::new(
        &text,
        END,
        vec![truth(BODY[0], Kind::Point, part(0)), truth(BODY[2], Kind::Velocity, part(1))],
    )
}

pub(crate) fn planar_spring(stiffness: &Stiffness, motion: Motion) -> Case {
    spring(stiffness, motion, false)
}

pub(crate) fn spatial_spring(stiffness: &Stiffness, motion: Motion) -> Case {
    spring(stiffness, motion, true)
}

/// A planar four-bar in space whose coupler hangs in bushings at both ends: angle of the crank, deformation of the
/// first bushing in the crank's axes, of the second in the rocker's.
struct FourBar(Stiffness);

/// Lengths of crank, coupler and rocker; the pivots are 1 m apart. Moments of inertia of bodies of 1 kg, 2 kg, 1 kg.
const LINKS: [f64; 3] = [0.3, 0.9, 0.6];
const LINK_INERTIA: [f64; 3] = [0.01, 0.14, 0.03];

impl Planar for FourBar {
    fn size(&self) -> usize {
        5
    }
    fn masses(&self) -> Vec<[f64; 2]> {
        let [a, b, c] = LINK_INERTIA;
        vec![[1.0, a], [2.0, b], [1.0, c]]
    }
    fn poses<T: Scalar>(&self, q: &[T]) -> Vec<[T; 3]> {
        let [arm, rod, rock] = LINKS;
        let zero = T::from(0.0);
        let a = spun(q[0], [q[1] + arm, q[2]]);
        let b = [q[3] + rock, q[4]];
        let w = [-a[0] + 1.0, -a[1]];
        let (far, near) = (squares(&b), squares(&w));
        let bend = (-far - near + rod * rod) / ((far * near).sqrt() * 2.0);
        let angle = (w[1] / w[0]).atan() + bend.acos() - (b[1] / b[0]).atan();
        let end = spun(angle, b);
        let along = [w[0] + end[0], w[1] + end[1]];
        let coupler = (along[1] / along[0]).atan();
        let crank = spun(q[0], [T::from(0.5 * arm), zero]);
        let middle = spun(coupler, [T::from(0.5 * rod), zero]);
        let rocker = spun(angle, [T::from(0.5 * rock), zero]);
        vec![
            [crank[0], crank[1], q[0]],
            [a[0] + middle[0], a[1] + middle[1], coupler],
            [rocker[0] + 1.0, rocker[1], angle],
        ]
    }
    fn potential<T: Scalar>(&self, q: &[T]) -> T {
        squares(&q[1..]) * (0.5 * self.0.k)
    }
    fn dissipation<T: Scalar>(&self, _: &[T], v: &[T]) -> T {
        squares(&v[1..]) * (0.5 * self.0.c())
    }
}

pub(crate) fn four_bar(stiffness: &Stiffness, motion: Motion) -> Case {
    let p = FourBar(*stiffness);
    let rate = match motion {
        Rest => 0.0,
        Swinging => 6.0,
        Turning => 20.0,
    };
    let mut soft = vec![0.0; 10];
    (soft[0], soft[5]) = (1.0, rate);
    let rows = stiffness.integrate(&|q, v| planar(&p, q, v), &[1, 2, 3, 4], &soft);
    let at = motions(&p, &rows[0]);
    let [arm, rod, rock] = LINKS;
    let (k, c) = (stiffness.k, stiffness.c());
    // Out of the plane the coupler is held against tilting; in it the bushings turn freely.
    let tilt = |x: f64| format!("[{:e}, {:e}, 0.0]", 0.01 * x, 0.01 * x);
    let bushing = |first: &str, points: [f64; 2]| {
        format!(
            "{{ type = \"bushing\", between = [\"{first}\", \"body\"], points_in_body = \
             [[{}, 0.0, 0.0], [{}, 0.0, 0.0]], stiffness = {}, damping = {}, \
             rotational_stiffness = {}, rotational_damping = {} }}",
            points[0],
            points[1],
            three(k),
            three(c),
            tilt(k),
            tilt(c),
        )
    };
    let [a, b, d] = LINK_INERTIA.map(inertia);
    let text = head(&format!(
        "crank = {{ mass = 1.0, inertia = {a}, position = [{}, 0.0, 0.0] }}\n\
         body = {{ mass = 2.0, inertia = {b}, position = [0.7, 0.0, 0.0] }}\n\
         rocker = {{ mass = 1.0, inertia = {d}, position = [{}, 0.0, 0.0] }}",
        0.5 * arm,
        1.0 + 0.5 * rock,
    )) + &format!(
        r#"
[joints]
left = {{ type = "revolute", between = ["ground", "crank"], point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }}
right = {{ type = "revolute", between = ["ground", "rocker"], point = [1.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }}
[forces]
front = {}
rear = {}
[initial.bodies]
{}{}{}"#,
        bushing("crank", [0.5 * arm, -0.5 * rod]),
        bushing("rocker", [0.5 * rock, 0.5 * rod]),
        stated("crank", &at[0]),
        stated("body", &at[1]),
        stated("rocker", &at[2]),
    );
    let crank =
        ["crank.position", "crank.euler_parameters", "crank.velocity", "crank.angular_velocity"];
    Case::new(&text, END, truths(&p, &rows, &[(BODY, 1), (crank, 0)]))
}
