//! The fastest eigenvalues of large models.

use holonom::analysis::{fastest, spectrum};
use holonom::simulation::Problem;

#[test] // independent truth: all eigenvalues, of the dense matrix
fn the_fastest_are_those_of_the_dense_matrix() {
    for (name, least) in [("chain50", 2), ("spatial_four_bar", 1), ("hmmwv14", 2)] {
        let problem = Problem::new(crate::common::model(name));
        let assembled = problem.assemble().unwrap();
        let (all, found) = (spectrum(assembled).unwrap(), fastest(assembled).unwrap());
        assert!(all.is_complete && found.len() >= least, "{name}: {found:?}");
        let size = |z: &(f64, f64)| z.0.hypot(z.1);
        let (largest, first) = (size(&all.values[0]), size(&found[0]));
        assert!((largest - first).abs() < 1e-6 * largest, "{name}: {largest} {first}");
        for z in &found {
            let distances = all.values.iter().map(|y| size(&(z.0 - y.0, z.1 - y.1)));
            let nearest = distances.fold(f64::INFINITY, f64::min);
            assert!(nearest < 1e-5 * largest, "{name}: {z:?} is {nearest:.1e} off");
        }
    }
}
