//! Graph of bodies and joints: components, spanning tree, orderings; no numbers.
