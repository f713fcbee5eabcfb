//! Output rows of a run: when they are due and the chunk that collects them.

use super::options::{Options, OutputTimes};
use super::trajectory::Chunk;
use crate::system::{Channel, Sample, State, System};

/// An output time beyond an end of the run by this part of it is that end.
pub(super) const OUTPUT_SLACK: f64 = 1e-12;
/// Numbers in a chunk of rows, and the most rows of a small model.
const CHUNK_NUMBERS: usize = 1 << 19;
const CHUNK_ROWS: usize = 256;
/// Attempts in a chunk, so that a run without output rows reports its steps too.
pub(super) const CHUNK_STEPS: usize = 1024;

/// Output rows that are still to come.
pub(super) struct Output {
    times: OutputTimes,
    start: f64,
    end: f64,
    next: usize,
    /// Time of the last row, s; NaN before the first.
    last: f64,
    channels: Vec<Channel>,
    pub(super) chunk: Chunk,
    values: Vec<f64>,
    /// Rows of a full chunk.
    rows: usize,
}

impl Output {
    /// Output from a start state; the chunk gets room for all that comes before it is handed out.
    pub(super) fn new(options: &Options, start: &State, channels: Vec<Channel>) -> Self {
        let largest = channels.iter().map(Channel::size).max().unwrap_or(0);
        let start_time = start.t;
        let expected = match &options.output {
            OutputTimes::Interval(interval) => {
                ((options.end_time - start_time) / interval).min(CHUNK_ROWS as f64) as usize + 2
            }
            OutputTimes::Listed(times) => times.len(),
        };
        let (width, each) = (start.width(), channels.iter().map(Channel::size).sum::<usize>());
        let rows = (CHUNK_NUMBERS / (width + each).max(1)).clamp(1, CHUNK_ROWS);
        let chunk = Chunk::with_room(start, &channels, expected.min(rows + 1));
        Self {
            times: options.output.clone(),
            start: start_time,
            end: options.end_time,
            next: 0,
            last: f64::NAN,
            channels,
            chunk,
            values: vec![0.0; largest],
            rows,
        }
    }

    /// Rows so far, and the time of the last one, s.
    pub(super) fn position(&self) -> (usize, Option<f64>) {
        (self.next, Some(self.last).filter(|t| !t.is_nan()))
    }

    /// The rows of a run that began at `start`, s, from a place among them on.
    pub(super) fn go_on(&mut self, start: f64, (next, last): (usize, Option<f64>)) {
        (self.start, self.next, self.last) = (start, next, last.unwrap_or(f64::NAN));
    }

    /// Whether the rows are to be handed out.
    pub(super) fn is_full(&self) -> bool {
        self.chunk.time.len() >= self.rows
    }

    /// Next output time; infinite when there is none.
    pub(super) fn time(&self) -> f64 {
        match &self.times {
            OutputTimes::Interval(interval) => {
                let last =
                    ((self.end - self.start) / interval * (1.0 + OUTPUT_SLACK)).floor() as usize;
                // The last multiple may be beside the end by round-off.
                let reached = self.end - OUTPUT_SLACK * (self.end - self.start);
                let time = self.start + self.next.min(last) as f64 * interval;
                if self.next <= last {
                    if time < reached { time } else { self.end }
                } else if self.next == last + 1 && time < reached {
                    self.end
                } else {
                    f64::INFINITY
                }
            }
            OutputTimes::Listed(times) => {
                times.get(self.next).map_or(f64::INFINITY, |t| t.min(self.end))
            }
        }
    }

    pub(super) fn push(&mut self, system: &dyn System, state: &State) {
        self.chunk.push(state);
        let sample = Sample::new(state);
        for (channel, rows) in self.channels.iter().zip(&mut self.chunk.channels) {
            let values = &mut self.values[..channel.size()];
            system.channel(channel, &sample, values);
            rows.extend_from_slice(values);
        }
        self.next += 1;
        self.last = state.t;
    }

    /// One more row for the state at which a run ends early, if it is none yet.
    pub(super) fn push_last(&mut self, system: &dyn System, state: &State) {
        if self.last != state.t {
            self.push(system, state);
        }
    }
}
