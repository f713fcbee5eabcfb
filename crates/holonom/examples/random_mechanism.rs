//! Prints the model file of a random mechanism: `cargo run --release -p holonom --example
//! random_mechanism -- 17 > 17.toml`.

#![allow(clippy::print_stdout, reason = "an example talks to its reader")]

#[path = "../tests/random/mod.rs"]
mod random;

use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let seed = std::env::args().nth(1).ok_or("usage: random_mechanism SEED")?.parse()?;
    println!("{}", random::Mechanism::new(seed, 0.0).text());
    Ok(())
}
