//! Which solver accelerations come from, and what each of them costs.

use super::solvers::envelope_multiplications;
use super::{Numbering, ReducedEnvelope, ReducedMatrix, Refusal};
use crate::model::Accelerations;
use crate::system::System;
use holonom_linalg::EnvelopePlan;

/// Predicted operations of one solve, in multiplications of a sparse elimination.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AccelerationCosts {
    /// Along the tree; infinite where there is none.
    pub recursive: f64,
    /// By the null space.
    pub null_space: f64,
    /// By the reduced matrix; at least so much where another way costs less.
    pub reduced: f64,
    /// Why there is no reduced matrix.
    pub refusal: Option<Refusal>,
    /// By the augmented matrix.
    pub augmented: f64,
}

impl AccelerationCosts {
    /// The cheapest way there is.
    pub fn cheapest(&self) -> Accelerations {
        let others = self.null_space.min(self.augmented);
        if self.recursive < others && (self.refusal.is_some() || self.recursive <= self.reduced) {
            Accelerations::Recursive
        } else if self.refusal.is_none() && self.reduced < others {
            Accelerations::Reduced
        } else if self.null_space < self.augmented {
            Accelerations::NullSpace
        } else {
            Accelerations::Augmented
        }
    }
}

/// Parts of a multiplication in a sparse elimination, measured in `benchmarks/accelerations`: one in a block,
/// and what stands around the blocks of a joint and one of its bodies, and around all of them: 350 and 340
/// of the seven bodies and of the spatial four-bar.
pub(super) const BLOCK: f64 = 0.2;
const SIDE: f64 = 33.0;
const CALLS: f64 = 350.0;
/// Of orders of joints the quickly found one is at most about so many times as costly as the best.
const ROUGH: f64 = 3.0;
/// Most numbers of a matrix, 512 MB.
const MOST_NUMBERS: f64 = 67_108_864.0;

/// The solver by the reduced matrix if it costs less than `most`, and its cost; else what it costs at least. A body
/// with many joints is found out before anything of the size of its part of B is built.
///
/// # Errors
/// [`Refusal`].
pub(super) fn plan_reduced(
    system: &dyn System,
    kept: &[usize],
    most: f64,
) -> Result<(Option<ReducedEnvelope>, f64), Refusal> {
    ReducedMatrix::check(system, kept)?;
    let [numbers, multiplications, sides] = ReducedMatrix::least_size(system, kept);
    let least = CALLS + BLOCK * multiplications + SIDE * sides;
    if least >= most {
        return Ok((None, least));
    }
    small(numbers)?;
    let matrix = ReducedMatrix::new(system, kept)?;
    let plan = |numbering: Numbering| {
        let plan = EnvelopePlan::new(matrix.graph(), &numbering.order(matrix.graph()));
        let factor = BLOCK * envelope_multiplications(&plan) as f64;
        (plan, least + factor)
    };
    let (rough, cost) = plan(Numbering::ReverseCuthillMckee);
    if cost >= ROUGH * most {
        return Ok((None, cost));
    }
    small(rough.len() as f64 / ROUGH)?;
    let (plan, _) = plan(Numbering::Least);
    small(plan.len() as f64)?;
    let own = matrix.multiplications_beside_products() + envelope_multiplications(&plan);
    let cost = least + BLOCK * own as f64;
    let made = (cost < most).then(|| ReducedEnvelope::with_plan(matrix, plan));
    Ok((made, cost))
}

/// Refuses a matrix that would fill the memory.
pub(super) fn small(numbers: f64) -> Result<(), Refusal> {
    if numbers > MOST_NUMBERS { Err(Refusal::Large { numbers }) } else { Ok(()) }
}
