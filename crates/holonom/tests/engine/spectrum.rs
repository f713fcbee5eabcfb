//! Eigenvalues of rotors, and the fastest ones of large models.

use crate::common::model_of;
use holonom::analysis::{fastest, spectrum};
use holonom::simulation::Problem;
use holonom_linalg::eigenvalues;

#[test] // independent truth: all eigenvalues, of the dense matrix
fn the_fastest_are_those_of_the_dense_matrix() {
    for (name, least) in [("chain50", 2), ("spatial_four_bar", 1), ("hmmwv14", 2)] {
        let problem = Problem::new(crate::common::model(name));
        let assembled = problem.assemble().unwrap();
        let (all, found) = (spectrum(assembled).unwrap(), fastest(assembled).unwrap());
        assert!(all.is_complete && found.len() >= least, "{name}: {found:?}");
        let size = |z: &(f64, f64)| z.0.hypot(z.1);
        let (largest, first) = (size(&all.values[0]), size(&found[0]));
        assert!((largest - first).abs() < 1e-6 * largest, "{name}: {largest} {first}");
        for z in &found {
            let distances = all.values.iter().map(|y| size(&(z.0 - y.0, z.1 - y.1)));
            let nearest = distances.fold(f64::INFINITY, f64::min);
            assert!(nearest < 1e-5 * largest, "{name}: {z:?} is {nearest:.1e} off");
        }
    }
}

/// A chain of `links`, 0.1 m each, that begins to fall from the horizontal.
fn level_chain(links: usize, force: &str) -> Problem {
    Problem::new(model_of(&format!(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[patterns.chain]
over.i = {{ from = 1, to = {links} }}
bodies."link_{{i}}" = {{ mass = 0.1, inertia = 8.3e-5, position = ["=(i - 0.5)/10", 0.0] }}
joints."joint_{{i}}" = {{ type = "revolute", between = ["link_{{i - 1}}", "link_{{i}}"], point = ["=(i - 1)/10", 0.0] }}
[joints]
joint_1 = {{ between = ["ground", "link_1"] }}
{force}
"#
    )))
}

#[test] // independent truth: gravity is perpendicular to all links, so that its moments change with no angle
fn round_off_of_zero_is_no_mode() {
    for links in [40, 400, 4000] {
        let problem = level_chain(links, "");
        let found = fastest(problem.assemble().unwrap()).unwrap();
        assert!(found.iter().all(|z| *z == (0.0, 0.0)), "{links}: {found:?}");
    }
    // A spring on the first link alone has one mode beside them.
    let spring = "[forces]\nspring = { type = \"rsda\", between = [\"ground\", \"link_1\"], stiffness = 10.0 }";
    let problem = level_chain(40, spring);
    let assembled = problem.assemble().unwrap();
    let (all, found) = (spectrum(assembled).unwrap().values, fastest(assembled).unwrap());
    let frequency = all[0].1;
    assert!((found[0].1 / frequency - 1.0).abs() < 1e-6, "{found:?} {frequency}");
    assert!(found[2..].iter().all(|z| *z == (0.0, 0.0)), "{found:?}");
}

#[test] // independent truth: all eigenvalues, of the dense matrix
fn fast_vibrations_are_found_beside_slow_ones() {
    for (seed, damped) in [(1u32, false), (2, false), (3, true), (4, true)] {
        let spring = |i: u32| {
            let part = f64::from((i * i * 7 + seed * 131) % 97) / 97.0;
            let stiffness = 10f64.powf(2.0 + 10.0 * part);
            let damping = if damped && i.is_multiple_of(3) { 1e-8 * stiffness } else { 0.0 };
            let before = if i == 1 { "ground".to_owned() } else { format!("link_{}", i - 1) };
            format!(
                "[forces.spring_{i}]\ntype = \"rsda\"\nbetween = [\"{before}\", \"link_{i}\"]\n\
                 stiffness = {stiffness:e}\ndamping = {damping:e}\n"
            )
        };
        let springs = (1..=60).map(spring).collect::<Vec<_>>().concat();
        let problem = level_chain(60, &springs);
        let assembled = problem.assemble().unwrap();
        let (all, found) = (spectrum(assembled).unwrap().values, fastest(assembled).unwrap());
        assert!(!found.is_empty(), "seed {seed}");
        let size = |z: &(f64, f64)| z.0.hypot(z.1);
        let off = size(&all[0]) / size(&found[0]) - 1.0;
        assert!(off.abs() < 1e-6, "seed {seed}: {:?} {:?}", all[0], found[0]);
    }
}

