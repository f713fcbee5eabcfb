//! Choice of the parametrization: independent coordinates, or a basis of the tangent plane.

use super::manifold::Manifold;
use super::parametrization::{Parametrization, Projection};
use super::partitioning::{RANK_TOLERANCE, partition};
use super::tree::choose_tree;
use crate::error::EvaluationFailure;
use crate::model::ParametrizationKind;
use crate::system::{Measure, State, System};
use holonom_linalg::{
    BlockMatrix, DecompositionError, orthonormal_null_space, orthonormal_null_space_qr, thin_svd,
};

/// A direction of the tangent plane is followed by its rotations when they are more than this part
/// of it, with lengths measured against the characteristic length.
const ROTATION_SHARE: f64 = 0.125;

/// An entry of a unit vector below this is round-off.
const NEGLIGIBLE: f64 = 1e-13;

/// A parametrization at a state with Jacobian `g`. Rank, kept and redundant rows of a tangent plane are
/// those of the partition. The rank stays that of the manifold's chart where some tolerance gives it: redundant rows being
/// satisfied at the state, more of them than before seem independent by as much as round-off, in an ill-conditioned place, has taken
/// bodies from where loops close.
///
/// The tangent plane is an orthonormal basis N of null(G), with lengths measured against the
/// characteristic length. Its directions are followed by their rotations where they rotate, else by
/// their translations:
///
/// ```text
/// N_rot = U Σ Wᵀ      P = [U₁ᵀ on rotations; (N_trans W₂)ᵀ on translations],  Σ₁ > 1/8 ≥ Σ₂
/// ```
///
/// which is Vᵀ of the same plane in a metric where translations weigh nothing against rotations.
/// Stiff elements then act along directions that stay put in v while the mechanism turns; with equal
/// weights the stiff double pendulum loses two digits. A constant shift of v, as in v = P (q − q₀),
/// changes nothing.
///
/// Source: N. K. Mani, E. J. Haug, K. E. Atkinson, *Application of singular value decomposition for
/// analysis of mechanical system dynamics*, J. Mech. Trans. Automation 107 (1985); F. A. Potra,
/// W. C. Rheinboldt, *On the numerical solution of Euler-Lagrange equations*, Mech. Struct. Mach. 19
/// (1991), with QR.
///
/// # Errors
/// `simulation/singular-configuration` when G is not finite or the decomposition fails.
pub fn choose(
    choice: ParametrizationKind,
    manifold: &Manifold,
    state: &State,
    g: &BlockMatrix,
) -> Result<Parametrization, EvaluationFailure> {
    let rank = manifold.chart().parametrization().kept.len();
    let mut tolerance = RANK_TOLERANCE;
    let first = choose_by(choice, manifold, state, g, tolerance)?;
    let mut least = first.pivot_ratio;
    while first.kept.len() > rank && tolerance < 1.0 {
        tolerance = 2.0 * least.max(tolerance);
        match choose_by(choice, manifold, state, g, tolerance) {
            Ok(found) if found.kept.len() > rank => least = found.pivot_ratio,
            Ok(found) if found.kept.len() == rank => return Ok(found),
            _ => break,
        }
    }
    Ok(first)
}

/// Tree coordinates at a state with Jacobian `g` by condition alone, whatever is stiff; `None` on other parametrizations, and where
/// these are the present ones.
pub fn choose_by_condition(
    manifold: &Manifold,
    state: &State,
    g: &BlockMatrix,
) -> Option<Parametrization> {
    let parametrization = manifold.chart().parametrization();
    let present = Some(parametrization.relatives()?);
    let system = manifold.system().as_ref();
    let found = choose_tree(system, state, g, present, RANK_TOLERANCE, false).ok()?;
    (found.ndof == parametrization.ndof && !found.same_as(parametrization)).then_some(found)
}

/// With rows redundant of which less than `rank_tolerance` is left.
fn choose_by(
    choice: ParametrizationKind,
    manifold: &Manifold,
    state: &State,
    g: &BlockMatrix,
    rank_tolerance: f64,
) -> Result<Parametrization, EvaluationFailure> {
    let system = manifold.system().as_ref();
    if choice == ParametrizationKind::Tree {
        let present = manifold.chart().parametrization().relatives();
        return choose_tree(system, state, g, present, rank_tolerance, true);
    }
    let mut parametrization = partition(system, &state.q, g, rank_tolerance);
    if choice != ParametrizationKind::Partitioning {
        let rows = tangent_plane(choice, system, &parametrization, g).map_err(|error| {
            EvaluationFailure::new(
                "simulation/singular-configuration",
                format!("the tangent plane of the constraints was not found: {error}"),
            )
        })?;
        parametrization.projection = Projection::Basis(rows);
    }
    Ok(parametrization)
}

/// P by rows.
fn tangent_plane(
    choice: ParametrizationKind,
    system: &dyn System,
    parametrization: &Parametrization,
    g: &BlockMatrix,
) -> Result<Vec<f64>, DecompositionError> {
    let structure = system.structure();
    let n = structure.sizes.coordinates;
    let (rank, ndof) = (n - parametrization.ndof, parametrization.ndof);
    if ndof == 0 {
        return Ok(Vec::new());
    }
    let length = system.characteristic_length();
    let turns = |i: usize| structure.coordinate_measure(i) == Measure::Angle;
    let dense = g.to_dense();
    let mut a = Vec::with_capacity(rank * n);
    for &row in &*parametrization.kept {
        let row = &dense[row * n..(row + 1) * n];
        let scaled = |i: usize| if turns(i) { row[i] } else { row[i] * length };
        let largest = (0..n).fold(0.0f64, |m, i| m.max(scaled(i).abs()));
        a.extend((0..n).map(|i| scaled(i) / largest));
    }
    let plane = match choice {
        // The kept rows are independent: none of their singular values counts as zero.
        ParametrizationKind::TangentPlaneSvd => orthonormal_null_space(rank, n, &a, 0.0)?.0,
        _ => orthonormal_null_space_qr(rank, n, &a)?,
    };
    let (rotations, translations): (Vec<_>, Vec<_>) = (0..n).partition(|&i| turns(i));
    let mut n_rot: Vec<f64> =
        rotations.iter().flat_map(|&i| &plane[i * ndof..(i + 1) * ndof]).copied().collect();
    // With rows of zeros, if need be, W is square.
    let height = rotations.len().max(ndof);
    n_rot.resize(height * ndof, 0.0);
    let split = thin_svd(height, ndof, &n_rot)?;
    let mut rows = vec![0.0; ndof * n];
    // Round-off where a direction does not move a coordinate would cost fill in [G; P].
    let clean = |x: f64| if x.abs() > NEGLIGIBLE { x } else { 0.0 };
    for k in 0..ndof {
        let row = &mut rows[k * n..(k + 1) * n];
        if split.s[k] > ROTATION_SHARE {
            for (at, &i) in rotations.iter().enumerate() {
                row[i] = clean(split.u[at * ndof + k]);
            }
        } else {
            for &i in &translations {
                let x: f64 = (0..ndof).map(|j| plane[i * ndof + j] * split.v[j * ndof + k]).sum();
                row[i] = clean(x) / length;
            }
        }
    }
    Ok(rows)
}
