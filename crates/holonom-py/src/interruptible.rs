//! Long work that Ctrl-C ends at once.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Signals are looked for so often.
const PATIENCE: Duration = Duration::from_millis(50);

/// Does work on a thread of its own; `look` is called while it lasts, and what it raises is raised at once. The
/// work then goes on unheard until it is done: it must change nothing that others see, and ask nothing of Python
/// once the flag it is given is set.
pub(crate) fn interruptible<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce(&AtomicBool) -> T + Send + 'static,
    look: impl FnMut() -> PyResult<()>,
) -> PyResult<T> {
    let left = Arc::new(AtomicBool::new(false));
    let flag = left.clone();
    let outcome = wait_for(py, move || work(&flag), look);
    left.store(outcome.is_err(), Ordering::Release);
    outcome
}

fn wait_for<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> T + Send + 'static,
    mut look: impl FnMut() -> PyResult<()>,
) -> PyResult<T> {
    let (send, receive) = channel();
    let receive = Mutex::new(receive); // only to be lent to `detach`
    // Nobody listens after an interruption.
    std::thread::spawn(move || drop(send.send(work())));
    loop {
        let wait = || match receive.lock() {
            Ok(receive) => receive.recv_timeout(PATIENCE),
            Err(_) => Err(RecvTimeoutError::Disconnected),
        };
        match py.detach(wait) {
            Ok(done) => return Ok(done),
            Err(RecvTimeoutError::Timeout) => {
                py.check_signals()?;
                look()?;
            }
            Err(RecvTimeoutError::Disconnected) => {
                return Err(PyRuntimeError::new_err("the engine stopped unexpectedly"));
            }
        }
    }
}