#[test] // independent truth: all eigenvalues, of the dense matrix
fn slow_vibrations_are_not_lost_beside_a_fast_decay() {
    for damping in [1e2, 1e4, 1e5] {
        let springs: String = [(3, 200.0), (11, 30.0), (17, 90.0), (29, 400.0)]
            .map(|(i, stiffness)| {
                format!(
                    "[forces.spring_{i}]\ntype = \"rsda\"\nbetween = [\"link_{}\", \"link_{i}\"]\n\
                     stiffness = {stiffness:?}\n",
                    i - 1
                )
            })
            .concat();
        let damper = format!(
            "[forces.damper]\ntype = \"rsda\"\nbetween = [\"link_39\", \"link_40\"]\ndamping = {damping:e}\n"
        );
        let problem = level_chain(60, &format!("{springs}{damper}"));
        let assembled = problem.assemble().unwrap();
        let (all, found) = (spectrum(assembled).unwrap().values, fastest(assembled).unwrap());
        let size = |z: &(f64, f64)| z.0.hypot(z.1);
        assert!((size(&all[0]) / size(&found[0]) - 1.0).abs() < 1e-6, "{damping:e}");
        for z in &found {
            let distances = all.iter().map(|y| size(&(z.0 - y.0, z.1 - y.1)));
            let nearest = distances.fold(f64::INFINITY, f64::min);
            assert!(nearest < 1e-4 * size(z).max(1.0), "{damping:e}: {z:?} is {nearest:.1e} off");
        }
    }
}

/// A top with these moments across and along its axis, that stands on its point and spins; `held` is what holds it.
fn upright([across, along]: [f64; 2], spin: f64, held: &str) -> Problem {
    Problem::new(model_of(&format!(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
top = {{ mass = 2.0, inertia = [[{across}, 0.0, 0.0], [0.0, {across}, 0.0], [0.0, 0.0, {along}]], position = [0.0, 0.0, 0.3] }}
{held}
[initial.bodies]
top = {{ angular_velocity = [0.0, 0.0, {spin}] }}
"#
    )))
}

#[test] // independent truth: θ of a symmetric top in the complex plane: I θ̈ − i I₃Ω θ̇ + k θ = 0
fn a_rotor_whirls_as_by_hand() {
    let on_point = "[joints]\nfoot = { type = \"spherical\", between = [\"ground\", \"top\"], point = [0.0, 0.0, 0.0] }";
    let on_bushing = "[forces]\nmount = { type = \"bushing\", between = [\"ground\", \"top\"], point = [0.0, 0.0, 0.3], \
                      stiffness = [1e3, 1e3, 1e3], rotational_stiffness = [40.0, 40.0, 0.0] }";
    for (moments, spin) in [([0.1, 0.15], 300.0), ([0.1, 0.02], 60.0), ([0.1, 0.02], 20.0)] {
        for (held, about, stiffness) in
            [(on_point, 0.1 + 2.0 * 0.09, -2.0 * 9.81 * 0.3), (on_bushing, 0.1, 40.0)]
        {
            let driven = format!(
                "{held}\n[drivers]\nmotor = {{ between = [\"ground\", \"top\"], coordinate = \"rotation\", \
                 axis = [0.0, 0.0, 1.0], motion = {{ type = \"polynomial\", coefficients = [0.0, {spin}] }} }}"
            );
            let gyroscopic = moments[1] * spin;
            // λ = i (I₃Ω ± √((I₃Ω)² + 4 I k)) / 2 I, and their conjugates.
            let root: f64 = gyroscopic * gyroscopic + 4.0 * about * stiffness;
            let expected: Vec<(f64, f64)> = [1.0, -1.0]
                .into_iter()
                .flat_map(|sign| {
                    let (real, imaginary) = if root < 0.0 {
                        (sign * (-root).sqrt(), gyroscopic)
                    } else {
                        (0.0, gyroscopic + sign * root.sqrt())
                    };
                    let z = (0.5 * real / about, 0.5 * imaginary / about);
                    [z, (z.0, -z.1)]
                })
                .collect();
            // By itself, and held to its speed.
            for held in [held, &driven] {
                holds_all(&upright(moments, spin, held), &expected, spin);
            }
        }
    }
}

