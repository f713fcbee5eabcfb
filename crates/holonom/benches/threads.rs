//! What do threads gain? Jacobian and factorization, real and complex, of a binary tree of 3,000 bodies with
//! springs and dampers in their hinges, in the plane and in space, by one thread and by two,
//! each several times in a row, as a run has them.
//!
//! `cargo bench -p holonom --bench threads` times them and prints the ratio of their medians, taken in turn.
//! Bound on two free cores: 1.6. Measured on two cores of x86-64: 1.8 in the plane, 2.0 in space.

#![allow(missing_docs)] // of the functions that criterion's macros make
#![allow(clippy::print_stdout, reason = "the ratio is for the reader")]

use std::time::Instant;

use criterion::Criterion;
use holonom::io::{Document, Syntax};
use holonom::newton::{Chosen, MatrixOptions, Newton, ReducedMatrix, Representation};
use holonom::reduction::Point;
use holonom::simulation::Problem;
use holonom::threads::Threads;
use holonom_linalg::Complex64;

const PLANAR: &str = r#"
holonom = 1
title = "binary tree"
dimension = "planar"
[patterns.tree]
over.i = { from = 1, to = 3000 }
bodies."link_{i}" = { mass = 1.0, inertia = "=1/12",
  position = [0.0, "=-floor(log(i)/log(2) + 1e-9) - 0.5"] }
joints."joint_{i}" = { type = "revolute", between = ["link_{i // 2}", "link_{i}"],
  points_in_body = [[0.0, -0.5], [0.0, 0.5]] }
forces."spring_{i}" = { type = "rsda", between = ["link_{i // 2}", "link_{i}"], stiffness = 1e4, damping = 1e2 }
[joints]
joint_1 = { between = ["ground", "link_1"], points_in_body = [[0.0, 0.0], [0.0, 0.5]] }
[forces]
spring_1 = { between = ["ground", "link_1"] }
"#;

const SPATIAL: &str = r#"
holonom = 1
title = "binary tree"
dimension = "spatial"
[patterns.tree]
over.i = { from = 1, to = 3000 }
bodies."link_{i}" = { mass = 1.0, inertia = [[0.01, 0.0, 0.0], [0.0, "=1/12", 0.0], [0.0, 0.0, "=1/12"]],
  position = ["=floor(log(i)/log(2) + 1e-9) + 0.5", 0.0, 0.0] }
joints."joint_{i}" = { type = "revolute", between = ["link_{i // 2}", "link_{i}"],
  points_in_body = [[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]], axis = [0.0, "=i % 2", "=1 - i % 2"] }
forces."spring_{i}" = { type = "rsda", between = ["link_{i // 2}", "link_{i}"],
  axis = [0.0, "=i % 2", "=1 - i % 2"], stiffness = 1e4, damping = 1e2 }
[joints]
joint_1 = { between = ["ground", "link_1"], points_in_body = [[0.0, 0.0, 0.0], [-0.5, 0.0, 0.0]] }
[forces]
spring_1 = { between = ["ground", "link_1"] }
"#;

/// A tree and its integration Jacobian.
struct Tree {
    newton: Newton<Chosen<ReducedMatrix>>,
    point: Point,
    w: Vec<f64>,
}

impl Tree {
    fn new(text: &str, threads: usize) -> Self {
        let mut read = |_: &str| Err(String::new());
        let document = Document::parse(text, Syntax::Toml, "tree", &mut read).expect("reads");
        let problem = Problem::new(document.build().expect("is valid").0);
        let assembled = problem.assemble().expect("assembles");
        let mut point = Point::new(assembled.manifold(), &assembled.state);
        let ndof = assembled.parametrization().ndof;
        let mut w = vec![0.0; 2 * ndof];
        let (p, rates) = w.split_at_mut(ndof);
        assembled.manifold().independent_state(&assembled.state, p, rates);
        point.evaluate(0.0, p, rates, &[], true).expect("regular");
        point.complete();
        let options = MatrixOptions {
            representation: Representation::Sparse,
            threads: Threads::new(threads),
            ..MatrixOptions::default()
        };
        let newton = Newton::new(&assembled.manifold(), &assembled.state.q, options);
        Self { newton, point, w }
    }

    /// Everything of one integration Jacobian with γh near 1 ms, and its factors.
    fn jacobian(&mut self) {
        self.newton.linearize(&mut self.point, &self.w).expect("regular");
        self.newton.factor(1e-3, 1e-6).expect("regular");
        self.newton.factor_complex(Complex64::new(1e-3, 5e-4)).expect("regular");
    }
}

fn main() {
    let mut criterion = Criterion::default().sample_size(20).configure_from_args();
    for (name, text) in [("planar", PLANAR), ("spatial", SPATIAL)] {
        let mut trees = [1, 2].map(|threads| Tree::new(text, threads));
        for (tree, threads) in trees.iter_mut().zip(["one thread", "two threads"]) {
            criterion.bench_function(&format!("{name} tree, {threads}"), |b| {
                b.iter(|| tree.jacobian());
            });
        }
        let mut times = [const { Vec::new() }; 2];
        for _ in 0..10 {
            for (tree, times) in trees.iter_mut().zip(&mut times) {
                tree.jacobian(); // its numbers back into the caches, which the other tree had
                for _ in 0..10 {
                    let begin = Instant::now();
                    tree.jacobian();
                    times.push(begin.elapsed().as_secs_f64());
                }
            }
        }
        times.iter_mut().for_each(|times| times.sort_by(f64::total_cmp));
        for (what, at) in [("median", 50), ("best of ten", 10)] {
            let [one, two] = [&times[0], &times[1]].map(|times| 1e3 * times[at]);
            println!("{name}, {what}: {one:.2} ms, {two:.2} ms by two, ratio {:.2}", one / two);
        }
    }
}
