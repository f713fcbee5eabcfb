//! Threads that share one piece of work.

use rayon_core::{ThreadPool, ThreadPoolBuilder};
use std::sync::{Arc, OnceLock};

/// Threads that may share one piece of work, or the calling thread alone (the default). Clones are the same
/// threads, which are started when there is work for them; where the system gives none, the calling one does all of
/// it. How work is parted never depends on their number, so that results do not either.
#[derive(Debug, Clone, Default)]
pub struct Threads {
    /// More than one.
    several: Option<(usize, Arc<OnceLock<Option<ThreadPool>>>)>,
}

impl Threads {
    /// So many threads, 1 being the calling one.
    pub fn new(count: usize) -> Self {
        Self { several: (count > 1).then(|| (count, Arc::default())) }
    }

    /// Their number.
    pub fn count(&self) -> usize {
        self.several.as_ref().map_or(1, |(count, _)| *count)
    }

    /// Whether there is more than one.
    pub fn are_several(&self) -> bool {
        self.several.is_some()
    }

    fn pool(&self) -> Option<&ThreadPool> {
        let (count, pool) = self.several.as_ref()?;
        let name = |index| format!("holonom-{index}");
        let build = || ThreadPoolBuilder::new().num_threads(*count).thread_name(name).build().ok();
        pool.get_or_init(build).as_ref()
    }

    /// Does work that is parted by [`Threads::join`] on these threads, which are woken once for all of it. The
    /// caller waits; a panic of the work is the caller's.
    pub fn share<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match self.pool() {
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
        match self.pool() {
            Some(pool) => pool.join(first, second),
            None => (first(), second()),
        }
    }

    /// Asks every thread that has been started beside the calling one.
    pub fn ask<R: Send>(&self, question: impl Fn() -> R + Sync) -> Vec<R> {
        let started = self.several.as_ref().and_then(|(_, pool)| pool.get()?.as_ref());
        started.map_or_else(Vec::new, |pool| pool.broadcast(|_| question()))
    }
}

/// Threads are equal if there are equally many: nothing else about them shows.
impl PartialEq for Threads {
    fn eq(&self, other: &Self) -> bool {
        self.count() == other.count()
    }
}

impl Eq for Threads {}
