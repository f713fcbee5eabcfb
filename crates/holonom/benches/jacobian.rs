//! Time of an integration Jacobian of the vehicle: reduced to the independent coordinates, in
//! descriptor form, and by differences; to build, and to build and factor.

#![allow(missing_docs)] // of the functions that criterion's macros make

use std::path::PathBuf;

use criterion::{Criterion, criterion_group, criterion_main};
use holonom::io::{Document, Syntax};
use holonom::method::ode::{Ode, SecondOrder};
use holonom::method::{Descriptor, EquationForm, FirstOrder, Iterate, Weights};
use holonom::model::Tolerance;
use holonom::newton::{JacobianSource, MatrixOptions};
use holonom::simulation::Problem;

const MODELS: [&str; 3] = ["hmmwv14", "chain50", "andrews"];

fn problem(name: &str) -> Problem {
    let library = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../models");
    let file = format!("{name}/model.toml");
    let mut read =
        |file: &str| std::fs::read_to_string(library.join(file)).map_err(|e| e.to_string());
    let text = read(&file).expect("a model of the library");
    let mut bytes = |file: &str| std::fs::read(library.join(file)).map_err(|e| e.to_string());
    let document = Document::parse(&text, Syntax::Toml, &file, &mut read).expect("a model");
    let document = document.with_meshes(&mut bytes).expect("its shapes are there");
    Problem::new(document.build().expect("a model").0)
}

fn jacobian(c: &mut Criterion) {
    for name in MODELS {
        let problem = problem(name);
        let assembled = problem.assemble().expect("an initial state");
        let (manifold, state) = (assembled.manifold(), assembled.state.clone());
        let system = problem.system().clone();
        let weights = || Weights::new(Tolerance::uniform(1e-4), system.as_ref(), &state);
        let mut reduced = FirstOrder::new(manifold.clone(), weights(), &state);
        let mut w = vec![0.0; reduced.dimension()];
        let mut g = w.clone();
        reduced.pack(&state, &mut w);
        reduced.derivative(state.t, &w, &mut g).expect("accelerations");
        let mut descriptor = Descriptor::new(manifold, weights(), &state, Iterate::Consistent);
        let (gamma_h, beta_h2) = (2.5e-3, 6.25e-6);

        let mut group = c.benchmark_group(name);
        let mut measure = |title: &str, form: &mut dyn SecondOrder| {
            group.bench_function(format!("{title}, build"), |b| {
                b.iter(|| form.linearize(state.t, &w).expect("a Jacobian"));
            });
            group.bench_function(format!("{title}, build and factor"), |b| {
                b.iter(|| {
                    form.linearize(state.t, &w).expect("a Jacobian");
                    form.factor_stage(gamma_h, beta_h2).expect("regular");
                });
            });
        };
        measure("reduced", &mut reduced);
        measure("descriptor form", &mut descriptor);
        reduced.set_matrix(MatrixOptions {
            source: JacobianSource::Differences,
            ..MatrixOptions::default()
        });
        descriptor.set_matrix(MatrixOptions {
            source: JacobianSource::Differences,
            ..MatrixOptions::default()
        });
        measure("reduced by differences", &mut reduced);
        measure("descriptor form by differences", &mut descriptor);
        group.bench_function("accelerations", |b| {
            b.iter(|| reduced.derivative(state.t, &w, &mut g.clone()).expect("accelerations"));
        });
        group.finish();
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20).measurement_time(std::time::Duration::from_secs(1)).warm_up_time(std::time::Duration::from_millis(300));
    targets = jacobian
}
criterion_main!(benches);
