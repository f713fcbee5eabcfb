//! Eigenvalues of the motion linearized at a state.

use crate::method::FirstOrder;
use crate::newton::{SmallRotations, SpectrumError, Tangent};
use crate::reduction::Point;
use crate::reduction::assembly::Assembled;
use holonom_linalg::{DecompositionError, eigenvalues};

/// More degrees of freedom than this have only the fastest of their eigenvalues computed.
pub const LARGEST_DENSE: usize = 300;
/// Fastest eigenvalues that are looked for then.
const WANTED: usize = 12;
/// Dimension of the Krylov space at which they must have settled, and the one they are compared with.
const KRYLOV: [usize; 2] = [110, 90];
/// Relative change between the two up to which an eigenvalue has settled.
const SETTLED: f64 = 1e-6;
/// Dimension of the space that tells how stiff positions are.
const BALANCING: usize = 20;

/// Eigenvalues, fastest first.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum {
    /// Real and imaginary parts, 1/s.
    pub values: Vec<(f64, f64)>,
    /// Whether these are all of them; otherwise the fastest.
    pub is_complete: bool,
}

/// Eigenvalues of J = g_w of the first-order form at an assembled state, in small rotations in place of rotation vectors: those of a
/// rotor that is the same about its axis are its whirl in axes of the body that carries it. Accelerations and multipliers are
/// those of the state. Of models with more than [`LARGEST_DENSE`] degrees of freedom the fastest ones only,
/// by Arnoldi's method with products J x; none where they do not settle.
///
/// # Errors
/// [`SpectrumError`].
pub fn spectrum(assembled: &Assembled) -> Result<Spectrum, SpectrumError> {
    let is_complete = assembled.parametrization().ndof <= LARGEST_DENSE;
    let mut values = if is_complete {
        FirstOrder::eigenvalues_of_rotations(assembled.manifold(), &assembled.state)?
    } else {
        fastest(assembled)?
    };
    values.sort_by(|a, b| b.0.hypot(b.1).total_cmp(&a.0.hypot(a.1)).then(b.1.total_cmp(&a.1)));
    Ok(Spectrum { values, is_complete })
}

/// The eigenvalues of the largest magnitude, as far as they have settled. Source: W. E. Arnoldi, *The principle of minimized
/// iterations in the solution of the matrix eigenvalue problem*, Quart. Appl. Math. 9 (1951).
///
/// Positions count ω times, ω² the largest that stiffness alone makes of them, found in a small space: beside
/// [0 1; −ω² 0] in (q, q̇), whose parts are as far apart as ω² and 1, one cannot see the other.
///
/// # Errors
/// [`SpectrumError`].
pub fn fastest(assembled: &Assembled) -> Result<Vec<(f64, f64)>, SpectrumError> {
    let mut point = Point::new(assembled.manifold(), &assembled.state);
    let mut tangent = Tangent::new(&mut point);
    let rotations = SmallRotations::new(&point.manifold, &assembled.state);
    let frequency = stiffest(&mut point, &mut tangent)?.sqrt().max(1.0);
    let steps = KRYLOV[0].min(tangent.dimension());
    let ndof = point.manifold.chart().ndof();
    let (size, space) = krylov(tangent.dimension(), KRYLOV[0], |direction, out| {
        let mut scaled = direction.to_vec();
        scaled[..ndof].iter_mut().for_each(|x| *x /= frequency);
        rotations.to_vectors(&mut scaled);
        tangent.multiply(&mut point, &scaled, out)?;
        rotations.to_rotations(&scaled, out);
        out[..ndof].iter_mut().for_each(|x| *x *= frequency);
        Ok(())
    })?;
    let mut values = part_of(&space, KRYLOV[0], size)?;
    if size == steps && size > KRYLOV[1] {
        let before = part_of(&space, KRYLOV[0], KRYLOV[1])?;
        let settled = |z: &(f64, f64)| {
            let change = |y: &(f64, f64)| (z.0 - y.0).hypot(z.1 - y.1);
            before.iter().any(|y| change(y) <= SETTLED * magnitude(z))
        };
        let unsettled = values.iter().position(|z| !settled(z)).unwrap_or(values.len());
        values.truncate(unsettled.min(WANTED));
        // Not one of a pair without the other.
        let conjugate = |z: &(f64, f64)| (z.0, -z.1);
        if values.last().is_some_and(|z| !values.contains(&conjugate(z))) {
            values.pop();
        }
    }
    // What has neither stiffness nor damping has a double zero, of [0 ω; 0 0] in (ωq, q̇): round-off of m ε ‖H‖ in place of
    // the lower 0 makes a λ² of that size times ω.
    let round_off = size as f64 * f64::EPSILON * norm(&space) * frequency;
    for z in &mut values {
        if z.0 * z.0 + z.1 * z.1 <= round_off {
            *z = (0.0, 0.0);
        }
    }
    Ok(values)
}

