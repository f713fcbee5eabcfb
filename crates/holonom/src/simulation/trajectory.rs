//! What a run hands out: chunks of states and steps to a sink, and a summary at the end.

use super::checkpoint::Checkpoint;
use super::dense::Segments;
use super::output::CHUNK_STEPS;
use super::run::MAX_REJECTIONS;
use crate::system::{Channel, State};

/// Events that a chunk has room for from the start.
const CHUNK_EVENTS: usize = 64;

/// A piece of a trajectory: rows of states at output times, and the steps attempted meanwhile.
#[derive(Debug, Clone, Default)]
pub struct Chunk {
    /// Output times, s.
    pub time: Vec<f64>,
    /// Rows of generalized coordinates.
    pub q: Vec<f64>,
    /// Rows of generalized velocities.
    pub v: Vec<f64>,
    /// Rows of generalized accelerations.
    pub a: Vec<f64>,
    /// Rows of multipliers.
    pub lambda: Vec<f64>,
    /// Rows of extra states.
    pub z: Vec<f64>,
    /// Rows of windings.
    pub winding: Vec<f64>,
    /// Rows of the energy ledger: initial, dissipated, supplied, J.
    pub ledger: Vec<f64>,
    /// Per asked channel, its rows.
    pub channels: Vec<Vec<f64>>,
    /// Attempted steps.
    pub steps: Vec<StepRecord>,
    /// What happened at single times.
    pub events: Vec<EventRecord>,
    /// Accepted steps with what the states inside them are made of; empty without dense output.
    pub dense: Segments,
    /// Where the run can be taken up again: at the end of this chunk.
    pub checkpoint: Option<Checkpoint>,
}

impl Chunk {
    /// An empty chunk with room for `rows` states like `state`, and for the attempts and events of a
    /// chunk.
    pub(super) fn with_room(state: &State, channels: &[Channel], rows: usize) -> Self {
        let room = |width: usize| Vec::with_capacity(rows * width);
        Self {
            time: room(1),
            q: room(state.q.len()),
            v: room(state.v.len()),
            a: room(state.a.len()),
            lambda: room(state.lambda.len()),
            z: room(state.z.len()),
            winding: room(state.winding.len()),
            ledger: room(3),
            channels: channels.iter().map(|channel| room(channel.size())).collect(),
            steps: Vec::with_capacity(CHUNK_STEPS + MAX_REJECTIONS as usize),
            events: Vec::with_capacity(CHUNK_EVENTS),
            dense: Segments::default(),
            checkpoint: None,
        }
    }

    pub(super) fn push(&mut self, state: &State) {
        self.time.push(state.t);
        self.q.extend_from_slice(&state.q);
        self.v.extend_from_slice(&state.v);
        self.a.extend_from_slice(&state.a);
        self.lambda.extend_from_slice(&state.lambda);
        self.z.extend_from_slice(&state.z);
        self.winding.extend_from_slice(&state.winding);
        let ledger = &state.ledger;
        self.ledger.extend([ledger.initial, ledger.dissipated, ledger.supplied]);
    }

    pub(super) fn clear(&mut self) {
        self.time.clear();
        for rows in [
            &mut self.q,
            &mut self.v,
            &mut self.a,
            &mut self.lambda,
            &mut self.z,
            &mut self.winding,
            &mut self.ledger,
        ] {
            rows.clear();
        }
        self.channels.iter_mut().for_each(Vec::clear);
        self.steps.clear();
        self.events.clear();
        self.dense.clear();
        self.checkpoint = None;
    }
}

/// One attempted step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepRecord {
    /// Start of the step, s.
    pub t: f64,
    /// Length, s.
    pub h: f64,
    /// Scaled error estimate; 1 is on tolerance, infinite if not reached.
    pub error: f64,
    /// Why it was rejected.
    pub outcome: StepOutcome,
    /// Newton iterations.
    pub iterations: u32,
    /// Order of the formula.
    pub order: u32,
    /// Estimate of the condition of [G; P] at the end, 0 for rejected steps.
    pub condition: f64,
}

/// Something that happened at one time of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EventRecord {
    /// s.
    pub t: f64,
    /// What happened.
    pub kind: EventKind,
}

/// What happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EventKind {
    /// A kink of a time function was reached exactly; integration started afresh.
    Breakpoint,
    /// Other coordinates became the independent ones.
    Reparametrization,
}

impl EventKind {
    /// Name in results.
    pub fn name(self) -> &'static str {
        match self {
            Self::Breakpoint => "breakpoint",
            Self::Reparametrization => "reparametrization",
        }
    }
}

/// Outcome of an attempt.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StepOutcome {
    /// Accepted.
    Accepted,
    /// Rejected: error too large.
    Error,
    /// Rejected: the iteration diverged or was too slow.
    Newton,
    /// Rejected: the equations could not be evaluated there.
    Evaluation,
}

impl StepOutcome {
    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Accepted => "accepted",
            Self::Error => "error",
            Self::Newton => "newton",
            Self::Evaluation => "evaluation",
        }
    }
}

/// Whether to go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flow {
    /// Go on.
    Continue,
    /// Stop as soon as possible and keep what was computed.
    Interrupt,
}

/// Receives a trajectory while it is computed.
pub trait Sink {
    /// Takes a chunk.
    ///
    /// # Errors
    /// A message when it cannot be kept; the run then stops.
    fn chunk(&mut self, chunk: &Chunk) -> Result<(), String>;

    /// Told from time to time where the run is; at least every 0.1 s of wall time between steps.
    fn progress(&mut self, t: f64, step_size: f64, steps: u64) -> Flow;
}

/// Keeps everything in memory.
#[derive(Debug, Clone, Default)]
pub struct Memory {
    /// All chunks joined.
    pub all: Chunk,
}

impl Sink for Memory {
    fn chunk(&mut self, chunk: &Chunk) -> Result<(), String> {
        let all = &mut self.all;
        all.time.extend_from_slice(&chunk.time);
        all.q.extend_from_slice(&chunk.q);
        all.v.extend_from_slice(&chunk.v);
        all.a.extend_from_slice(&chunk.a);
        all.lambda.extend_from_slice(&chunk.lambda);
        all.z.extend_from_slice(&chunk.z);
        all.winding.extend_from_slice(&chunk.winding);
        all.ledger.extend_from_slice(&chunk.ledger);
        all.channels.resize(chunk.channels.len(), Vec::new());
        for (all, new) in all.channels.iter_mut().zip(&chunk.channels) {
            all.extend_from_slice(new);
        }
        all.steps.extend_from_slice(&chunk.steps);
        all.events.extend_from_slice(&chunk.events);
        all.dense.extend(&chunk.dense);
        all.checkpoint = chunk.checkpoint.clone().or(all.checkpoint.take());
        Ok(())
    }

    fn progress(&mut self, _: f64, _: f64, _: u64) -> Flow {
        Flow::Continue
    }
}
