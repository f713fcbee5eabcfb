//! Order conditions of Runge-Kutta formulas by rooted trees, for the tests of the tables.
//!
//! Source: Butcher; Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I*, II.2.

/// A rooted tree: the subtrees at its root.
#[derive(Debug, Clone)]
pub(crate) struct Tree(Vec<Tree>);

impl Tree {
    pub(crate) fn order(&self) -> u32 {
        1 + self.0.iter().map(Tree::order).sum::<u32>()
    }

    /// γ(τ): the exact solution has weight 1/γ.
    fn density(&self) -> f64 {
        f64::from(self.order()) * self.0.iter().map(Tree::density).product::<f64>()
    }

    /// Φᵢ(τ) for every stage i.
    fn stage_weights<const S: usize>(&self, a: &[[f64; S]; S]) -> [f64; S] {
        let mut weights = [1.0; S];
        for child in &self.0 {
            let inner = child.stage_weights(a);
            for (weight, row) in weights.iter_mut().zip(a) {
                *weight *= row.iter().zip(&inner).map(|(a, x)| a * x).sum::<f64>();
            }
        }
        weights
    }
}

/// All rooted trees up to `order`, by order.
pub(crate) fn trees(order: u32) -> Vec<Tree> {
    /// Sets of trees out of `known[..=last]` with `left` vertices in all.
    fn forests(known: &[Tree], last: usize, left: u32, forest: &[Tree], out: &mut Vec<Tree>) {
        if left == 0 {
            out.push(Tree(forest.to_vec()));
            return;
        }
        for i in (0..known.len().min(last + 1)).rev().filter(|&i| known[i].order() <= left) {
            let mut longer = forest.to_vec();
            longer.push(known[i].clone());
            forests(known, i, left - known[i].order(), &longer, out);
        }
    }
    let mut all = Vec::new();
    for n in 1..=order {
        let mut found = Vec::new();
        forests(&all, usize::MAX - 1, n - 1, &[], &mut found);
        all.extend(found);
    }
    all
}

/// Asserts Σ bᵢ Φᵢ(τ) = θ^ρ(τ)/γ(τ) for all trees up to `order`; θ = 1 is the end of the step.
#[track_caller]
pub(crate) fn assert_order<const S: usize>(
    a: &[[f64; S]; S],
    b: &[f64; S],
    theta: f64,
    order: u32,
) {
    for tree in trees(order) {
        let found: f64 = tree.stage_weights(a).iter().zip(b).map(|(x, b)| x * b).sum();
        let expected = theta.powi(tree.order() as i32) / tree.density();
        assert!((found - expected).abs() < 1e-12, "{tree:?} at θ = {theta}: {found} ≠ {expected}");
    }
}

#[test]
fn there_are_as_many_trees_as_cayley_counted() {
    for (order, count) in [(1, 1), (2, 2), (3, 4), (4, 8), (5, 17), (6, 37), (8, 200)] {
        assert_eq!(trees(order).len(), count, "up to order {order}");
    }
}
