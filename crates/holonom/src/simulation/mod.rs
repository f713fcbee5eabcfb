//! The run: loop, output, energy, statistics, diagnosis.

mod ledger;
mod options;
mod problem;
mod run;
mod statistics;
mod trajectory;

pub use options::{
    DEFAULT_MAX_STEPS, DEFAULT_REPARTITION_FACTOR, DEFAULT_TOLERANCE, Options, OutputTimes,
};
pub use problem::{ModelSummary, Problem};
pub use run::{RunError, Summary, run};
pub use statistics::{EnergySummary, Statistics, Status, StopReason};
pub use trajectory::{Chunk, Flow, Memory, Sink, StepOutcome, StepRecord};
