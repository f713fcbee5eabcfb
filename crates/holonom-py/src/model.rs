//! `CoreModel`: a document with the problem compiled from it.

use crate::sink::Callbacks;
use crate::state::{Rows, foreign, rows};
use crate::watched::watched;
use crate::{ModelError, SimulationError, dense, geometry, report, state};
use holonom::analysis::spectrum;
use holonom::error::{Diagnostic, ModelErrors};
use holonom::io::{Document, Syntax};
use holonom::simulation::{
    Checkpoint, Choices, DenseOutput, Options, Problem, RunError, RunWarning, check_run, repeat,
    resume, run,
};
use holonom::system::Sample;
use holonom::watch::unwatched;
use pyo3::exceptions::{PyException, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Mutex, PoisonError};

/// A validated model.
#[pyclass(frozen, module = "holonom._core")]
pub(crate) struct CoreModel {
    document: Document,
    problem: Problem,
    warnings: Vec<Diagnostic>,
}

fn refused(errors: &ModelErrors) -> PyErr {
    ModelError::new_err(report::model_errors(errors))
}

fn not_run(error: RunError, document: &Document) -> PyErr {
    match error {
        RunError::Assembly(error) => {
            let path = error.path();
            let wanted: Vec<&str> = path.as_deref().into_iter().chain(error.item()).collect();
            let place = document.location_of(&wanted);
            ModelError::new_err(report::assembly_error(&error, place.as_ref()))
        }
        error => {
            let message = error.to_string();
            let text = report::refusal(error.code(), &message, error.item(), error.help());
            SimulationError::new_err(text)
        }
    }
}

impl CoreModel {
    /// Start, s, and options of a run from the choices of a call, perhaps from a state at `from`, s.
    fn resolve(&self, choices_json: &str, from: Option<f64>) -> PyResult<(f64, Options)> {
        let choices: Choices = serde_json::from_str(choices_json).map_err(|e| {
            let text = report::refusal(
                "simulation/option",
                &e.to_string(),
                None,
                "see `Options` for the choices of a run and their kinds",
            );
            SimulationError::new_err(text)
        })?;
        let model = self.problem.model();
        let refused = |error| not_run(error, &self.document);
        let start = choices.start_time(model, from).map_err(refused)?;
        Ok((start, choices.resolve(model, start).map_err(refused)?))
    }
}

/// Reads a model; `syntax` is "toml" or "json", `read` returns the text of an `extends` target,
/// `read_bytes` what the file of a mesh holds, and `on_stage` is called now and then.
#[pyfunction]
pub(crate) fn parse(
    py: Python<'_>,
    text: &str,
    syntax: &str,
    name: &str,
    read: Py<PyAny>,
    read_bytes: Py<PyAny>,
    on_stage: Option<Py<PyAny>>,
) -> PyResult<CoreModel> {
    let syntax = match syntax {
        "toml" => Syntax::Toml,
        "json" => Syntax::Json,
        other => {
            let message = format!("`syntax` is {other:?}; it must be \"toml\" or \"json\"");
            return Err(PyValueError::new_err(message));
        }
    };
    let raised = Mutex::new(None);
    let work = || {
        let mut resolver = |path: &str| read_by::<String>(&read, path, &raised);
        let mut reader = |path: &str| read_by::<Vec<u8>>(&read_bytes, path, &raised);
        let document = Document::parse(text, syntax, name, &mut resolver)?;
        let document = document.with_meshes(&mut reader)?;
        let (model, warnings) = document.build()?;
        let problem = Problem::new(model);
        document.check_channels(&problem)?;
        Ok(CoreModel { document, problem, warnings })
    };
    let found = watched(py, on_stage.as_ref(), work);
    if let Some(interruption) = raised.into_inner().unwrap_or_else(PoisonError::into_inner) {
        return Err(interruption);
    }
    found.whole()?.map_err(|e| refused(&e))
}