/// The eigenvalues of the dense matrix, and those of large models, contain these.
fn holds_all(problem: &Problem, expected: &[(f64, f64)], spin: f64) {
    let assembled = problem.assemble().unwrap();
    for found in [spectrum(assembled).unwrap().values, fastest(assembled).unwrap()] {
        for z in expected {
            let away = found.iter().map(|y| (y.0 - z.0).hypot(y.1 - z.1));
            let nearest = away.fold(f64::INFINITY, f64::min);
            assert!(nearest < 1e-6 * (1.0 + z.1.abs()), "{spin}: {z:?} is not in {found:?}");
        }
    }
}

/// The library's eigenvalues of matrices that are written down by hand: λ = iμ and their conjugates, of −μ² s + μ A s + B s = 0 with real n × n matrices by rows.
fn whirls(n: usize, a: &[f64], b: &[f64]) -> Vec<(f64, f64)> {
    let mut companion = vec![0.0; 4 * n * n];
    for (r, c) in (0..n * n).map(|k| (k / n, k % n)) {
        companion[r * 2 * n + n + c] = f64::from(u8::from(r == c));
        companion[(n + r) * 2 * n + c] = b[r * n + c];
        companion[(n + r) * 2 * n + n + c] = a[r * n + c];
    }
    let roots = eigenvalues(2 * n, &companion).unwrap();
    roots.into_iter().flat_map(|(x, y)| [(-y, x), (-y, -x)]).collect()
}

#[test] // independent truth: tilts of symmetric tops in the complex plane, one on the tip of the other, with this matrix of inertia
fn a_top_on_a_top_whirls_as_by_hand() {
    let [lower, upper] = [(2.0, [0.1, 0.15]), (1.0, [0.05, 0.02])];
    let (own, tip, above, g) = (0.3, 0.7, 0.2, 9.81);
    for spins in [[60.0, -40.0], [200.0, 150.0], [60.0, 60.0]] {
        for (between, halves) in [
            (["lower", "upper"], ""),
            (["upper", "lower"], ""),
            (["half", "upper"], "type = \"fixed\", between = [\"lower\", \"half\"]"),
            (["upper", "half"], "type = \"fixed\", between = [\"half\", \"lower\"]"),
            (
                ["half", "upper"],
                "type = \"revolute\", axis = [0.0, 0.0, 1.0], between = [\"lower\", \"half\"]",
            ),
        ] {
            // The lower one in two halves where something holds them together.
            let part = if halves.is_empty() { 1.0 } else { 0.5 };
            let half = |text: String| if halves.is_empty() { String::new() } else { text };
            let half_body = half(format!(
                "half = {{ mass = {}, inertia = [[{l}, 0.0, 0.0], [0.0, {l}, 0.0], [0.0, 0.0, {}]], position = [0.0, 0.0, {own}] }}\n",
                part * lower.0,
                part * lower.1[1],
                l = part * lower.1[0],
            ));
            let weld = half(format!("weld = {{ {halves}, point = [0.0, 0.0, {own}] }}\n"));
            let turning =
                half(format!("half = {{ angular_velocity = [0.0, 0.0, {}] }}\n", spins[0]));
            let problem = Problem::new(model_of(&format!(
                r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -{g}]
[bodies]
lower = {{ mass = {}, inertia = [[{l}, 0.0, 0.0], [0.0, {l}, 0.0], [0.0, 0.0, {}]], position = [0.0, 0.0, {own}] }}
upper = {{ mass = {}, inertia = [[{u}, 0.0, 0.0], [0.0, {u}, 0.0], [0.0, 0.0, {}]], position = [0.0, 0.0, {}] }}
{half_body}[joints]
foot = {{ type = "spherical", between = ["ground", "lower"], point = [0.0, 0.0, 0.0] }}
tip = {{ type = "spherical", between = {between:?}, point = [0.0, 0.0, {tip}] }}
{weld}[initial.bodies]
{turning}lower = {{ angular_velocity = [0.0, 0.0, {}] }}
upper = {{ angular_velocity = [0.0, 0.0, {}] }}
"#,
                part * lower.0,
                part * lower.1[1],
                upper.0,
                upper.1[1],
                tip + above,
                spins[0],
                spins[1],
                l = part * lower.1[0],
                u = upper.1[0],
            )));
            let m = [
                lower.1[0] + lower.0 * own * own + upper.0 * tip * tip,
                upper.0 * tip * above,
                upper.1[0] + upper.0 * above * above,
            ];
            let determinant = m[0] * m[2] - m[1] * m[1];
            let inverse = [m[2], -m[1], -m[1], m[0]].map(|x| x / determinant);
            let columns =
                |x: f64, y: f64| [inverse[0] * x, inverse[1] * y, inverse[2] * x, inverse[3] * y];
            let gyroscopic = columns(lower.1[1] * spins[0], upper.1[1] * spins[1]);
            let weight = [lower.0 * own + upper.0 * tip, upper.0 * above].map(|x| -x * g);
            let stiffness = columns(weight[0], weight[1]);
            holds_all(&problem, &whirls(2, &gyroscopic, &stiffness), spins[0]);
        }
    }
}

