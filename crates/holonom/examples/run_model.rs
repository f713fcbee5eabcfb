//! Runs a model file and prints what came out: `cargo run --release --example run_model --
//! models/hmmwv14/model.toml ForSDIRK 1e-3`. Method, tolerance, end time,
//! coordinates (`joint`), output interval and Newton's matrix (`sparse`) are optional.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "an example talks to its reader")]

use holonom::io::{Document, Syntax};
use holonom::simulation::{Choices, Memory, Problem, ToleranceParts, run};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let file = arguments.first().ok_or(
        "usage: run_model FILE [METHOD [TOLERANCE [END_TIME [COORDINATES [INTERVAL [NEWTON]]]]]]",
    )?;

    // The engine opens no file: the caller resolves what a model extends.
    let text = std::fs::read_to_string(file)?;
    let mut read = |name: &str| std::fs::read_to_string(Path::new(name)).map_err(|e| e.to_string());
    let mut bytes = |name: &str| std::fs::read(Path::new(name)).map_err(|e| e.to_string());
    let document = Document::parse(&text, Syntax::of_file(file), file, &mut read)
        .and_then(|document| document.with_meshes(&mut bytes))
        .map_err(|errors| errors.render())?;
    let (model, warnings) = document.build().map_err(|errors| errors.render())?;
    warnings.iter().for_each(|warning| eprintln!("warning: {warning}"));

    let number = |at: usize| arguments.get(at).map(|text| text.parse::<f64>()).transpose();
    let part = number(2)?;
    let choices = Choices {
        method: arguments.get(1).cloned(),
        tolerance: ToleranceParts { relative: part, translation: part, rotation: part },
        end_time: number(3)?,
        coordinates: arguments.get(4).cloned(),
        interval: number(5)?,
        newton: arguments.get(6).cloned(),
        channels: Some(Vec::new()),
        ..Choices::default()
    };
    let options = choices.resolve(&model, choices.start_time(&model, None)?)?;

    let problem = Problem::new(model);
    let mut rows = Memory::default();
    let summary = run(&problem, &options, None, &mut rows)?;
    let (s, e) = (&summary.statistics, &summary.energy);
    let per_second =
        s.run_seconds / (summary.end.t - rows.all.time.first().copied().unwrap_or(0.0));
    println!("{}: {}", summary.status.name(), summary.stop.message);
    println!("degrees of freedom  {}", summary.ndof);
    println!("steps               {}", s.steps);
    println!(
        "rejected            {} error, {} Newton, {} evaluation",
        s.rejected_error, s.rejected_newton, s.rejected_evaluation
    );
    println!("evaluations         {}", s.evaluations);
    println!("iterations          {}", s.iterations);
    println!(
        "contraction         {:.1e} in the mean of {}, at most {:.1e}",
        s.contractions.mean(),
        s.contractions.count,
        s.contractions.largest
    );
    println!(
        "Jacobians           {}, factorizations {}, {} simplified, {} changes to the full matrix",
        s.jacobians, s.factorizations, s.simplified_factorizations, s.changes_to_full
    );
    println!("re-partitions       {}", s.reparametrizations);
    println!("recoveries          {}, corrections {}", s.recoveries, s.corrections);
    println!("step sizes          {:.2e} to {:.2e} s", s.smallest_step, s.largest_step);
    println!("seconds             {:.3}, {per_second:.4} per simulated second", s.run_seconds);
    println!(
        "residuals           position {:.1e}, velocity {:.1e}, worst over bound {:.1e}",
        s.position_residual, s.velocity_residual, s.residual_ratio
    );
    println!("energy imbalance    {:.2e} J of {:.2e} J", e.largest_imbalance, e.range);
    if let Some(bytes) = peak_memory() {
        let bodies = problem.model().bodies.len().max(1) as f64;
        let (all, each) = (bytes / 1e6, bytes / 1e3 / bodies);
        println!(
            "peak memory         {all:.1} MB, {each:.1} kB per body, program and outputs included"
        );
    }
    Ok(())
}

/// Most memory that this process has had so far, bytes, where the system tells it.
fn peak_memory() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    let kibibytes: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(1024.0 * kibibytes)
}
