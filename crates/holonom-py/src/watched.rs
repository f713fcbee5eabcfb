//! Long work that Ctrl-C ends.

use holonom::watch::{Flow, Observer, observed, unwatched};
use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError};
use pyo3::prelude::*;
use std::rc::Rc;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Signals are looked for so often.
const PATIENCE: Duration = Duration::from_millis(50);

/// What work gave, and what was raised while it was watched: `None` where it was given up for that.
pub(crate) struct Watched<T> {
    pub(crate) done: Option<T>,
    pub(crate) raised: Option<PyErr>,
}

impl<T> Watched<T> {
    /// What work gave; what was raised ends it.
    pub(crate) fn whole(self) -> PyResult<T> {
        match (self.raised, self.done) {
            (Some(raised), _) => Err(raised),
            (None, Some(done)) => Ok(done),
            (None, None) => Err(PyRuntimeError::new_err("the engine gave up unasked")),
        }
    }

    /// The same where work that was interrupted has ended in good order.
    pub(crate) fn in_good_order(mut self) -> PyResult<T> {
        Python::attach(|py| {
            let interrupted = |raised: &mut PyErr| raised.is_instance_of::<PyKeyboardInterrupt>(py);
            if self.done.is_some() {
                self.raised.take_if(interrupted);
            }
        });
        self.whole()
    }
}

/// Does work without the interpreter's lock. Meanwhile signals are looked for and `on_stage` is called with
/// the stage that the work is in; what either raises ends the work.
pub(crate) fn watched<T: Send>(
    py: Python<'_>,
    on_stage: Option<&Py<PyAny>>,
    work: impl FnOnce() -> T + Send,
) -> Watched<T> {
    let raised = Arc::new(Mutex::new(None));
    let kept = raised.clone();
    let on_stage = on_stage.map(|call| call.clone_ref(py));
    let done = py.detach(move || {
        let ask = move |stage: &str| {
            Python::attach(|py| {
                py.check_signals()?;
                on_stage.as_ref().map_or(Ok(()), |call| call.call1(py, (stage,)).map(drop))
            })
        };
        let observer: Observer = Rc::new(move |stage| match unwatched(|| ask(stage)) {
            Ok(()) => Flow::Continue,
            Err(error) => {
                kept.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
                Flow::Interrupt
            }
        });
        observed(PATIENCE, observer, work).ok()
    });
    let raised = raised.lock().unwrap_or_else(PoisonError::into_inner).take();
    Watched { done, raised }
}