#[test] // independent truth: shifts and tilts of symmetric rotors in the complex plane, with this energy of the bushings
fn rotors_in_a_row_on_bushings_whirl_as_by_hand() {
    let (mass, [across, along]) = ([2.0, 1.0], [[0.1, 0.05], [0.15, 0.02]]);
    let (below, gap, k, turning) = ([0.1, 0.4, 0.2], 1.0, [1e3, 4e2], [40.0, 9.0]);
    for spins in [[60.0, -40.0], [200.0, 150.0], [60.0, 60.0]] {
        for swapped in [false, true] {
            let between = if swapped { ["outer", "inner"] } else { ["inner", "outer"] };
            let problem = Problem::new(model_of(&format!(
                r#"
holonom = 1
dimension = "spatial"
[bodies]
inner = {{ mass = {}, position = [0.0, 0.0, 0.0], inertia = [[{}, 0.0, 0.0], [0.0, {}, 0.0], [0.0, 0.0, {}]] }}
outer = {{ mass = {}, inertia = [[{}, 0.0, 0.0], [0.0, {}, 0.0], [0.0, 0.0, {}]], position = [0.0, 0.0, {gap}] }}
[forces]
mount = {{ type = "bushing", between = ["ground", "inner"], point = [0.0, 0.0, -{}], stiffness = [{}, {}, 500.0], rotational_stiffness = [{}, {}, 0.0] }}
coupling = {{ type = "bushing", between = {between:?}, point = [0.0, 0.0, {}], stiffness = [{}, {}, 300.0], rotational_stiffness = [{}, {}, 0.0] }}
[initial.bodies]
inner = {{ angular_velocity = [0.0, 0.0, {}] }}
outer = {{ angular_velocity = [0.0, 0.0, {}] }}
"#,
                mass[0],
                across[0],
                across[0],
                along[0],
                mass[1],
                across[1],
                across[1],
                along[1],
                below[0],
                k[0],
                k[0],
                turning[0],
                turning[0],
                below[1],
                k[1],
                k[1],
                turning[1],
                turning[1],
                spins[0],
                spins[1],
            )));
            // (shift, tilt) of the inner and the outer one; what each spring is stretched by.
            let arm = gap - below[1];
            let springs = [
                (k[0], [1.0, -below[0], 0.0, 0.0]),
                (turning[0], [0.0, 1.0, 0.0, 0.0]),
                (k[1], [-1.0, -below[1], 1.0, -arm]),
                (turning[1], [0.0, -1.0, 0.0, 1.0]),
            ];
            let inertia = [mass[0], across[0], mass[1], across[1]];
            let (mut a, mut b) = ([0.0; 16], [0.0; 16]);
            for (r, c) in (0..16).map(|k| (k / 4, k % 4)) {
                let stiffness: f64 = springs.iter().map(|(k, along)| k * along[r] * along[c]).sum();
                b[r * 4 + c] = stiffness / inertia[r];
            }
            a[5] = along[0] * spins[0] / inertia[1];
            a[15] = along[1] * spins[1] / inertia[3];
            holds_all(&problem, &whirls(4, &a, &b), spins[0]);
        }
    }
}

