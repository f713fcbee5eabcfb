use super::quantity;
use crate::elements::measure::{Dot, Measure};
use crate::elements::space::{Spatial, Triad, euler};
use crate::elements::vector_function::Vector;
use crate::elements::{
    Energy, ForceBlocks, ForceElement, ForceInput, ForceOutput, PairBlocks, Quantity, RowBlocks,
};
use crate::math::Real;
use crate::math::spatial::{conjugate, euler_parameters, product, rotate, slope};
use crate::math::vector::{add_scaled, dot, lift, sum};

const QUANTITIES: &[Quantity] = &[
    quantity("deformation", "m, rad", "first", 6),
    quantity("force", "N", "first", 3),
    quantity("torque", "N m", "first", 3),
];

/// Columns of a packed row: r_j, p_i, p_j. The row depends on r_i by −r_j.
const PACKED: usize = 11;
type Packed<T> = [[T; PACKED]; 6];

/// Linear 6×6 bushing between two frames; acts at the second frame's point.
///
/// ```text
/// u = (d, e),   d_k = a_kᵀ (x_j − x_i) with a_k = f_i, g_i, h_i
/// e_k = 2 sign(ε₀) ε_k,   ε = conj(p_i c_i) p_j c_j = (p_iᵀ R_k p_j),   c: frame in its body
/// W = K u + C u̇,   Q = −u_qᵀ W
/// −Q_q = u_qᵀ (K u_q + C (u_q v)_q) + Σ W_k (u_k)_qq,   −Q_q̇ = u_qᵀ C u_q
/// ```
///
/// The force is evaluated without u_q of d: with f = −Σ W_k a_k fixed in the first body, it is the virtual work of A f on the
/// link d and on the turning of A, fᵀ(Aᵀd)˙.
///
/// With C = 0 the force is the gradient of ½ uᵀK u, so it is conservative at every amplitude; e
/// turns over only at half a turn. On |p| = 1 the moment on the second body about its point is
/// −sign(ε₀) (ε₀ I + ε̃) W_e in axes of the first frame.
///
/// Source: virtual work; Euler parameters after Haug (1989), 9.3.
#[derive(Debug, Clone, PartialEq)]
pub struct Bushing {
    /// d.
    translation: Measure<Spatial, 3, 7, 4>,
    /// f, g, h of the first frame.
    axes: [[f64; 3]; 3],
    /// R_k, k = 0..4.
    forms: [[[f64; 4]; 4]; 4],
    stiffness: [[f64; 6]; 6],
    damping: [[f64; 6]; 6],
    damped: bool,
}

/// The bushing in one configuration.
struct Deformation<T> {
    u: [T; 6],
    u_q: Packed<T>,
    /// 2 sign(ε₀).
    twice_sign: f64,
}

impl Bushing {
    pub(in crate::elements) fn new(
        frames: &[Triad<3>; 2],
        stiffness: &[[f64; 6]; 6],
        damping: &[[f64; 6]; 6],
    ) -> Self {
        let dots = frames[0].axes.map(Dot::along).to_vec();
        let translation = Measure::new([frames[0].point, frames[1].point], false, dots);
        let [ci, cj] = frames.map(|frame| {
            let columns = frame.axes;
            euler_parameters(&std::array::from_fn(|row| columns.map(|axis| axis[row])))
        });
        let unit = |k: usize| std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 });
        let mut forms = [[[0.0; 4]; 4]; 4];
        for a in 0..4 {
            for b in 0..4 {
                let (pi, pj) = (product(&unit(a), &ci), product(&unit(b), &cj));
                let relative = product(&conjugate(&pi), &pj);
                for k in 0..4 {
                    forms[k][a][b] = relative[k];
                }
            }
        }
        let damped = damping.iter().flatten().any(|&c| c != 0.0);
        let axes = frames[0].axes;
        Self { translation, axes, forms, stiffness: *stiffness, damping: *damping, damped }
    }

    /// R_k p_j (columns p_i) and R_kᵀ p_i (columns p_j).
    #[inline(always)]
    fn form_rows<T: Real>(&self, k: usize, pi: &[T; 4], pj: &[T; 4]) -> ([T; 4], [T; 4]) {
        let form = &self.forms[k];
        let mut out = ([T::zero(); 4], [T::zero(); 4]);
        for a in 0..4 {
            for b in 0..4 {
                out.0[a] += pj[b] * form[a][b];
                out.1[b] += pi[a] * form[a][b];
            }
        }
        out
    }

    #[inline(always)]
    fn deformation<T: Real>(&self, q: [&[T; 7]; 2]) -> Deformation<T> {
        let mut u = [T::zero(); 6];
        let mut rows = RowBlocks::zero();
        self.translation.value(q, &mut u);
        self.translation.jacobian(q, &mut rows);
        let mut u_q = pack(&rows);
        let [pi, pj] = q.map(euler);
        let (row, _) = self.form_rows(0, &pi, &pj);
        let twice_sign = 2.0_f64.copysign(dot(&row, &pi).value());
        for k in 0..3 {
            let (on_i, on_j) = self.form_rows(k + 1, &pi, &pj);
            u[3 + k] = dot(&on_i, &pi) * twice_sign;
            for a in 0..4 {
                u_q[3 + k][3 + a] = on_i[a] * twice_sign;
                u_q[3 + k][7 + a] = on_j[a] * twice_sign;
            }
        }
        Deformation { u, u_q, twice_sign }
    }

    /// u̇.
    #[inline(always)]
    fn rate<T: Real>(u_q: &Packed<T>, v: [&[T; 7]; 2]) -> [T; 6] {
        let mut packed = [T::zero(); PACKED];
        for k in 0..3 {
            packed[k] = v[1][k] - v[0][k];
        }
        packed[3..7].copy_from_slice(&v[0][3..]);
        packed[7..].copy_from_slice(&v[1][3..]);
        u_q.map(|row| dot(&row, &packed))
    }

    /// W.
    #[inline(always)]
    fn wrench<T: Real>(&self, u: &[T; 6], rate: &[T; 6]) -> [T; 6] {
        let mut wrench = [T::zero(); 6];
        for i in 0..6 {
            for j in 0..6 {
                wrench[i] += u[j] * self.stiffness[i][j] + rate[j] * self.damping[i][j];
            }
        }
        wrench
    }
}

