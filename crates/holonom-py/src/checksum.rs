//! The checksum of a row of a result file.

use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use std::hash::Hasher;
use twox_hash::XxHash3_64;

/// XXH3 (64 bits) over parts, each after its length, as the signed integer that SQLite stores.
///
/// With the lengths no byte can move from one part to its neighbour unnoticed.
#[pyfunction]
pub(crate) fn checksum(parts: Vec<PyBackedBytes>) -> i64 {
    let mut hasher = XxHash3_64::new();
    for part in &parts {
        hasher.write(&(part.len() as u64).to_le_bytes());
        hasher.write(part);
    }
    hasher.finish().cast_signed()
}
