//! Threads that share one piece of work.

use rayon_core::{ThreadPool, ThreadPoolBuilder};
use std::sync::Arc;

/// Threads that may share one piece of work, or the calling thread alone (the default). Clones are the same
/// threads. How work is parted never depends on their number, so that results do not either.
#[derive(Debug, Clone, Default)]
pub struct Threads(Option<Arc<ThreadPool>>);

impl Threads {
    /// So many threads, 1 being the calling one.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn new(count: usize) -> Result<Self, ThreadsError> {
        if count <= 1 {
            return Ok(Self(None));
        }
        let name = |index| format!("holonom-{index}");
        let pool = ThreadPoolBuilder::new().num_threads(count).thread_name(name).build();
        pool.map(|pool| Self(Some(Arc::new(pool)))).map_err(|e| ThreadsError(e.to_string()))
    }

    /// Their number.
    pub fn count(&self) -> usize {
        self.0.as_ref().map_or(1, |pool| pool.current_num_threads())
    }

    /// Whether there is more than one.
    pub fn are_several(&self) -> bool {
        self.0.is_some()
    }

    /// Does work that is parted by [`Threads::join`] on these threads, which are woken once for all of it.
    pub fn share<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match &self.0 {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }

    /// Does both, perhaps at the same time.
    pub fn join<A: Send, B: Send>(
        &self,
        first: impl FnOnce() -> A + Send,
        second: impl FnOnce() -> B + Send,
    ) -> (A, B) {
        match &self.0 {
            Some(pool) => pool.join(first, second),
            None => (first(), second()),
        }
    }
}

/// Threads are equal if there are equally many: nothing else about them shows.
impl PartialEq for Threads {
    fn eq(&self, other: &Self) -> bool {
        self.count() == other.count()
    }
}

impl Eq for Threads {}

/// No thread to be had.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("no thread could be started: {0}")]
pub struct ThreadsError(String);
