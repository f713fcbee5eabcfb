//! Uses of a system beside a run: the stiffness spectrum.
