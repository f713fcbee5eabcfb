//! Eigenvalues of rotors, and the fastest ones of large models.

use crate::common::model_of;
use holonom::analysis::{fastest, spectrum};
use holonom::simulation::Problem;

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
            let problem = upright(moments, spin, held);
            let assembled = problem.assemble().unwrap();
            let gyroscopic = moments[1] * spin;
            // λ = i (I₃Ω ± √((I₃Ω)² + 4 I k)) / 2 I, and their conjugates.
            let root = gyroscopic * gyroscopic + 4.0 * about * stiffness;
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
            for found in [spectrum(assembled).unwrap().values, fastest(assembled).unwrap()] {
                for z in &expected {
                    let away = found.iter().map(|y| (y.0 - z.0).hypot(y.1 - z.1));
                    let nearest = away.fold(f64::INFINITY, f64::min);
                    assert!(
                        nearest < 1e-6 * (1.0 + z.1.abs()),
                        "{spin}: {z:?} is not in {found:?}"
                    );
                }
            }
        }
    }
}
