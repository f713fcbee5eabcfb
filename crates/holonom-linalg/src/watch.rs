//! Long work that can be watched and given up.
//!
//! Work passes checkpoints with what it has done since the last one; a look at the clock follows when that adds
//! up to a fraction of a millisecond, so that small work never looks. Work is given up by unwinding to the
//! innermost [`observed`] or [`within`]: it has no result, and no function on the way has to carry that. What
//! it had borrowed may be left halfway; its owner decides what of it is still read.

use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::rc::Rc;
use std::time::{Duration, Instant};

/// Numbers computed between two looks at the clock; each takes some nanoseconds.
const LOOK: usize = 50_000;
/// Numbers that could be computed while something with a name is read, checked or placed, about.
pub const NAMED: usize = 300;

/// Why work was given up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum GivenUp {
    /// The observer asked for it.
    #[error("interrupted")]
    Asked,
    /// Its time was over.
    #[error("out of time")]
    OutOfTime,
}

/// Whether to go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flow {
    /// Go on.
    Continue,
    /// Stop as soon as possible and keep what was computed.
    Interrupt,
}

/// Told now and then which stage the work of this thread is in.
pub type Observer = Rc<dyn Fn(&'static str) -> Flow>;

/// How the work of a thread is watched.
#[derive(Clone, Default)]
struct Watch {
    observer: Option<(Observer, Duration)>,
    asked: Option<Instant>,
    deadline: Option<Instant>,
    stage: &'static str,
}

thread_local! {
    static LEFT: Cell<usize> = const { Cell::new(LOOK) };
    static WATCH: RefCell<Watch> = RefCell::default();
}

/// Does work on this thread while `observer` is asked `every` so often whether to go on.
///
/// # Errors
/// [`GivenUp`] when it was not finished.
pub fn observed<T>(
    every: Duration,
    observer: Observer,
    work: impl FnOnce() -> T,
) -> Result<T, GivenUp> {
    let change = |watch: &mut Watch| {
        (watch.observer, watch.asked) = (Some((observer, every)), Some(Instant::now()));
    };
    guarded(change, work)
}

/// Does work on this thread that is given up after `limit`, or earlier where an outer limit is.
///
/// # Errors
/// [`GivenUp`] when it was not finished; also where the observer of an outer call asked for it.
pub fn within<T>(limit: Option<Duration>, work: impl FnOnce() -> T) -> Result<T, GivenUp> {
    let end = limit.and_then(|limit| Instant::now().checked_add(limit));
    let change = |watch: &mut Watch| {
        watch.deadline = watch.deadline.into_iter().chain(end).min();
    };
    guarded(change, work)
}

/// Does work of others, such as a callback of the caller, that nobody watches: what it calls here is not given up for
/// the work around it.
pub fn unwatched<T>(work: impl FnOnce() -> T) -> T {
    let _restored = Restored(WATCH.take());
    work()
}

/// Does work that observers know by this name.
pub fn stage<T>(name: &'static str, work: impl FnOnce() -> T) -> T {
    let before = WATCH.with_borrow_mut(|watch| std::mem::replace(&mut watch.stage, name));
    let done = work();
    WATCH.with_borrow_mut(|watch| watch.stage = before);
    done
}

/// Called by work that has computed so many numbers since the last call: here it is given up.
#[inline]
pub fn checkpoint(numbers: usize) {
    match LEFT.get().checked_sub(numbers) {
        Some(left) => LEFT.set(left),
        None => look(),
    }
}

#[cold]
fn look() {
    LEFT.set(LOOK);
    let Watch { observer, asked, deadline, stage } = WATCH.with_borrow(Watch::clone);
    if observer.is_none() && deadline.is_none() {
        return;
    }
    let now = Instant::now();
    if deadline.is_some_and(|deadline| now >= deadline) {
        resume_unwind(Box::new(GivenUp::OutOfTime));
    }
    let Some((observer, every)) = observer else { return };
    if asked.is_none_or(|asked| now - asked >= every) {
        // Not while the cell is borrowed: an observer may do watched work itself.
        let flow = observer(stage);
        WATCH.with_borrow_mut(|watch| watch.asked = Some(Instant::now()));
        if flow == Flow::Interrupt {
            resume_unwind(Box::new(GivenUp::Asked));
        }
    }
}

/// Restores the watch of the work around when its own ends, in whatever way.
struct Restored(Watch);

impl Drop for Restored {
    fn drop(&mut self) {
        WATCH.set(std::mem::take(&mut self.0));
    }
}

fn guarded<T>(change: impl FnOnce(&mut Watch), work: impl FnOnce() -> T) -> Result<T, GivenUp> {
    let _restored = Restored(WATCH.with_borrow(Watch::clone));
    WATCH.with_borrow_mut(change);
    catch_unwind(AssertUnwindSafe(work)).map_err(|payload| match payload.downcast::<GivenUp>() {
        Ok(given_up) => *given_up,
        Err(panic) => resume_unwind(panic),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Work of so many checkpoints; returns how many it passed.
    fn passed(most: usize) -> usize {
        for _ in 0..most {
            checkpoint(LOOK + 1);
        }
        most
    }

    fn never() -> Observer {
        Rc::new(|_| Flow::Interrupt)
    }

    #[test]
    fn work_that_nobody_watches_is_finished() {
        assert_eq!(passed(10), 10);
        assert_eq!(within(None, || passed(10)), Ok(10));
    }

    #[test]
    fn callbacks_are_not_given_up_for_the_work_around_them() {
        let work = || (unwatched(|| passed(10)), passed(1));
        assert_eq!(observed(Duration::ZERO, never(), work), Err(GivenUp::Asked));
        assert_eq!(observed(Duration::ZERO, never(), || unwatched(|| passed(10))), Ok(10));
    }

    #[test]
    fn an_observer_ends_work_at_the_checkpoint_it_chooses_and_is_told_the_stage() {
        let seen = Rc::new(RefCell::new(Vec::new()));
        let told = seen.clone();
        let observer: Observer = Rc::new(move |stage| {
            told.borrow_mut().push(stage);
            if told.borrow().len() == 4 { Flow::Interrupt } else { Flow::Continue }
        });
        let count = Cell::new(0);
        let work = || {
            stage("outer", || -> usize {
                stage("inner", || passed(2));
                loop {
                    passed(1);
                    count.set(count.get() + 1);
                }
            })
        };
        assert_eq!(observed(Duration::ZERO, observer, work), Err(GivenUp::Asked));
        assert_eq!(*seen.borrow(), ["inner", "inner", "outer", "outer"]);
        assert_eq!(count.get(), 1);
        assert_eq!(passed(10), 10); // nobody watches any more
    }

    #[test]
    fn work_is_given_up_when_its_time_or_that_of_the_work_around_is_over() {
        let over = Some(Duration::ZERO);
        assert_eq!(within(over, || passed(1)), Err(GivenUp::OutOfTime));
        let long = Some(Duration::from_secs(1000));
        assert_eq!(within(over, || within(long, || passed(1))), Ok(Err(GivenUp::OutOfTime)));
        // An interruption from outside ends the innermost work, whose owner keeps what there is.
        let outcome = observed(Duration::ZERO, never(), || within(long, || passed(1)));
        assert_eq!(outcome, Ok(Err(GivenUp::Asked)));
    }

    #[test]
    fn a_panic_goes_on_and_leaves_no_watch_behind() {
        let outcome = catch_unwind(|| {
            observed(Duration::from_secs(1000), never(), || resume_unwind(Box::new("a defect")))
        });
        let payload = outcome.err().and_then(|payload: Box<dyn std::any::Any + Send>| {
            payload.downcast_ref::<&str>().map(|text| (*text).to_owned())
        });
        assert_eq!(payload.as_deref(), Some("a defect"));
        assert_eq!(passed(10), 10);
    }
}
