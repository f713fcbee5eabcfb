//! Everything that a run needs before its first step.

use super::Run;
use crate::method::{build_state_space, build_stepper};
use crate::newton::MatrixOptions;
use crate::reduction::assembly::AssemblyError;
use crate::simulation::checks::{
    RunError, check_options, check_tables, find_channels, set_accelerations, set_coordinates,
};
use crate::simulation::clock::{Elapsed, Stopwatch};
use crate::simulation::dense::{STEP_POWERS, Segments};
use crate::simulation::drift::Drift;
use crate::simulation::energy_scale::EnergyScale;
use crate::simulation::ledger::{StepPowers, powers};
use crate::simulation::options::Options;
use crate::simulation::output::Output;
use crate::simulation::problem::Problem;
use crate::simulation::recorder::Recorder;
use crate::simulation::reparametrization::new_chart;
use crate::simulation::slowness::Slowness;
use crate::simulation::statistics::{EnergySummary, Statistics};
use crate::simulation::trajectory::Sink;
use crate::system::State;
use crate::watch::checkpoint;
use std::time::Instant;

/// Numbers per coordinate in whose time a form of the equations is copied, about.
const COPIED: usize = 500;

/// Everything that a run needs before its first step; it was asked for at `begun`.
pub(super) fn set_up<'a>(
    problem: &Problem,
    options: &'a Options,
    from: Option<&State>,
    sink: &'a mut dyn Sink,
    begun: Stopwatch,
) -> Result<Run<'a>, RunError> {
    let system = problem.system().clone();
    // Copies of what is large take time, too.
    let copied = || checkpoint(COPIED * system.structure().sizes.coordinates);
    let given = from.map(|state| problem.start_from(state)).transpose()?;
    let start = from.map_or(problem.model().simulation.start_time.unwrap_or(0.0), |state| state.t);
    check_options(options, start, system.characteristic_length())?;
    check_tables(problem.model(), start, options.end_time)?;
    let (mut manifold, mut state) = match given {
        Some(given) => given,
        None => {
            let assembled = problem.assemble()?;
            (assembled.manifold.clone(), assembled.state.clone())
        }
    };

    if let Some(chart) = new_chart(options, &manifold, &state)
        .map_err(|failure| RunError::Assembly(AssemblyError::Evaluation(failure)))?
    {
        manifold.set_chart(chart);
    }
    set_accelerations(options, &mut manifold)?;
    set_coordinates(options, &mut manifold, &state.q)?;
    let energy = system.energy(&state);
    if from.is_none() {
        state.ledger.initial = energy.kinetic + energy.potential;
    }
    let channels = find_channels(&system, &options.channels)?;
    let (code, profile, tolerance) = (options.code, options.profile, options.tolerance);
    copied();
    let mut form = build_state_space(code, profile, manifold, tolerance, &state);
    copied();
    let matrix = MatrixOptions {
        source: options.jacobian,
        representation: options.newton,
        threads: options.threads.clone(),
    };
    if matrix != MatrixOptions::default() {
        form.set_matrix(matrix);
    }
    let dimension = form.dimension();
    let fixed = options.fixed_step.is_some();
    let stepper = build_stepper(
        code,
        profile,
        form.as_mut(),
        tolerance,
        options.newmark,
        fixed,
        options.max_step,
    );
    let assembly = begun.elapsed();
    let statistics = Statistics {
        assembly_seconds: assembly.wall.as_secs_f64(),
        assembly_cpu_seconds: assembly.processor.as_secs_f64(),
        smallest_step: f64::INFINITY,
        ..Statistics::default()
    };
    let mut output = Output::new(options, &state, channels);
    if options.stores_dense_output() {
        let powers = if form.integrates_powers() { 0 } else { STEP_POWERS };
        output.chunk.dense = Segments::with_room(
            system.as_ref(),
            &state,
            dimension,
            stepper.largest_degree(),
            powers,
        );
    }
    copied();
    Ok(Run {
        options,
        condition_reference: 0.0,
        start_residuals: (0.0, 0.0),
        energy: EnergySummary { start: energy, ..EnergySummary::default() },
        kinetic_range: (energy.kinetic, energy.kinetic),
        energy_scale: EnergyScale::new(problem.model(), system.as_ref(), &state),
        drift: Drift::new(system.structure().sizes.bodies),
        powers: StepPowers { at: [[0.0; 2], [0.0; 2], powers(&energy)] },
        middle: None,
        output,
        recorder: Recorder::new(form.point(), dimension, form.integrates_powers()),
        w: vec![0.0; dimension],
        g: vec![0.0; dimension],
        w_end: vec![0.0; dimension],
        g_end: vec![0.0; dimension],
        scratch: [vec![0.0; dimension], vec![0.0; dimension]],
        row: state.clone(),
        state,
        form,
        stepper,
        statistics,
        slowness: Slowness::default(),
        warnings: Vec::new(),
        sink,
        begun,
        last_poll: Instant::now(),
        last_flush: Instant::now(),
        sink_time: Elapsed::default(),
        system,
    })
}