#[inline(always)]
fn pack<T: Real>(rows: &RowBlocks<T, 7>) -> Packed<T> {
    let mut out = [[T::zero(); PACKED]; 6];
    for k in 0..3 {
        out[k][..3].copy_from_slice(&rows.0[1][k][..3]);
        out[k][3..7].copy_from_slice(&rows.0[0][k][3..]);
        out[k][7..].copy_from_slice(&rows.0[1][k][3..]);
    }
    out
}

/// out += M rows, skipping the zeros of M (most bushings are diagonal).
#[inline(always)]
fn add_product<T: Real>(m: &[[f64; 6]; 6], rows: &Packed<T>, out: &mut Packed<T>) {
    for i in 0..6 {
        for j in 0..6 {
            if m[i][j] != 0.0 {
                for c in 0..PACKED {
                    out[i][c] += rows[j][c] * m[i][j];
                }
            }
        }
    }
}

/// Where packed column c goes: side, coordinate; translations go to r_i too, with a minus.
#[inline(always)]
fn place(c: usize) -> (usize, usize) {
    match c {
        0..3 => (1, c),
        3..7 => (0, c),
        _ => (1, c - 4),
    }
}

/// out += leftᵀ right over the coordinates of both bodies.
#[inline(always)]
fn add_pair<T: Real>(left: &Packed<T>, right: &Packed<T>, out: &mut PairBlocks<T, 7>) {
    let mut product = [[T::zero(); PACKED]; PACKED];
    for k in 0..6 {
        // rows of rotations (3..6) do not depend on translations (columns 0..3)
        for r in if k < 3 { 0 } else { 3 }..PACKED {
            let factor = left[k][r];
            for c in 0..PACKED {
                product[r][c] += factor * right[k][c];
            }
        }
    }
    for r in 0..PACKED {
        let (s, i) = place(r);
        add_row(&product[r], &mut out.0[s], i);
        if r < 3 {
            add_row(&product[r].map(|x| -x), &mut out.0[0], i);
        }
    }
}

/// Adds a packed row to row `i` of the blocks of one side.
#[inline(always)]
fn add_row<T: Real>(row: &[T; PACKED], out: &mut [[[T; 7]; 7]; 2], i: usize) {
    for k in 0..3 {
        out[0][i][k] -= row[k];
        out[1][i][k] += row[k];
    }
    for k in 3..7 {
        out[0][i][k] += row[k];
        out[1][i][k] += row[k + 4];
    }
}

