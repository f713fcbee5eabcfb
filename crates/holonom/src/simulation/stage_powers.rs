//! Powers along a step by the stages of a collocation formula. Equations: `docs/theory/simulation.md` (3c), (3d).

use super::ledger::{QUARTERS, StepPowers};
use super::step_length::Driven;
use crate::system::{State, System};

/// The start of a step, two collocation points, two places between them and the end, which is the third.
pub(super) const NODES: usize = 6;
/// Of these the places between collocation points.
pub(super) const BETWEEN: std::ops::Range<usize> = 3..5;
/// And the end.
pub(super) const END: usize = 5;
/// How many times what a cubic misses there of the rates of a driver it may miss of the multiplier: the frequency may be twice as
/// high.
const EXPLAINED: f64 = 20.0;
/// Part of the tolerance of what a cubic misses there of a rate from which on it counts: a tenth of that is missed of a work.
const WORTH: f64 = 0.05;

/// A step of a collocation formula, and what drives it.
pub(super) struct Look<'a> {
    pub(super) system: &'a dyn System,
    pub(super) drivers: &'a [Driven],
    /// Start, s.
    pub(super) t: f64,
    /// Length, s.
    pub(super) step: f64,
    /// θ, as [`StagePowers::nodes`] gives them.
    pub(super) nodes: [f64; NODES],
}

impl Look<'_> {
    /// Motion of a driver at θ: value and derivatives.
    fn drive(&self, driven: &Driven, theta: f64) -> [f64; 4] {
        self.system.drive(driven.row, self.t + theta * self.step)
    }

    /// The most that [`missed_between`] finds of the rate of a driver and of its change: where one of a wave vanishes the
    /// other does not.
    fn missed_of_rates(&self) -> f64 {
        let missed = self.drivers.iter().map(|driven| {
            let motion = self.nodes.map(|theta| self.drive(driven, theta));
            let [rate, change] = [1, 2].map(|k| missed_between(&self.nodes, &motion.map(|m| m[k])));
            rate.hypot(change)
        });
        missed.fold(0.0, f64::max)
    }
}

/// Multipliers of drivers and other powers in a step: at its start, at the collocation points, the last of which is its end, and
/// between them.
///
/// At collocation points forces satisfy the equations with the slopes of the formula; between them the force of a stiff
/// element is the error of a state times a stiffness. What drivers do there is known exactly.
#[derive(Debug, Clone)]
pub(super) struct StagePowers {
    /// By node, of the drivers.
    multipliers: [Vec<f64>; NODES],
    /// By node, (dissipated, supplied) without that of the drivers, W.
    others: [[f64; 2]; NODES],
    /// Nodes that are known: the start is where it is the end of a step before.
    known: [bool; NODES],
}

impl StagePowers {
    pub(super) fn new(drivers: &[Driven]) -> Self {
        Self {
            multipliers: std::array::from_fn(|_| vec![0.0; drivers.len()]),
            others: [[0.0; 2]; NODES],
            known: [false; NODES],
        }
    }

    /// What came before does not continue.
    pub(super) fn restart(&mut self) {
        self.known = [false; NODES];
    }

    /// θ of the nodes of a formula.
    pub(super) fn nodes([first, second, last]: [f64; 3]) -> [f64; NODES] {
        [0.0, first, second, 0.5 * (first + second), 0.5 * (second + last), last]
    }

    /// Forgets all nodes but the start.
    pub(super) fn begin(&mut self) {
        self.known[1..].fill(false);
    }

    /// Whether the collocation points inside the step have been taken.
    pub(super) fn inner_are_known(&self) -> bool {
        self.known[1] && self.known[2]
    }

    /// Takes the state with its multipliers at a node.
    pub(super) fn take(&mut self, node: usize, look: &Look<'_>, state: &State) {
        let energy = look.system.energy(state);
        let mut supplied = energy.supplied;
        for (multiplier, driven) in self.multipliers[node].iter_mut().zip(look.drivers) {
            *multiplier = state.lambda[driven.row];
            supplied += *multiplier * look.system.drive(driven.row, state.t)[1];
        }
        self.others[node] = [energy.dissipated, supplied];
        self.known[node] = true;
    }

    /// Whether drivers do so much in the step that [`BETWEEN`] is to be taken, too.
    pub(super) fn needs_more(&self, look: &Look<'_>, tolerance: f64) -> bool {
        self.known[0] && look.missed_of_rates() > WORTH * tolerance
    }