#[test] // independent truth: Euler's equations of a body that is not the same about its axis, in axes of its turntable
fn what_turns_with_its_turntable_swings_as_by_hand() {
    let ([a, b, c], mass, length, g, spin) = ([0.06, 0.07, 0.02], 2.0, 0.3, 9.81, 11.0f64);
    let problem = Problem::new(model_of(&format!(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -{g}]
[bodies]
table = {{ mass = 5.0, position = [0.0, 0.0, 0.0], inertia = [[0.3, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.5]] }}
weight = {{ mass = {mass}, inertia = [[{a}, 0.0, 0.0], [0.0, {b}, 0.0], [0.0, 0.0, {c}]], position = [0.0, 0.0, -{length}] }}
[joints]
axle = {{ type = "revolute", between = ["ground", "table"], point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }}
ball = {{ type = "spherical", between = ["table", "weight"], point = [0.0, 0.0, 0.0] }}
[initial.bodies]
table = {{ angular_velocity = [0.0, 0.0, {spin}] }}
weight = {{ angular_velocity = [0.0, 0.0, {spin}] }}
"#
    )));
    let about = [a, b].map(|x| x + mass * length * length);
    let moment = mass * g * length;
    let stiffness = [1, 0].map(|other| (about[other] - c) * -spin * spin + moment);
    let gyroscopic = (about[0] + about[1] - c) * spin;
    // A B λ⁴ + (A k_b + B k_a + (A + B − C)² Ω²) λ² + k_a k_b = 0.
    let [first, last] = [about[0] * about[1], stiffness[0] * stiffness[1]];
    let middle = about[0] * stiffness[1] + about[1] * stiffness[0] + gyroscopic * gyroscopic;
    let root = (middle * middle - 4.0 * first * last).sqrt();
    let expected: Vec<(f64, f64)> = [root, -root]
        .map(|root| (0.5 * (middle + root) / first).sqrt())
        .into_iter()
        .flat_map(|y| [(0.0, y), (0.0, -y)])
        .collect();
    holds_all(&problem, &expected, spin);
}

#[test] // independent truth: shifts and tilts of symmetric bodies in the complex plane, with this energy of the bushings
fn a_disc_on_a_shaft_in_a_soft_housing_whirls_as_by_hand() {
    let (mass, across, along, spin) =
        ([3.0, 1.0, 0.5], [0.2, 0.03, 0.02], [0.3, 0.01, 0.035], 30.0);
    let (k, turning) = ([2e3, 8e2], [60.0, 15.0]);
    let body = |b: usize| {
        format!(
            "mass = {}, position = [0.0, 0.0, 0.0], inertia = [[{a}, 0.0, 0.0], [0.0, {a}, 0.0], [0.0, 0.0, {}]]",
            mass[b],
            along[b],
            a = across[b]
        )
    };
    let bushing = |b: usize| {
        format!(
            "point = [0.0, 0.0, 0.0], stiffness = [{k}, {k}, 700.0], rotational_stiffness = [{t}, {t}, 20.0]",
            k = k[b],
            t = turning[b]
        )
    };
    let problem = Problem::new(model_of(&format!(
        r#"
holonom = 1
dimension = "spatial"
[bodies]
housing = {{ {} }}
shaft = {{ {} }}
disc = {{ {} }}
[joints]
bearing = {{ type = "revolute", between = ["housing", "shaft"], point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }}
[forces]
mount = {{ type = "bushing", between = ["ground", "housing"], {} }}
seat = {{ type = "bushing", between = ["shaft", "disc"], {} }}
[initial.bodies]
shaft = {{ angular_velocity = [0.0, 0.0, {spin}] }}
disc = {{ angular_velocity = [0.0, 0.0, {spin}] }}
"#,
        body(0),
        body(1),
        body(2),
        bushing(0),
        bushing(1),
    )));
    // Shifts of housing with shaft and of the disc; their tilts, of which the disc's is against the ground.
    for (inertia, gyroscopic, k) in [
        ([mass[0] + mass[1], mass[2]], [0.0, 0.0], k),
        ([across[0] + across[1], across[2]], [along[1] * spin, along[2] * spin], turning),
    ] {
        let a = [gyroscopic[0] / inertia[0], 0.0, 0.0, gyroscopic[1] / inertia[1]];
        let b =
            [(k[0] + k[1]) / inertia[0], -k[1] / inertia[0], -k[1] / inertia[1], k[1] / inertia[1]];
        holds_all(&problem, &whirls(2, &a, &b), spin);
    }
}
