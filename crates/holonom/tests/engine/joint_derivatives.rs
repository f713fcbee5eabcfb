//! Derivatives of the reduced equations along the tree. Independent truths: the Cartesian blocks, which know no tree, and
//! differences of the equations, each of which solves for the dependent coordinates anew.

use crate::common::{DRIVEN_PENDULUM, DRIVEN_TELESCOPE, LIBRARY, model, model_of};
use crate::joint_coordinates::four_bars;
use crate::random::{Mechanism, numbers::Random};
use holonom::method::ode::{LinearizedOde, Ode};
use holonom::method::{FirstOrder, Weights};
use holonom::model::{Model, Tolerance};
use holonom::newton::ReducedBlocks;
use holonom::simulation::Problem;

/// The reduced equations in Cartesian and in joint coordinates.
struct Forms {
    cartesian: FirstOrder,
    joint: FirstOrder,
    t: f64,
    w: Vec<f64>,
    ndof: usize,
    loops: usize,
}

impl Forms {
    /// At a start; none where the tree has lines, or nothing moves, or what moves is nearly undetermined.
    fn new(model: Model) -> Option<Self> {
        let problem = Problem::new(model);
        let assembled = problem.assemble().ok()?;
        let (mut manifold, state) = (assembled.manifold(), assembled.state.clone());
        let ndof = manifold.chart().ndof();
        let mut along = manifold.clone();
        let has_form = along.use_joint_coordinates(&state.q, usize::MAX);
        if !has_form || ndof == 0 || manifold.condition().max(along.condition()) > 1e5 {
            return None;
        }
        let loops = along.system().tree().closures.len();
        let form = |manifold| {
            let weights = Weights::new(Tolerance::uniform(1e-6), problem.system().as_ref(), &state);
            let mut form = FirstOrder::new(manifold, weights, &state);
            form.begin_step(&state);
            form
        };
        let (cartesian, joint) = (form(manifold), form(along));
        let mut w = vec![0.0; joint.dimension()];
        cartesian.pack(&state, &mut w);
        Some(Self { cartesian, joint, t: state.t, w, ndof, loops })
    }

    /// A state near the start, where both linearize; `false` where they cannot, or Cartesian solvers had to help.
    fn go(&mut self, from: &[f64], random: &mut Random) -> bool {
        let left = |form: &FirstOrder| form.point().manifold.counters.left_to_cartesian;
        self.w.copy_from_slice(from);
        for (k, w) in self.w.iter_mut().enumerate() {
            *w += match k {
                k if k < self.ndof => random.range(-0.02, 0.02),
                k if k < 2 * self.ndof => random.range(-1.0, 1.0),
                _ => random.range(-0.01, 0.01),
            };
        }
        let (t, before) = (self.t, left(&self.joint));
        [&mut self.cartesian, &mut self.joint].into_iter().all(|f| f.linearize(t, &self.w).is_ok())
            && left(&self.joint) == before
    }

    fn blocks(&self) -> [&ReducedBlocks; 2] {
        [self.cartesian.newton().blocks(), self.joint.newton().blocks()]
    }
}

/// Largest difference of two arrays against the largest entry, or what their terms may have been.
fn apart(a: &[f64], b: &[f64], least: f64) -> f64 {
    let size = a.iter().chain(b).fold(least, |m, x| m.max(x.abs()));
    let apart = a.iter().zip(b).fold(0.0f64, |m, (x, y)| m.max((x - y).abs()));
    if apart > 0.0 { apart / size } else { 0.0 }
}

