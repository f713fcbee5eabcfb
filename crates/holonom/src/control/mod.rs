//! Decisions of a run as pure functions: error norms, step size, iteration stopping.
