//! What a model file may hold. Beyond these sizes a file is a mistake or an attack, not a model.

/// Bytes of one file.
pub const FILE_BYTES: usize = 64 << 20;
/// Tables and lists inside each other.
pub const NESTING: usize = 64;
/// Files that extend each other in a row.
pub const EXTENDS_DEPTH: usize = 16;
/// Items of one collection: bodies, joints, forces, …
pub const ITEMS: usize = 100_000;
/// Entries of one list, such as the points of a table.
pub const LIST_ENTRIES: usize = 1_000_000;
/// Bytes of one text.
pub const TEXT_BYTES: usize = 64 << 10;
/// Characters of a name.
pub const NAME_CHARACTERS: usize = 128;
/// Largest magnitude of a number, so that squares and products of numbers stay finite.
pub const NUMBER: f64 = 1e100;
/// Errors reported at once.
pub const ERRORS_SHOWN: usize = 20;
/// Indices of one pattern.
pub const INDICES: usize = 4;
/// Largest magnitude of an index.
pub const INDEX: f64 = 1e9;
/// Repetitions of one pattern.
pub const REPETITIONS: usize = ITEMS;
/// Values that all patterns of a file write: numbers, texts, lists and tables; 64 bytes of text count
/// as one more.
pub const REPEATED_VALUES: usize = 8_000_000;
/// Triangles of one mesh: they are kept in the model, and so in every result.
pub const MESH_TRIANGLES: usize = 50_000;
/// Bytes of the file of a mesh.
pub const MESH_BYTES: usize = 32 << 20;
