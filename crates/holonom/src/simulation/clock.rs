//! The time that a run takes; it is reported, and compared with the one limit on time, `max_seconds`.

use crate::threads::Threads;
use cpu_time::ThreadTime;
use std::ops::{AddAssign, Sub};
use std::time::{Duration, Instant};

/// Measures from the moment of its making.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stopwatch {
    wall: Instant,
    /// Absent where the system does not tell the processor time of a thread.
    processor: Option<ThreadTime>,
}

/// What a stopwatch has measured.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Elapsed {
    /// Time that has passed.
    pub(super) wall: Duration,
    /// Time in which a processor worked on this thread, or on others for it.
    pub(super) processor: Duration,
}

impl Stopwatch {
    pub(super) fn start() -> Self {
        Self { wall: Instant::now(), processor: ThreadTime::try_now().ok() }
    }

    /// Time that has passed.
    pub(super) fn passed(&self) -> Duration {
        self.wall.elapsed()
    }

    /// The same for the work of threads that stand beside this one, from their start on.
    pub(super) fn of_others(threads: &Threads) -> Elapsed {
        let worked = || ThreadTime::try_now().map(|now| now.as_duration()).unwrap_or_default();
        Elapsed { wall: Duration::ZERO, processor: threads.ask(worked).into_iter().sum() }
    }

    pub(super) fn elapsed(&self) -> Elapsed {
        let processor = self.processor.and_then(|begun| begun.try_elapsed().ok());
        Elapsed { wall: self.wall.elapsed(), processor: processor.unwrap_or_default() }
    }
}

impl AddAssign for Elapsed {
    fn add_assign(&mut self, other: Self) {
        self.wall += other.wall;
        self.processor += other.processor;
    }
}

impl Sub for Elapsed {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self {
            wall: self.wall.saturating_sub(other.wall),
            processor: self.processor.saturating_sub(other.processor),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test] // independent truth: a thread that sleeps does no work
    fn sleep_passes_but_takes_no_processor() {
        let begun = Stopwatch::start();
        std::thread::sleep(Duration::from_millis(40));
        let slept = begun.elapsed();
        assert!(slept.wall >= Duration::from_millis(40), "{slept:?}");
        assert!(slept.processor < Duration::from_millis(20), "{slept:?}");
        let mut sum = 0.0f64;
        while begun.elapsed().processor < Duration::from_millis(5) {
            sum = (sum + 1.0).sqrt();
        }
        let worked = begun.elapsed() - slept;
        assert!(sum > 0.0 && worked.processor > Duration::ZERO && worked.wall > Duration::ZERO);
    }
}
