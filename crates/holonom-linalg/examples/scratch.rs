#[path = "../benches/vehicle/mod.rs"]
mod vehicle;
use holonom_linalg::*;
use std::{hint::black_box, time::Instant};
fn time(name: &str, mut f: impl FnMut()) {
    let mut best = f64::MAX;
    let mut all = vec![];
    for _ in 0..3000 {
        let t = Instant::now();
        for _ in 0..20 {
            f();
        }
        let d = t.elapsed().as_secs_f64() / 20.0 * 1e6;
        best = best.min(d);
        all.push(d);
    }
    all.sort_by(f64::total_cmp);
    println!("{name}: min {best:.2} p20 {:.2} median {:.2} µs", all[600], all[1500]);
}
fn main() {
    let only = std::env::args().nth(1).unwrap_or_default();
    for (name, (pattern, values)) in
        [("saddle", vehicle::saddle()), ("gp", vehicle::constraints_and_partition())]
    {
        let n = pattern.n_rows();
        let mut lu = SparseLu::analyze(&pattern, &values).unwrap();
        println!("{} {}", lu.operations(), lu.fill());
        time(&format!("{name} refactor"), || {
            lu.refactor(black_box(&values)).unwrap();
        });
        let mut x = vec![1.0; n];
        time(&format!("{name} solve"), || {
            x.fill(1.0);
            lu.solve(black_box(&mut x));
        });
        let mut x = vec![1.0; n * 18];
        time(&format!("{name} solve 18"), || {
            x.fill(1.0);
            lu.solve_many(black_box(&mut x), 18);
        });
        time(&format!("{name} solveT 18"), || {
            x.fill(1.0);
            lu.solve_transposed_many(black_box(&mut x), 18);
        });
    }
    let _ = only;
}
