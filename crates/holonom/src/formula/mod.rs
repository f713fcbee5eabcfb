//! Integration formulas as data.
