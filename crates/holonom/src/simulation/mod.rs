//! The run: loop, output, energy, channels, statistics, diagnosis.