/// The largest eigenvalue, 1/s², of what positions make of accelerations, about.
fn stiffest(point: &mut Point, tangent: &mut Tangent) -> Result<f64, SpectrumError> {
    let (n, ndof) = (tangent.dimension(), point.manifold.chart().ndof());
    let (mut displaced, mut rates) = (vec![0.0; n], vec![0.0; n]);
    let (size, space) = krylov(ndof, BALANCING, |direction, out| {
        displaced[..ndof].copy_from_slice(direction);
        tangent.multiply(point, &displaced, &mut rates)?;
        out.copy_from_slice(&rates[ndof..2 * ndof]);
        Ok(())
    })?;
    Ok(part_of(&space, BALANCING, size)?.first().map_or(0.0, magnitude))
}

/// The Hessenberg matrix of a Krylov space of at most `most` of n dimensions, by rows of that length, and its size;
/// `multiply` gives products.
fn krylov(
    n: usize,
    most: usize,
    mut multiply: impl FnMut(&[f64], &mut [f64]) -> Result<(), SpectrumError>,
) -> Result<(usize, Vec<f64>), SpectrumError> {
    let steps = most.min(n);
    let mut hessenberg = vec![0.0; most * most];
    // A fixed direction without symmetry.
    let start: Vec<f64> =
        (0..n).map(|i| 0.5 + (0.618_033_988_749_895 * (i + 1) as f64).fract()).collect();
    let mut basis = vec![normalized(start)];
    for k in 0..steps {
        let mut next = vec![0.0; n];
        multiply(&basis[k], &mut next)?;
        let length = norm(&next);
        // Twice, as one pass leaves what cancellation makes of it.
        for _ in 0..2 {
            for (j, direction) in basis.iter().enumerate() {
                let along = dot(direction, &next);
                hessenberg[j * most + k] += along;
                next.iter_mut().zip(direction).for_each(|(x, d)| *x -= along * d);
            }
        }
        let rest = norm(&next);
        if rest <= 1e-12 * length || k + 1 == steps {
            return Ok((k + 1, hessenberg));
        }
        hessenberg[(k + 1) * most + k] = rest;
        basis.push(normalized(next));
    }
    Ok((steps, hessenberg))
}

/// Eigenvalues of the first m directions of a Hessenberg matrix with rows of length `row`, fastest first.
fn part_of(
    hessenberg: &[f64],
    row: usize,
    m: usize,
) -> Result<Vec<(f64, f64)>, DecompositionError> {
    let rows = (0..m).flat_map(|i| &hessenberg[i * row..i * row + m]);
    let mut values = eigenvalues(m, &rows.copied().collect::<Vec<_>>())?;
    values.sort_by(|a, b| magnitude(b).total_cmp(&magnitude(a)));
    Ok(values)
}

fn magnitude(z: &(f64, f64)) -> f64 {
    z.0.hypot(z.1)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn norm(x: &[f64]) -> f64 {
    dot(x, x).sqrt()
}

fn normalized(mut x: Vec<f64>) -> Vec<f64> {
    let length = norm(&x);
    x.iter_mut().for_each(|x| *x /= length);
    x
}