/// Worst differences of M̂, M̂₁, M̂₂, of what extra states add, of M̂ v̈_t and ż_t, and of changes on all coordinates.
fn compare(forms: &mut Forms, random: &mut Random) -> [f64; 9] {
    let mut out = [0.0; 9];
    let [a, b] = forms.blocks();
    // Where what is stiff or fast hardly moves, round-off of its parts is left.
    let parts = |parts: &[f64]| 1e-4 * largest(parts);
    let (mass, of_a) = (largest(&a.mass), &a.blocks);
    out[0] = apart(&a.mass, &b.mass, 0.0);
    out[1] = apart(&a.damping, &b.damping, mass.max(parts(of_a.damping.values())));
    out[2] = apart(&a.stiffness, &b.stiffness, mass.max(parts(of_a.stiffness.values())));
    out[3] = apart(&a.force_extra, &b.force_extra, parts(&of_a.force_extra));
    out[4] = apart(&a.extra_position, &b.extra_position, parts(&of_a.extra_position));
    out[5] = apart(&a.extra_velocity, &b.extra_velocity, parts(&of_a.extra_velocity));
    out[6] = apart(&a.extra_extra.values, &b.extra_extra.values, 0.0);
    let (n, ndof) = (forms.w.len(), forms.ndof);
    let terms = 1.0f64.max(parts(of_a.damping.values())).max(parts(of_a.stiffness.values()));
    let times = |x: &[f64]| -> Vec<f64> {
        let rows = a.mass.chunks_exact(ndof);
        rows.map(|row| row.iter().zip(x).map(|(m, x)| m * x).sum()).collect()
    };
    let mut slopes = [vec![0.0; n], vec![0.0; n]];
    let [first, second] = &mut slopes;
    let mut forms_of = [forms.cartesian.clone(), forms.joint.clone()];
    let [cartesian, joint] = &mut forms_of;
    if cartesian.time_derivative(first).is_ok() && joint.time_derivative(second).is_ok() {
        // Weighed: a light body's acceleration has the digits of its force.
        let [a, b] =
            slopes.map(|slope| [times(&slope[ndof..2 * ndof]), slope[2 * ndof..].to_vec()]);
        out[7] = apart(&a[0], &b[0], terms).max(apart(&a[1], &b[1], 1.0));
    }
    let change: Vec<f64> = (0..n).map(|_| random.range(-1.0, 1.0)).collect();
    let found = forms_of.map(|form| {
        let coordinates = form.point().state.q.len();
        let (mut dq, mut dv) = (vec![0.0; coordinates], vec![0.0; coordinates]);
        form.newton().clone().spread(&change, &mut dq, &mut dv);
        [dq, dv]
    });
    for (a, b) in found[0].iter().zip(&found[1]) {
        out[8] = out[8].max(apart(a, b, 1.0));
    }
    out
}

fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |m, x| m.max(x.abs()))
}

#[test] // independent truth: the Cartesian blocks
fn the_library_has_the_cartesian_blocks() {
    let mut random = Random::new(23);
    for name in LIBRARY {
        let mut forms = Forms::new(model(name)).unwrap_or_else(|| panic!("{name}: a joint form"));
        let start = forms.w.clone();
        let mut compared = 0;
        for _ in 0..25 {
            if forms.go(&start, &mut random) {
                compared += 1;
                let worst = compare(&mut forms, &mut random);
                assert!(worst.iter().all(|x| *x < 1e-9), "{name}: {worst:?}");
            }
        }
        assert!(compared >= 20, "{name}: {compared} states");
    }
}

#[test] // independent truth: the Cartesian blocks
fn random_mechanisms_have_the_cartesian_blocks() {
    let (mut compared, mut with_loops, mut most) = (0, 0, 0);
    for seed in 0..500 {
        let text = Mechanism::new(seed, 0.0).text();
        let mut model = model_of(&text);
        if seed % 4 == 0 && !model.joints.is_empty() {
            model.simulation.cut = vec![seed as usize / 4 % model.joints.len()];
        }
        let Some(mut forms) = Forms::new(model) else { continue };
        let (mut random, start) = (Random::new(seed), forms.w.clone());
        for _ in 0..4 {
            if !forms.go(&start, &mut random) {
                continue;
            }
            compared += 1;
            with_loops += usize::from(forms.loops > 0);
            most = most.max(forms.loops);
            let worst = compare(&mut forms, &mut random);
            assert!(worst.iter().all(|x| *x < 1e-9), "seed {seed}: {worst:?}\n{text}");
        }
    }
    assert!(
        compared > 1200 && with_loops > 500 && most > 2,
        "{compared} states, {with_loops} with loops, {most} at most"
    );
}

