//! Matrices for Holonom. This crate knows blocks, patterns and permutations; it knows no bodies.
