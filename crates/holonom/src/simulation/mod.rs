//! The run: loop, output, energy, statistics, diagnosis.

mod carried_along;
mod carried_error;
mod carried_explicitly;
mod checkpoint;
mod checks;
mod choices;
mod clock;
mod dense;
mod diagnosis;
mod drift;
mod energy_scale;
mod ledger;
mod options;
mod output;
mod passage;
mod problem;
mod recorder;
mod reparametrization;
mod run;
mod second_run;
mod slowness;
mod stage_powers;
mod stall;
mod statistics;
mod step_length;
mod trajectory;
mod unseen_growth;
mod warnings;

pub use checkpoint::Checkpoint;
pub use checks::RunError;
pub use choices::{Choices, ToleranceParts, UnknownWord, unknown_method};
pub use dense::{ChartRecord, DenseOutput, Segments};
pub use options::{Options, OutputTimes};
pub use problem::{
    AccelerationSummary, EdgeCoordinate, EdgeSummary, ModelSummary, Problem, RedundantRow,
};
pub use run::{Summary, check_run, repeat, resume, run};
pub use slowness::{LimitedBy, Limits};
pub use statistics::{EnergySummary, RunWarning, Statistics, Status, StopReason};
pub use trajectory::{Chunk, EventKind, EventRecord, Flow, Memory, Sink, StepOutcome, StepRecord};