#[test] // independent truth: the Cartesian blocks
fn many_loops_have_the_cartesian_blocks() {
    let mut random = Random::new(5);
    for (model, loops) in [
        (four_bars(1, true), 1),
        (four_bars(3, true), 5),
        (four_bars(5, true), 9),
        (four_bars(10, false), 10),
    ] {
        let mut forms = Forms::new(model).expect("a joint form");
        assert_eq!(forms.loops, loops);
        let start = forms.w.clone();
        let mut compared = 0;
        for _ in 0..20 {
            if forms.go(&start, &mut random) {
                compared += 1;
                let worst = compare(&mut forms, &mut random);
                assert!(worst.iter().all(|x| *x < 1e-9), "{loops} loops: {worst:?}");
            }
        }
        assert!(compared >= 10, "{loops} loops: {compared} states");
    }
}

/// A four-bar whose rocker's angle is chosen, being stiff; a pendulum on the coupler, and a damper in series with a spring
/// on the rocker.
const ROCKER: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
crank = { mass = 1.0, inertia = 0.05, position = [0.0, 0.5], angle = 1.5707963267948966 }
coupler = { mass = 2.0, inertia = 0.5, position = [1.0, 1.5], angle = 0.4636476090008061 }
rocker = { mass = 1.5, inertia = 0.3, position = [2.0, 1.0], angle = 1.5707963267948966 }
bob = { mass = 0.7, inertia = 0.02, position = [1.0, 1.2] }
[joints]
a = { type = "revolute", between = ["ground", "crank"], point = [0.0, 0.0] }
b = { type = "revolute", between = ["crank", "coupler"], point = [0.0, 1.0] }
c = { type = "revolute", between = ["coupler", "rocker"], point = [2.0, 2.0] }
d = { type = "revolute", between = ["ground", "rocker"], point = [2.0, 0.0] }
e = { type = "revolute", between = ["coupler", "bob"], point = [1.0, 1.5] }
[forces]
stiff = { type = "rsda", between = ["KNEE", "rocker"], stiffness = 1e6, damping = 10.0, free_angle = 1.0 }
series = { type = "maxwell", between = ["ground", "rocker"], points = [[4.0, 1.0], [2.0, 1.5]], stiffness = 400.0, damping = 50.0, free_length = 2.0 }
"#;

#[test] // independent truth: the Cartesian blocks
fn what_extra_states_act_on_is_forgotten_by_the_next_linearization() {
    let mut random = Random::new(11);
    for knee in ["ground", "coupler"] {
        let mut forms = Forms::new(model_of(&ROCKER.replace("KNEE", knee))).expect("a joint form");
        let start = forms.w.clone();
        for _ in 0..10 {
            assert!(forms.go(&start, &mut random));
            let worst = compare(&mut forms, &mut random);
            assert!(worst.iter().all(|x| *x < 1e-9), "{knee}: {worst:?}");
        }
    }
}

/// M̂ times the derivative of v̈, and that of ż, along entry j of w, or along time: Richardson extrapolation of central
/// differences; none where a neighbour cannot be evaluated.
fn difference(
    form: &mut FirstOrder,
    t: f64,
    w: &[f64],
    j: Option<usize>,
    step: f64,
) -> Option<Vec<f64>> {
    let mut central = |h: f64| -> Option<Vec<f64>> {
        let mut ends = Vec::new();
        for s in [h, -h] {
            let (mut moved, mut slope) = (w.to_vec(), vec![0.0; w.len()]);
            j.iter().for_each(|&j| moved[j] += s);
            let t = if j.is_none() { t + s } else { t };
            form.derivative(t, &moved, &mut slope).ok()?;
            ends.push(slope);
        }
        Some(ends[0].iter().zip(&ends[1]).map(|(a, b)| (a - b) / (2.0 * h)).collect())
    };
    let (coarse, fine) = (central(step)?, central(0.5 * step)?);
    Some(fine.iter().zip(coarse).map(|(f, c)| (4.0 * f - c) / 3.0).collect())
}

