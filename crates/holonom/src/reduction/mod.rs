//! From dependent to independent coordinates.
