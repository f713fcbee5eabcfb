//! Text to model: one spanned tree for TOML and JSON.