/// What a function of the caller reads from a path, or its reason not to. What is raised to end the caller, as by Ctrl-C,
/// is no such reason: it is kept in `raised`, and nothing more is read.
fn read_by<T>(read: &Py<PyAny>, path: &str, raised: &Mutex<Option<PyErr>>) -> Result<T, String>
where
    T: for<'a, 'py> FromPyObject<'a, 'py, Error = PyErr>,
{
    let call = |py: Python<'_>| {
        let mut raised = raised.lock().unwrap_or_else(PoisonError::into_inner);
        if raised.is_some() {
            return Err("interrupted".to_owned());
        }
        let found = read.call1(py, (path,)).and_then(|value| value.extract::<T>(py));
        found.map_err(|error| {
            let reason = error.value(py).to_string();
            if !error.is_instance_of::<PyException>(py) {
                *raised = Some(error);
            }
            reason
        })
    };
    unwatched(|| Python::attach(call))
}

#[pymethods]
impl CoreModel {
    fn with_values(&self, py: Python<'_>, values_json: &str) -> PyResult<Self> {
        let values: serde_json::Map<String, serde_json::Value> = serde_json::from_str(values_json)
            .map_err(|e| PyValueError::new_err(format!("values are not a JSON object: {e}")))?;
        let values: Vec<(String, serde_json::Value)> = values.into_iter().collect();
        let work = || {
            let document = self.document.with_values(&values)?;
            let (model, warnings) = document.build()?;
            let problem = self.problem.with_model(model);
            document.check_channels(&problem)?;
            Ok(Self { document, problem, warnings })
        };
        watched(py, None, work).whole()?.map_err(|e| refused(&e))
    }

    fn to_json(&self, py: Python<'_>) -> PyResult<String> {
        watched(py, None, || self.document.to_json()).whole()
    }

    fn to_plain_json(&self, py: Python<'_>) -> PyResult<String> {
        watched(py, None, || self.document.to_plain_json()).whole()?.map_err(|e| refused(&e))
    }

    fn hash(&self, py: Python<'_>) -> PyResult<String> {
        let text = self.document.to_json();
        py.import("hashlib")?
            .call_method1("sha256", (text.as_bytes(),))?
            .call_method0("hexdigest")?
            .extract()
    }

    fn defaults(&self) -> String {
        report::defaults(self.problem.model())
    }

    fn geometry(&self) -> String {
        geometry::geometry(self.problem.model())
    }

    fn road_heights(&self, tyre: &str, places: Vec<f64>) -> PyResult<Vec<f64>> {
        geometry::road_heights(self.problem.model(), tyre, &places)
            .ok_or_else(|| PyRuntimeError::new_err(format!("there is no tyre `{tyre}`")))
    }

    /// Name, unit, frame and shape of each; text would take longer than signals may wait.
    fn channels(&self) -> Vec<(&str, &str, &str, &[usize])> {
        let all = self.problem.channels().iter();
        all.map(|c| (c.name.as_str(), c.unit, c.frame, c.shape)).collect()
    }

    /// Unit, frame and shape of one of them.
    fn channel(&self, name: &str) -> Option<(&str, &str, &[usize])> {
        self.problem.channel(name).map(|c| (c.unit, c.frame, c.shape))
    }

    fn warnings(&self) -> String {
        report::warnings(&self.warnings)
    }

    fn check(
        &self,
        py: Python<'_>,
        spectrum: bool,
        on_stage: Option<Py<PyAny>>,
    ) -> PyResult<String> {
        let problem = &self.problem;
        let work = || {
            let mut options = Choices::of_file(problem.model())?;
            options.channels.clear(); // of patterns too; they were checked when the file was read
            let mut warnings = check_run(problem, &options)?;
            let assembled = problem.assemble()?;
            let values = spectrum.then(|| self::spectrum(assembled)).transpose();
            let values = values.unwrap_or_else(|why| {
                warnings.push(RunWarning {
                    code: "simulation/spectrum",
                    message: format!(
                        "the eigenvalues of the motion linearized at the initial state cannot be computed: {why}"
                    ),
                });
                None
            });
            let summary = problem.summary(assembled);
            Ok(report::check(problem, assembled, &summary, values, &warnings))
        };
        watched(py, on_stage.as_ref(), work)
            .whole()?
            .map_err(|error| not_run(error, &self.document))
    }

    fn options(
        &self,
        py: Python<'_>,
        choices_json: &str,
        start_time: Option<f64>,
    ) -> PyResult<Py<PyAny>> {
        let (start, options) = self.resolve(choices_json, start_time)?;
        report::to_python(py, &serde_json::json!(Choices::of(&options, start)))
    }

