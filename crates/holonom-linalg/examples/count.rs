#[path = "../benches/vehicle/mod.rs"]
mod vehicle;
use holonom_linalg::*;
fn main() {
    let (pattern, values) = if std::env::args().nth(1).unwrap() == "gp" {
        vehicle::constraints_and_partition()
    } else {
        vehicle::saddle()
    };
    let mut lu = SparseLu::analyze(&pattern, &values).unwrap();
    for _ in 0..1000 {
        lu.refactor(&values).unwrap();
    }
}
