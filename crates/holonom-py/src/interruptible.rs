//! Long work that Ctrl-C ends at once.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::Mutex;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

/// Signals are looked for so often.
const PATIENCE: Duration = Duration::from_millis(50);

/// Does work on a thread of its own; `look` is called while it lasts, and what it raises is raised at once. The
/// work then goes on unheard until it is done: it must change nothing that others see.
pub(crate) fn interruptible<T: Send + 'static>(
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