    #[pyo3(signature = (options_json, start, on_chunk, on_progress, on_stage, checkpoint=None, repeats=false))]
    #[expect(clippy::too_many_arguments, reason = "those of one call from Python")]
    fn simulate(
        &self,
        py: Python<'_>,
        options_json: &str,
        start: Option<&Bound<'_, PyDict>>,
        on_chunk: Py<PyAny>,
        on_progress: Py<PyAny>,
        on_stage: Py<PyAny>,
        checkpoint: Option<&str>,
        repeats: bool,
    ) -> PyResult<Py<PyAny>> {
        let refused = |error| not_run(error, &self.document);
        let taken_up = checkpoint.map(Checkpoint::from_text).transpose().map_err(refused)?;
        let sizes = self.problem.system().structure().sizes;
        let from = match start {
            None => None,
            Some(data) => {
                let mut states = Rows::read(data, &sizes, true)?.states;
                if states.len() != 1 {
                    let message =
                        format!("`start` holds {} states; it must hold one", states.len());
                    return Err(foreign(&message));
                }
                let mut state = states.pop();
                if !data.contains("ledger")?
                    && let Some(state) = &mut state
                {
                    // Without a history the balance begins here.
                    let energy = self.problem.system().energy(state);
                    state.ledger.initial = energy.kinetic + energy.potential;
                }
                state
            }
        };
        let (first, options) = self.resolve(options_json, from.as_ref().map(|state| state.t))?;
        // What goes on from a state begins where that is, whatever the model says.
        let given = taken_up.as_ref().map_or(from.is_some(), |taken| !taken.assembled());
        let problem = if given { self.problem.clone() } else { self.problem.starting_at(first) };
        let channels = options.channels.iter().filter_map(|name| problem.channel(name)).collect();
        let mut sink = Callbacks { on_chunk, on_progress, sizes, channels, error: None };
        let work = || match &taken_up {
            Some(checkpoint) => resume(&problem, &options, checkpoint, &mut sink),
            None if repeats => repeat(&problem, &options, from.as_ref(), &mut sink),
            None => run(&problem, &options, from.as_ref(), &mut sink),
        };
        let mut outcome = watched(py, Some(&on_stage), work);
        // Before the first step there is nothing that could be kept.
        outcome.done.take_if(|done| matches!(done, Err(RunError::Interrupted)));
        if let Some(error) = sink.error {
            return Err(error);
        }
        let summary = outcome.in_good_order()?.map_err(refused)?;
        report::to_python(
            py,
            &report::summary(
                &summary,
                problem.system().as_ref(),
                options.code,
                summary.end.t - first,
            ),
        )
    }

    fn dense_states<'py>(
        &self,
        py: Python<'py>,
        steps: &Bound<'py, PyDict>,
        times: Vec<f64>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let segments = dense::from_python(steps)?;
        let problem = &self.problem;
        let work = || {
            let mut dense = DenseOutput::new(problem, segments)?;
            times.into_iter().map(|t| dense.state(t)).collect::<Result<Vec<_>, _>>()
        };
        let states = watched(py, None, work).whole()?.map_err(|failure| {
            let text = report::refusal(
                failure.code,
                &failure.message,
                None,
                "ask for a time within the span of the result; rows of one whose steps are refused can be read, and runs started from them",
            );
            SimulationError::new_err(text)
        })?;
        state::to_python(py, &states, &problem.system().structure().sizes)
    }

    fn evaluate_channels<'py>(
        &self,
        py: Python<'py>,
        names: Vec<String>,
        state: &Bound<'py, PyDict>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let system = self.problem.system();
        let states = Rows::read(state, &system.structure().sizes, false)?.states;
        let out = PyDict::new(py);
        let samples: Vec<Sample<'_>> = states.iter().map(Sample::new).collect();
        for name in names {
            let channel = self
                .problem
                .channel(&name)
                .ok_or_else(|| PyRuntimeError::new_err(format!("there is no channel `{name}`")))?;
            let size = channel.size();
            let mut values = vec![0.0; size * states.len()];
            for (row, sample) in values.chunks_exact_mut(size).zip(&samples) {
                system.channel(&channel, sample, row);
            }
            out.set_item(&channel.name, rows(py, &values, states.len(), channel.shape)?)?;
        }
        Ok(out)
    }
}