impl ForceElement<7> for Bushing {
    fn evaluate<T: Real>(&self, input: &ForceInput<'_, T, 7>, out: &mut ForceOutput<T, 7>) {
        let ForceInput { q, v, .. } = *input;
        let ([pi, pj], [vi, vj]) = (q.map(euler), v.map(euler));
        let points = &self.translation.points;
        let link = Vector::Link.jet::<T, Spatial, 7, 4>(points, q);
        // d and its rate in axes of the first body, where those of the bushing stand still.
        let (inverse, inverse_rate) = (conjugate(&pi), conjugate(&vi));
        let d = rotate(&inverse, &link.x);
        let turning = slope(&inverse, &link.x).map(|row| dot(&row, &inverse_rate));
        let d_rate = sum(&rotate(&inverse, &link.d.times(v)), &turning);
        let (mut u, mut rate) = ([T::zero(); 6], [T::zero(); 6]);
        for k in 0..3 {
            let axis = lift(&self.axes[k]);
            (u[k], rate[k]) = (dot(&axis, &d), dot(&axis, &d_rate));
        }
        let twice_sign = 2.0_f64.copysign(dot(&self.form_rows(0, &pi, &pj).0, &pi).value());
        let mut rows = [([T::zero(); 4], [T::zero(); 4]); 3];
        for k in 0..3 {
            rows[k] = self.form_rows(k + 1, &pi, &pj);
            u[3 + k] = dot(&rows[k].0, &pi) * twice_sign;
            rate[3 + k] = (dot(&rows[k].0, &vi) + dot(&rows[k].1, &vj)) * twice_sign;
        }
        let wrench = self.wrench(&u, &rate);
        // The force in axes of the first body, at whose turning its link's components change.
        let mut force = [T::zero(); 3];
        for k in 0..3 {
            add_scaled(&mut force, -wrench[k], &lift(&self.axes[k]));
        }
        out.z_rate = T::zero();
        out.q = link.d.transposed_times(&rotate(&pi, &force));
        for (row, x) in slope(&pi, &force).iter().zip(&link.x) {
            for a in 0..4 {
                out.q[0][3 + a] += *x * row[a];
            }
        }
        for k in 0..3 {
            let moment = wrench[3 + k] * -twice_sign;
            for a in 0..4 {
                out.q[0][3 + a] += moment * rows[k].0[a];
                out.q[1][3 + a] += moment * rows[k].1[a];
            }
        }
    }

    fn blocks<T: Real>(&self, input: &ForceInput<'_, T, 7>, out: &mut ForceBlocks<T, 7>) {
        *out = ForceBlocks::zero();
        let Deformation { u, u_q, twice_sign } = self.deformation(input.q);
        let wrench = self.wrench(&u, &Self::rate(&u_q, input.v));
        let mut weighted = [[T::zero(); PACKED]; 6];
        add_product(&self.stiffness, &u_q, &mut weighted);
        if self.damped {
            let mut rows = RowBlocks::zero();
            self.translation.directional(input.q, input.v, &mut rows);
            let mut change = pack(&rows);
            let [pi, pj] = input.v.map(euler);
            for k in 0..3 {
                let (on_i, on_j) = self.form_rows(k + 1, &pi, &pj);
                for a in 0..4 {
                    change[3 + k][3 + a] = on_i[a] * twice_sign;
                    change[3 + k][7 + a] = on_j[a] * twice_sign;
                }
            }
            add_product(&self.damping, &change, &mut weighted);
            let mut damped = [[T::zero(); PACKED]; 6];
            add_product(&self.damping, &u_q, &mut damped);
            add_pair(&u_q, &damped, &mut out.c);
        }
        add_pair(&u_q, &weighted, &mut out.k);
        self.translation.add_hessian(input.q, &wrench, &mut out.k);
        for k in 0..3 {
            let factor = wrench[3 + k] * twice_sign;
            for a in 0..4 {
                for b in 0..4 {
                    let value = factor * self.forms[k + 1][a][b];
                    out.k.0[0][1][3 + a][3 + b] += value;
                    out.k.0[1][0][3 + b][3 + a] += value;
                }
            }
        }
    }

    fn energy(&self, input: &ForceInput<'_, f64, 7>) -> Energy {
        let Deformation { u, u_q, .. } = self.deformation(input.q);
        let rate = Self::rate(&u_q, input.v);
        let zero = [0.0; 6];
        Energy {
            potential: 0.5 * dot(&u, &self.wrench(&u, &zero)),
            dissipated: dot(&rate, &self.wrench(&zero, &rate)),
            supplied: 0.0,
        }
    }

    fn quantities(&self) -> &'static [Quantity] {
        QUANTITIES
    }

    fn quantity(&self, index: usize, input: &ForceInput<'_, f64, 7>, out: &mut [f64]) {
        let Deformation { u, u_q, twice_sign } = self.deformation(input.q);
        if index == 0 {
            out[..6].copy_from_slice(&u);
            return;
        }
        let wrench = self.wrench(&u, &Self::rate(&u_q, input.v));
        if index == 1 {
            for k in 0..3 {
                out[k] = -wrench[k];
            }
            return;
        }
        let [pi, pj] = input.q.map(euler);
        let relative: [f64; 4] = std::array::from_fn(|k| dot(&self.form_rows(k, &pi, &pj).0, &pi));
        // −sign(ε₀) (ε₀ I + ε̃) W_e
        let (w, e) = (&wrench[3..], &relative[1..]);
        for k in 0..3 {
            let (a, b) = ((k + 1) % 3, (k + 2) % 3);
            let moment = relative[0] * w[k] + e[a] * w[b] - e[b] * w[a];
            out[k] = -0.5 * twice_sign * moment;
        }
    }
}
