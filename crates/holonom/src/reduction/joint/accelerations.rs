//! Accelerations for forces, by the cheapest way there is.

use super::algebra::Algebra;
use super::branched::Branched;
use super::closures::Origin;
use super::directions::Directions;
use super::engine::{Engine, add, dot, pose};
use crate::system::State;

/// What a solution may leave of the forces on a coordinate, against the sizes of what they are summed from, before other
/// solvers are asked.
const ACCURACY: f64 = 1e-9;

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// Makes room for accelerations.
    pub(super) fn plan_accelerations(&mut self) {
        let cut =
            self.closures.all.iter().any(|closure| {
                matches!(closure.origin, Origin::Joint(_)) && !closure.rows.is_empty()
            });
        self.is_plain_tree = !cut;
        if self.is_plain_tree {
            return;
        }
        let (bodies, ndof) = (self.inertias.len(), self.zero_rates.len());
        let directions = Directions::new(&self.edges, &self.closures, &self.sources, bodies, ndof);
        let branched = Branched::new(&self.edges, &self.closures.all, &self.sources);
        let operations = branched.factors.plan().operations().total().multiplications as f64;
        // On chains between two hinges, four-bars and vehicles both are within a tenth of each other up to eight times the
        // operations of Algorithm 4: its columns are short.
        if directions.operations() <= 3.0 * operations {
            self.directions = Some(Box::new(directions));
        } else {
            self.branched = Some(Box::new(branched));
        }
    }

    pub(super) fn matrix_sizes(&self) -> [usize; 3] {
        let branched = Branched::new(&self.edges, &self.closures.all, &self.sources);
        branched.sizes()
    }

    /// q̈, the multipliers of closures and drivers, and ż; `false` where no or too few digits are left.
    pub(super) fn accelerations_of(&mut self, state: &mut State, z_rate: &mut [f64]) -> bool {
        self.evaluate_forces(state, z_rate);
        let State { t, q, v, a, lambda, .. } = state;
        lambda.fill(0.0);
        self.evaluate_bias();
        if self.directions.is_some() {
            return self.follow_directions(*t, [q, v], a, lambda);
        }
        if self.is_plain_tree {
            self.tell_drivers(*t);
            if !self.articulate(q, v) {
                return false;
            }
        } else {
            self.carry_bias();
            if !self.branch(*t, q, v, lambda) {
                return false;
            }
        }
        self.evaluate_twist_rates();
        self.tell_second_rates(q, v, a);
        self.balance(q, a);
        if self.is_plain_tree {
            self.tell_multipliers(lambda);
        }
        self.keep_closure_forces(lambda);
        self.closures.subtract_transposed(&self.rows, &mut self.along);
        self.is_balanced(lambda)
    }

    /// Accelerations and rates of twists where drivers alone accelerate.
    fn tell_drivers(&mut self, t: f64) {
        if self.edges.iter().all(|edge| edge.driven == 0) {
            self.accelerations.fill(0.0);
            self.carry_bias();
            return;
        }
        let mut accelerations = std::mem::take(&mut self.accelerations);
        self.zero_rates.fill(0.0);
        self.tell(t, Some(2), &self.zero_rates, &mut accelerations);
        self.accelerations = accelerations;
        self.evaluate_twist_rates();
    }

    /// Accelerations by M̂, then multipliers of what closes loops and of drivers on the tree.
    fn follow_directions(
        &mut self,
        t: f64,
        [q, v]: [&[f64]; 2],
        a: &mut [f64],
        lambda: &mut [f64],
    ) -> bool {
        if !self.evaluate_directions(q) {
            return false;
        }
        self.tell_drivers(t);
        if self.closures.rows() > 0 {
            // Deformations stay as they are for now, whatever that is.
            self.rows.fill(0.0);
            self.evaluate_second_residual(None, t, &[], [q, v]);
            self.closures.solve(&mut self.rows);
            for (x, &k) in self.rows.iter().zip(&self.closures.dependent) {
                self.accelerations[k] = *x;
            }
            self.evaluate_twist_rates();
        }
        self.evaluate_wrenches_anew(q, v);
        self.gather();
        self.accelerate_along();
        self.evaluate_twist_rates();
        self.tell_second_rates(q, v, a);
        self.balance(q, a);
        let mut left = std::mem::take(&mut self.zero_rates);
        self.project(&mut left);
        self.tell_multipliers(lambda);
        // What is left of the forces was there as nowhere else is room: rates are zero again.
        left.fill(0.0);
        self.zero_rates = left;
        // Deformations bear no force.
        for closure in &self.closures.all {
            let bears = matches!(closure.origin, Origin::Joint(_));
            let rows = &mut self.rows[closure.first..][..closure.rows.len()];
            rows.iter_mut().for_each(|y| *y = if bears { 0.0 } else { -*y });
        }
        self.closures.subtract_transposed(&self.rows, &mut self.along);
        self.keep_closure_forces(lambda);
        self.is_balanced(lambda)
    }

    /// Into `rows` the forces of what closes loops.
    fn keep_closure_forces(&mut self, lambda: &[f64]) {
        for closure in &self.closures.all {
            for (y, (_, row)) in self.rows[closure.first..].iter_mut().zip(&closure.rows) {
                let is_joint = matches!(closure.origin, Origin::Joint(_));
                *y = if is_joint { -lambda[*row] } else { 0.0 };
            }
        }
    }

    /// Forces `along` the coordinates for the present rates of twists and q̈ = a, and in `change` the sizes of what they are summed
    /// from.
    fn balance(&mut self, q: &[f64], a: &[f64]) {
        self.wrench.fill([0.0; W]);
        self.wrench_size.fill([0.0; 2]);
        for edge in self.edges.iter().rev() {
            let b = edge.body;
            let (own, applied) = (self.inertia_force(b, q, pose(a, b)), &self.applied[b]);
            let terms = A::sizes(&std::array::from_fn(|i| own[i].abs() + applied[i].abs()));
            // Of the body and of all that hangs on it.
            let (mut wrench, mut size) = (self.wrench[b], self.wrench_size[b]);
            for i in 0..W {
                wrench[i] += own[i] - applied[i];
            }
            add(&mut size, 1.0, &terms);
            let columns = self.columns[edge.range.clone()].iter();
            let forces = columns.zip(&mut self.along[edge.range.clone()]);
            for ((column, along), change) in forces.zip(&mut self.change[edge.range.clone()]) {
                *along = dot(column, &wrench);
                *change = A::size_along(column, &size);
            }
            if let Some(base) = edge.base {
                add(&mut self.wrench[base], 1.0, &wrench);
                add(&mut self.wrench_size[base], 1.0, &size);
            }
        }
    }

    /// Whether what closures, whose forces are `rows`, leave of the forces `along` the coordinates is with those of drivers
    /// round-off of what it is summed from: a light body is asked for its own digits, not for those of a heavy one elsewhere.
    fn is_balanced(&mut self, lambda: &[f64]) -> bool {
        let sizes = &mut self.change;
        self.closures.add_sizes(&self.rows, sizes);
        for &(k, row, sign, _) in &*self.driven {
            self.along[k] += sign * lambda[row];
            sizes[k] += lambda[row].abs();
        }
        self.along.iter().zip(&*sizes).all(|(left, size)| left.abs() <= ACCURACY * size)
    }
}
