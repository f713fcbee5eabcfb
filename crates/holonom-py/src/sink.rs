//! Hands chunks and progress to Python callbacks.

use crate::dense;
use crate::state::rows;
use holonom::simulation::{Chunk, Flow, Sink, StepOutcome};
use holonom::system::{Channel, Sizes};
use holonom::watch::unwatched;
use numpy::PyArray1;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

/// A sink of two callbacks. The first error of a callback ends the run and is kept.
pub(crate) struct Callbacks {
    pub(crate) on_chunk: Py<PyAny>,
    pub(crate) on_progress: Py<PyAny>,
    pub(crate) sizes: Sizes,
    pub(crate) channels: Vec<Channel>,
    pub(crate) error: Option<PyErr>,
}

impl Callbacks {
    fn chunk_dict<'py>(&self, py: Python<'py>, chunk: &Chunk) -> PyResult<Bound<'py, PyDict>> {
        let s = &self.sizes;
        let count = chunk.time.len();
        let dict = PyDict::new(py);
        dict.set_item("time", PyArray1::from_slice(py, &chunk.time))?;
        for (name, values, size) in [
            ("q", &chunk.q, s.coordinates),
            ("qd", &chunk.v, s.coordinates),
            ("qdd", &chunk.a, s.coordinates),
            ("lambda", &chunk.lambda, s.rows),
            ("z", &chunk.z, s.extra_states),
            ("winding", &chunk.winding, s.windings),
            ("ledger", &chunk.ledger, 3),
        ] {
            dict.set_item(name, rows(py, values, count, &[size])?)?;
        }
        let channels = PyDict::new(py);
        for (channel, values) in self.channels.iter().zip(&chunk.channels) {
            channels.set_item(&channel.name, rows(py, values, count, channel.shape)?)?;
        }
        dict.set_item("channels", channels)?;
        let steps = PyDict::new(py);
        let column = |f: &dyn Fn(&holonom::simulation::StepRecord) -> f64| {
            PyArray1::from_iter(py, chunk.steps.iter().map(f))
        };
        steps.set_item("t", column(&|r| r.t))?;
        steps.set_item("h", column(&|r| r.h))?;
        steps.set_item("error", column(&|r| r.error))?;
        let accepted = chunk.steps.iter().map(|r| i64::from(r.outcome == StepOutcome::Accepted));
        steps.set_item("accepted", PyArray1::from_iter(py, accepted))?;
        let causes = chunk.steps.iter().map(|r| match r.outcome {
            StepOutcome::Accepted => "",
            other => other.name(),
        });
        steps.set_item("cause", PyList::new(py, causes)?)?;
        let iterations = chunk.steps.iter().map(|r| i64::from(r.iterations));
        steps.set_item("iterations", PyArray1::from_iter(py, iterations))?;
        steps.set_item(
            "order",
            PyArray1::from_iter(py, chunk.steps.iter().map(|r| i64::from(r.order))),
        )?;
        steps.set_item("condition", column(&|r| r.condition))?;
        dict.set_item("steps", steps)?;
        let events: Vec<serde_json::Value> = chunk
            .events
            .iter()
            .map(|e| serde_json::json!({"time": e.t, "kind": e.kind.name()}))
            .collect();
        if !(chunk.dense.is_empty() && chunk.dense.charts.is_empty()) {
            dict.set_item("dense", dense::to_python(py, &chunk.dense)?)?;
        }
        if let Some(checkpoint) = &chunk.checkpoint {
            dict.set_item("checkpoint", checkpoint.to_text())?;
        }
        dict.set_item("events", serde_json::Value::from(events).to_string())?;
        Ok(dict)
    }

    fn keep(&mut self, error: PyErr) -> String {
        let text = error.to_string();
        self.error.get_or_insert(error);
        text
    }
}

impl Sink for Callbacks {
    fn chunk(&mut self, chunk: &Chunk) -> Result<(), String> {
        let write = |py: Python<'_>| {
            let result = self.chunk_dict(py, chunk).and_then(|d| self.on_chunk.call1(py, (d,)));
            result.map(drop).map_err(|e| self.keep(e))
        };
        unwatched(|| Python::attach(write))
    }

    fn progress(&mut self, t: f64, step_size: f64, steps: u64) -> Flow {
        let tell = |py: Python<'_>| {
            let result = py
                .check_signals()
                .and_then(|()| self.on_progress.call1(py, (t, step_size, steps)).map(drop));
            match result {
                Ok(()) => Flow::Continue,
                Err(error) => {
                    // Ctrl-C ends the run in good order; anything else is raised afterwards.
                    if !error.is_instance_of::<PyKeyboardInterrupt>(py) {
                        self.keep(error);
                    }
                    Flow::Interrupt
                }
            }
        };
        unwatched(|| Python::attach(tell))
    }
}