    /// Powers along the step, all of whose collocation points have been taken; its end is the start of the next one.
    pub(super) fn advance(&mut self, look: &Look<'_>) -> StepPowers {
        if !(self.known[BETWEEN] == [true; 2] && self.drivers_explain(look)) {
            self.known[BETWEEN].fill(false);
        }
        let at = |theta: f64| self.power(look, theta);
        let [a, b, c] = QUARTERS;
        let quarters = [0.0, a, b, c, 1.0].map(at);
        let [o, p, q, r] = [0.125, 0.375, 0.625, 0.875].map(at);
        let [start, a, b, c, end] = quarters;
        // Drivers may wave faster than the five moments tell, and what they do is known: Boole's rule on both halves is the mean.
        let halves = [[start, o, a, p, b], [b, q, c, r, end]];
        let [left, right] = halves.map(|at| StepPowers { at }.mean());
        let mut powers = StepPowers { at: quarters };
        powers.set_mean([0, 1].map(|k| 0.5 * (left[k] + right[k])));
        self.multipliers.swap(0, END);
        self.others.swap(0, END);
        self.known[0] = true;
        powers
    }

    /// (dissipated, supplied) at θ, W.
    fn power(&self, look: &Look<'_>, theta: f64) -> [f64; 2] {
        let weights = weights(&look.nodes, &self.known, theta);
        let sum = |value: &dyn Fn(usize) -> f64| -> f64 {
            let known = weights.iter().enumerate().filter(|(_, weight)| **weight != 0.0);
            known.map(|(node, weight)| weight * value(node)).sum()
        };
        let [dissipated, others] = [0, 1].map(|k| sum(&|node| self.others[node][k]));
        let driven = look.drivers.iter().enumerate().map(|(d, driven)| {
            look.drive(driven, theta)[1] * sum(&|node| self.multipliers[node][d])
        });
        [dissipated, others - driven.sum::<f64>()]
    }

    /// Whether multipliers [`BETWEEN`] are as far from cubics through the others as the drivers make them; else a stiff element
    /// does.
    fn drivers_explain(&self, look: &Look<'_>) -> bool {
        let explained = EXPLAINED * look.missed_of_rates();
        let moving =
            |driven: &Driven| look.nodes.iter().any(|theta| look.drive(driven, *theta)[1] != 0.0);
        look.drivers.iter().enumerate().filter(|(_, driven)| moving(driven)).all(|(d, _)| {
            let multipliers = std::array::from_fn(|node| self.multipliers[node][d]);
            missed_between(&look.nodes, &multipliers) <= explained
        })
    }
}

/// Weights of the known nodes in the polynomial through them at θ; zero for the others.
fn weights(nodes: &[f64; NODES], known: &[bool; NODES], theta: f64) -> [f64; NODES] {
    std::array::from_fn(|j| {
        let others = (0..NODES).filter(|&i| i != j && known[i]);
        let product = others.map(|i| (theta - nodes[i]) / (nodes[j] - nodes[i])).product();
        if known[j] { product } else { 0.0 }
    })
}

/// By how much values [`BETWEEN`] differ from the cubic through the others, against the largest of them.
fn missed_between(nodes: &[f64; NODES], values: &[f64; NODES]) -> f64 {
    let largest = values.iter().fold(f64::MIN_POSITIVE, |most, value| most.max(value.abs()));
    let mut others = [true; NODES];
    others[BETWEEN].fill(false);
    let missed = BETWEEN.map(|node| {
        let weights = weights(nodes, &others, nodes[node]);
        let cubic: f64 = weights.iter().zip(values).map(|(weight, value)| weight * value).sum();
        (values[node] - cubic).abs()
    });
    missed.fold(0.0, f64::max) / largest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formula::RADAU_IIA_5;

    #[test] // independent truth: polynomials of the degree that so many nodes determine
    fn weights_are_those_of_the_polynomial_through_the_known_nodes() {
        let nodes = StagePowers::nodes(RADAU_IIA_5.c);
        let [o, i] = [false, true];
        for known in [[i; NODES], [i, i, i, o, o, i], [o, i, i, o, o, i]] {
            let degree = known.iter().filter(|known| **known).count() as i32 - 1;
            for theta in [0.0, 0.3, 1.0f64] {
                let weights = weights(&nodes, &known, theta);
                for k in 0..=degree {
                    let sum: f64 = weights.iter().zip(nodes).map(|(w, x)| w * x.powi(k)).sum();
                    assert!((sum - theta.powi(k)).abs() < 1e-12, "{known:?} θ^{k}");
                }
            }
        }
    }

    #[test] // independent truth: the error of cubic interpolation of θ⁴, Π (θ − node), against θ⁴ = 1 at the end
    fn what_a_cubic_misses_is_that_of_the_fourth_power() {
        let nodes = StagePowers::nodes(RADAU_IIA_5.c);
        let missed = missed_between(&nodes, &nodes.map(|x| x.powi(4)));
        let others = [nodes[0], nodes[1], nodes[2], nodes[END]];
        let products = BETWEEN.map(|k| others.iter().map(|x| nodes[k] - x).product::<f64>().abs());
        let product = products.fold(0.0, f64::max);
        assert!((missed - product).abs() < 1e-14);
        assert!(missed_between(&nodes, &nodes.map(|x| 1.0 - x + x * x * x)) < 1e-15);
    }
}
