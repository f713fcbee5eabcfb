//! The equations of motion in one choice of generalized coordinates.