/// Worst differences of −M̂₂, −M̂₁, Ẑ, and of M̂ v̈_t, from differences of v̈, against the largest of their entries; and
/// whether all neighbours could be evaluated.
fn against_differences(forms: &mut Forms) -> Option<[f64; 4]> {
    let (t, w, ndof) = (forms.t, forms.w.clone(), forms.ndof);
    let blocks = forms.joint.newton().blocks().clone();
    let mut g_t = vec![0.0; w.len()];
    forms.joint.time_derivative(&mut g_t).ok()?;
    let mass = largest(&blocks.mass);
    let sizes = [&blocks.stiffness, &blocks.damping, &blocks.force_extra].map(|b| largest(b));
    let mut worst = [0.0f64; 4];
    for j in (0..w.len()).map(Some).chain([None]) {
        let (at, column): (usize, Vec<f64>) = match j {
            Some(j) if j < ndof => (0, (0..ndof).map(|i| blocks.stiffness[i * ndof + j]).collect()),
            Some(j) if j < 2 * ndof => {
                (1, (0..ndof).map(|i| blocks.damping[i * ndof + j - ndof]).collect())
            }
            Some(j) => {
                let first = (j - 2 * ndof) * ndof;
                (2, blocks.force_extra[first..first + ndof].to_vec())
            }
            None => {
                let rows = blocks.mass.chunks_exact(ndof);
                let force = rows.map(|row| -dot(row, &g_t[ndof..2 * ndof])).collect();
                (3, force)
            }
        };
        // Differences carry round-off of the stiffest part.
        let size = largest(&column).max(1e-3 * sizes[0]);
        let size = if at < 3 { size.max(sizes[at]).max(mass) } else { size.max(1.0) };
        // A long step cuts off more, a short one leaves more round-off.
        let mut least = f64::INFINITY;
        for step in [1e-3, 2e-4] {
            let slope = difference(&mut forms.joint, t, &w, j, step)?;
            let rows = blocks.mass.chunks_exact(ndof).zip(&column);
            let errors = rows.map(|(row, own)| (dot(row, &slope[ndof..2 * ndof]) + own).abs());
            least = least.min(errors.fold(0.0, f64::max) / size);
        }
        worst[at] = worst[at].max(least);
    }
    Some(worst)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[test] // independent truth: differences of v̈ with all dependent coordinates solved anew
fn differences_agree() {
    let mut compared = 0;
    let named = LIBRARY.iter().filter(|name| !name.starts_with("chain"));
    let mut models: Vec<(String, Model)> = named.map(|n| ((*n).to_owned(), model(n))).collect();
    models.push(("driven pendulum".to_owned(), model_of(DRIVEN_PENDULUM)));
    models.push(("driven telescope".to_owned(), model_of(DRIVEN_TELESCOPE)));
    for seed in (0..300).step_by(3) {
        let text = Mechanism::new(seed, 0.0).text();
        models.push((text.clone(), model_of(&text)));
    }
    for (name, model) in models {
        let Some(mut forms) = Forms::new(model) else { continue };
        let (mut random, start) = (Random::new(7), forms.w.clone());
        if !forms.go(&start, &mut random) {
            continue;
        }
        let Some(worst) = against_differences(&mut forms) else { continue };
        compared += 1;
        assert!(worst.iter().all(|x| *x < 1e-7), "{worst:?} {name}");
    }
    assert!(compared > 60, "{compared} mechanisms");
}
