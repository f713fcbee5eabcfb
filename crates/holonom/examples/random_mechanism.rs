//! Prints the model file of a random mechanism: `cargo run --release -p holonom --example
//! random_mechanism -- 17 > 17.toml`; with `adrift` behind the seed, of one whose bodies force elements alone tie, with `stops`
//! of one with stops.

#![allow(clippy::print_stdout, reason = "an example talks to its reader")]

#[path = "../tests/engine/random/mod.rs"]
mod random;

use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let seed = arguments.next().ok_or("usage: random_mechanism SEED [adrift | stops]")?.parse()?;
    let draw = match arguments.next().as_deref() {
        Some("adrift") => random::Mechanism::adrift,
        Some("stops") => random::Mechanism::with_stops,
        _ => random::Mechanism::new,
    };
    println!("{}", draw(seed, 0.0).text());
    Ok(())
}
