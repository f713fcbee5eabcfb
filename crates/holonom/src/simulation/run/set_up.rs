//! Everything that a run needs before its first step.

use super::unseen_turns::UnseenTurns;
use super::{Run, Start};
use crate::method::stepper::{Stepper, StepperStatistics};
use crate::method::{EquationForm, build_form, build_stepper};
use crate::model::{changing_motions, force_frequencies};
use crate::newton::MatrixOptions;
use crate::reduction::assembly::{AssemblyError, manifold_of};
use crate::reduction::{Manifold, ParametrizationKind};
use crate::simulation::carried_error::CarriedError;
use crate::simulation::checkpoint::{Checkpoint, foreign};
use crate::simulation::checks::{
    RunError, check_options, check_parametrization, check_tables, find_channels, set_accelerations,
    set_coordinates,
};
use crate::simulation::clock::{Elapsed, Stopwatch};
use crate::simulation::dense::{STEP_POWERS, Segments};
use crate::simulation::drift::Drift;
use crate::simulation::energy_scale::EnergyScale;
use crate::simulation::ledger::{QUARTERS, Quadrature, StepPowers, powers};
use crate::simulation::options::Options;
use crate::simulation::output::Output;
use crate::simulation::passage::Way;
use crate::simulation::problem::Problem;
use crate::simulation::recorder::Recorder;
use crate::simulation::reparametrization::new_chart;
use crate::simulation::slowness::Slowness;
use crate::simulation::stage_powers::StagePowers;
use crate::simulation::stall::Stall;
use crate::simulation::statistics::{EnergySummary, Statistics};
use crate::simulation::step_length;
use crate::simulation::trajectory::Sink;
use crate::system::State;
use crate::watch::checkpoint;
use std::time::Instant;

/// Numbers per coordinate in whose time a form of the equations is copied, about.
const COPIED: usize = 500;

/// The equations and the formula of a run, with what records its states.
pub(super) struct Machinery {
    pub(super) form: Box<dyn EquationForm>,
    pub(super) stepper: Box<dyn Stepper>,
    pub(super) recorder: Recorder,
    pub(super) inspector: Option<Recorder>,
    /// Room for a slope.
    pub(super) slope: Vec<f64>,
}

impl Machinery {
    /// Nothing is computed before, and nothing known but a consistent state whose factors the manifold holds.
    /// Movements are measured from the coordinates `origin`.
    pub(super) fn new(
        options: &Options,
        mut manifold: Manifold,
        state: &State,
        origin: &[f64],
    ) -> Self {
        manifold.share_among(&options.threads);
        // Copies of what is large take time, too.
        let copied = || checkpoint(COPIED * state.q.len());
        let (code, profile, tolerance) = (options.code, options.profile, options.tolerance);
        copied();
        let mut form = build_form(code, profile, manifold, tolerance, state, origin);
        copied();
        let matrix = MatrixOptions {
            source: options.jacobian,
            representation: options.newton,
            exact: code.needs_full_jacobian(),
            threads: options.threads.clone(),
        };
        let explicit = code.is_explicit();
        let asked = MatrixOptions { exact: matrix.exact && !explicit, ..matrix.clone() };
        if asked != MatrixOptions::default() || (explicit && options.fixed_step.is_none()) {
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
        copied();
        let recorder = Recorder::new(form.point(), dimension, form.integrates_powers());
        // Without unknowns no error can refuse a step.
        let manifold = &form.point().manifold;
        let watches =
            !fixed && manifold.chart().ndof() > 0 && !manifold.system().law_arguments().is_empty();
        let inspector = watches.then(|| recorder.clone());
        Self { form, stepper, recorder, inspector, slope: vec![0.0; dimension] }
    }
}

/// Everything that a run needs before its first step; it was asked for at `begun`.
pub(super) fn set_up<'a>(
    problem: &'a Problem,
    options: &'a Options,
    start: Start<'a>,
    sink: &'a mut dyn Sink,
    begun: Stopwatch,
) -> Result<Run<'a>, RunError> {
    let system = problem.system().clone();
    let file = problem.model().simulation.start_time.unwrap_or(0.0);
    let (given, started, taken_up) = match start {
        Start::Assembled => (None, file, None),
        Start::At(state) => (Some(problem.start_from(state)?), state.t, None),
        Start::Checkpoint(taken) => {
            taken.check(system.as_ref())?;
            let manifold = manifold_of(&system, &taken.chart.parametrization, &taken.state.q)
                .map_err(|failure| RunError::Assembly(AssemblyError::Evaluation(failure)))?;
            (Some((manifold, taken.state.clone())), taken.started, Some(taken))
        }
    };
    check_options(options, started, system.characteristic_length())?;
    check_parametrization(options.parametrization, system.as_ref())?;
    check_tables(problem.model(), started, options.end_time)?;
    let (mut manifold, mut state) = match given {
        Some(given) => given,
        None => {
            let assembled = problem.assemble()?;
            (assembled.manifold(), assembled.state.clone())
        }
    };
    // Assembly has chosen among the coordinates of the tree already.
    if taken_up.is_none()
        && options.parametrization != ParametrizationKind::Tree
        && let Some(chart) = new_chart(options, &manifold, &state)
            .map_err(|failure| RunError::Assembly(AssemblyError::Evaluation(failure)))?
    {
        manifold.set_chart(chart);
    }
    set_accelerations(options, &mut manifold)?;
    set_coordinates(options, &mut manifold, &state.q)?;
    let energy = system.energy(&state);
    let assembled = matches!(start, Start::Assembled);
    if assembled {
        state.ledger.initial = energy.kinetic + energy.potential;
    }
    let channels = find_channels(&system, &options.channels)?;
    let origin = taken_up.and_then(Checkpoint::origin).unwrap_or(&state.q).to_vec();
    let mut machinery = Machinery::new(options, manifold, &state, &origin);
    let dimension = machinery.form.dimension();
    if let Some(taken) = taken_up
        && !(taken.w.len() == dimension && machinery.stepper.recall(&taken.history))
    {
        return Err(foreign());
    }
    let assembly = begun.elapsed();
    let statistics = Statistics {
        assembly_seconds: assembly.wall.as_secs_f64(),
        assembly_cpu_seconds: assembly.processor.as_secs_f64(),
        smallest_step: f64::INFINITY,
        ..Statistics::default()
    };
    let mut output = Output::new(options, &state, channels);
    if options.stores_dense_output() {
        let powers = if machinery.form.integrates_powers() { 0 } else { STEP_POWERS };
        let degree = machinery.stepper.largest_degree();
        output.chunk.dense =
            Segments::with_room(system.as_ref(), &state, dimension, degree, powers);
    }
    let Machinery { form, stepper, recorder, inspector, slope } = machinery;
    let polynomial = (stepper.largest_degree() + 1) * dimension;
    // A step of prescribed length has no tolerance.
    let follows = form.second_order_split() > 0 && options.fixed_step.is_none();
    let laws = system.law_arguments().iter().map(|a| a.knots.len()).max();
    let drivers = step_length::drivers(system.as_ref(), [started, options.end_time]);
    // Implicit codes take long steps of what stiff springs and dampers hold: they are not limited.
    let explicit = stepper.explicit();
    let frequencies = if explicit { force_frequencies(problem.model()) } else { Vec::new() };
    let mut run = Run {
        options,
        model: problem.model(),
        condition_reference: 0.0,
        turned_over: None,
        unseen_turns: UnseenTurns::new(
            system.as_ref(),
            &frequencies,
            form.second_order_split(),
            dimension,
        ),
        start_residuals: (0.0, 0.0),
        residual_rows: vec![0.0; state.lambda.len()],
        energy: EnergySummary {
            start: energy,
            missing: state.ledger.imbalance(&energy),
            ..EnergySummary::default()
        },
        kinetic_range: (energy.kinetic, energy.kinetic),
        energy_scale: EnergyScale::new(problem.model(), system.as_ref(), &state),
        stage_powers: StagePowers::new(&drivers),
        drivers,
        drift: Drift::new(system.structure().sizes.bodies),
        changing: changing_motions(problem.model()),
        carried: follows.then(|| {
            let unknowns = [form.second_order_split(), dimension];
            CarriedError::new(unknowns, form.weights(), &state)
        }),
        turn_part: 1.0,
        powers: StepPowers::through([0.0; 2], &[], powers(&energy)),
        complete: true,
        passes_knot: false,
        delay: 0.0,
        // One at a cusp and one between knots.
        damped: Vec::with_capacity(2 * system.law_arguments().len()),
        inside: Vec::with_capacity(QUARTERS.len()),
        quadrature: Quadrature::default(),
        moments: Vec::with_capacity(super::powers::MOST_MOMENTS),
        stall: Stall::default(),
        output,
        recorder,
        inspector,
        w: vec![0.0; dimension],
        g: slope,
        w_end: vec![0.0; dimension],
        g_end: vec![0.0; dimension],
        scratch: [vec![0.0; dimension], vec![0.0; dimension]],
        passed: vec![0.0; dimension],
        missed: [vec![0.0; dimension], vec![0.0; dimension]],
        law_places: [(); 3].map(|()| Vec::with_capacity(system.law_arguments().len())),
        coefficients: Vec::with_capacity(laws.map_or(0, |_| polynomial)),
        way: Way::with_room(laws),
        row: state.clone(),
        state,
        form,
        stepper,
        statistics,
        slowness: Slowness::default(),
        warnings: Vec::new(),
        sink,
        started,
        origin,
        assembled,
        taken_up,
        work_before: StepperStatistics::default(),
        begun,
        looped: (Stopwatch::start(), Elapsed::default()),
        last_poll: Instant::now(),
        last_flush: Instant::now(),
        sink_time: Elapsed::default(),
        system,
    };
    if let Some(taken) = taken_up {
        run.go_on_counting(taken)?;
    }
    Ok(run)
}
