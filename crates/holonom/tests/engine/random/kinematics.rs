//! Motion near the design configuration by differences: consistent speeds and preloads.

use super::numbers::{
    IDENTITY, M3, Random, V3, add, apply, dot, norm, perpendicular, product, rank, scale,
    sine_vector, solve, sub, transpose, turn,
};
use super::{Between, Element, Joint, Kind, LONGEST, Law, Mechanism, STIFF};

/// Where the points of a body went: x → R x + t.
#[derive(Debug, Clone, Copy)]
struct Map {
    r: M3,
    t: V3,
}

const STAY: Map = Map { r: IDENTITY, t: [0.0; 3] };

impl Map {
    fn of(&self, point: &V3) -> V3 {
        add(&apply(&self.r, point), &self.t)
    }

    /// This one after `inner`.
    fn after(&self, inner: &Self) -> Self {
        Self { r: product(&self.r, &inner.r), t: self.of(&inner.t) }
    }
}

/// Step of differences, m or rad.
const STEP: f64 = 1e-4;

impl Joint {
    /// Motion of the second body against the first.
    fn map(&self, q: &[f64], planar: bool) -> Map {
        let [axis, second] = self.axes;
        let turned = |vector: V3| turn(&vector);
        let (r, shift) = match self.kind {
            Kind::Revolute => (turned(scale(&axis, q[0])), [0.0; 3]),
            Kind::Translational => (IDENTITY, scale(&axis, q[0])),
            Kind::Cylindrical => (turned(scale(&axis, q[0])), scale(&axis, q[1])),
            Kind::Universal => {
                (product(&turned(scale(&axis, q[0])), &turned(scale(&second, q[1]))), [0.0; 3])
            }
            Kind::Spherical => (turned([q[0], q[1], q[2]]), [0.0; 3]),
            Kind::Floating if planar => (turned([0.0, 0.0, q[2]]), [q[0], q[1], 0.0]),
            Kind::Floating => (turned([q[3], q[4], q[5]]), [q[0], q[1], q[2]]),
            Kind::Fixed | Kind::Distance => (IDENTITY, [0.0; 3]),
        };
        let point = &self.points[1];
        Map { r, t: add(&sub(point, &apply(&r, point)), &shift) }
    }
}

impl Mechanism {
    pub(super) fn coordinates(&self) -> usize {
        self.joints.iter().filter_map(|j| j.coordinates).map(|(_, count)| count).sum()
    }

    fn maps(&self, q: &[f64]) -> Vec<Map> {
        let mut out: Vec<Map> = Vec::new();
        for joint in &self.joints {
            let Some((first, count)) = joint.coordinates else { continue };
            let parent = joint.between[0].map_or(STAY, |b| out[b]);
            out.push(parent.after(&joint.map(&q[first..first + count], self.planar)));
        }
        out
    }

    /// Residuals of the joints that close loops, then the driven coordinates.
    fn hard(&self, q: &[f64]) -> Vec<f64> {
        let maps = self.maps(q);
        let mut out = Vec::new();
        for joint in self.joints.iter().filter(|j| j.coordinates.is_none()) {
            let [first, second] = ends(&maps, joint.between);
            let d = sub(&second.of(&joint.points[1]), &first.of(&joint.points[0]));
            let [a, b] = joint.axes;
            let f = perpendicular(&a);
            let g = super::numbers::cross(&a, &f);
            let axis = apply(&second.r, &b);
            let along = |x: &V3| apply(&first.r, x);
            match joint.kind {
                Kind::Distance => out.push(norm(&d)),
                Kind::Cylindrical => {
                    out.extend([f, g].iter().map(|x| dot(&along(x), &d)));
                }
                _ if self.planar => out.extend([d[0], d[1]]),
                _ => out.extend(d),
            }
            match joint.kind {
                Kind::Universal => out.push(dot(&along(&a), &axis)),
                Kind::Revolute | Kind::Cylindrical if !self.planar => {
                    out.extend([f, g].iter().map(|x| dot(&along(x), &axis)));
                }
                _ => {}
            }
        }
        out.extend(self.drivers.iter().map(|d| q[d.coordinate]));
        out
    }

    /// Deformation of an element: one number, or three and three.
    fn deformation(element: &Element, maps: &[Map]) -> Vec<f64> {
        let [first, second] = ends(maps, element.between);
        let relative = sine_vector(&product(&transpose(&first.r), &second.r));
        let [x, y] = [first.of(&element.points[0]), second.of(&element.points[1])];
        let axes = transpose(&element.axes);
        match element.law {
            Law::Tsda | Law::Maxwell => vec![norm(&sub(&y, &x))],
            Law::Rsda => vec![dot(&axes[2], &relative)],
            Law::Bushing(turning) => {
                let d = apply(&transpose(&first.r), &sub(&y, &x));
                let mut out = apply(&axes, &d).to_vec();
                if turning {
                    out.extend(apply(&axes, &relative));
                }
                out
            }
        }
    }

    /// Deformations of the settled elements, or of the others.
    fn deformations(&self, q: &[f64], settled: bool) -> Vec<f64> {
        let maps = self.maps(q);
        let elements = self.elements.iter().filter(|e| e.settled == settled);
        elements.flat_map(|e| Self::deformation(e, &maps)).collect()
    }

    /// Mass points with the inertia of the bodies.
    fn mass_points(&self, q: &[f64]) -> Vec<(f64, V3)> {
        let maps = self.maps(q);
        let mut out = Vec::new();
        for (body, map) in self.bodies.iter().zip(&maps) {
            let principal = transpose(&body.principal);
            for (axis, moment) in principal.iter().zip(&body.moments) {
                let arm = scale(axis, (3.0 * moment / body.mass).sqrt());
                for point in [add(&body.center, &arm), sub(&body.center, &arm)] {
                    out.push((body.mass / 6.0, map.of(&point)));
                }
            }
        }
        out
    }

    /// Rows ∂f/∂q at the design configuration.
    fn slopes(&self, f: impl Fn(&[f64]) -> Vec<f64>) -> Vec<Vec<f64>> {
        let n = self.coordinates();
        let mut q = vec![0.0; n];
        let mut rows = vec![vec![0.0; n]; f(&q).len()];
        for k in 0..n {
            let mut at = |s: f64| {
                q[k] = s * STEP;
                f(&q)
            };
            // Extrapolated central differences.
            let (a, b, c, d) = (at(1.0), at(-1.0), at(0.5), at(-0.5));
            q[k] = 0.0;
            for (i, row) in rows.iter_mut().enumerate() {
                row[k] = (8.0 * (c[i] - d[i]) - (a[i] - b[i])) / (6.0 * STEP);
            }
        }
        rows
    }

    /// d²f/dt² along constant rates.
    fn curvature(u: &[f64], f: impl Fn(&[f64]) -> Vec<f64>) -> Vec<f64> {
        let largest = u.iter().fold(1.0f64, |m, x| m.max(x.abs()));
        let dt = 3e-4 / largest;
        let at = |s: f64| f(&u.iter().map(|x| s * dt * x).collect::<Vec<_>>());
        let (a, b, c) = (at(-1.0), at(0.0), at(1.0));
        (0..a.len()).map(|i| (a[i] - 2.0 * b[i] + c[i]) / (dt * dt)).collect()
    }

    /// Rank of what loops and drivers prescribe and its smallest pivot over the first.
    pub(super) fn hard_rank(&self) -> (usize, f64) {
        rank(&self.slopes(|q| self.hard(q)), 1e-6)
    }

    /// Whether something can move while settled elements keep their shape.
    pub(super) fn can_move(&self) -> bool {
        let mut rows = self.slopes(|q| self.hard(q));
        rows.extend(self.slopes(|q| self.deformations(q, true)));
        rank(&rows, 1e-6).0 < self.coordinates()
    }

    /// Draws speeds, finds preloads, and writes the consequences into the bodies and elements.
    pub(super) fn set_in_motion(&mut self, r: &mut Random, nudge: f64) {
        let n = self.coordinates();
        self.freedom = n - self.hard_rank().0;
        let fastest = if self.road.is_some() || self.adrift { 8.0 } else { 50.0 };
        let size = if r.chance(0.1) { 0.0 } else { r.logarithmic(1.0, fastest) };
        let mut u: Vec<f64> = (0..n).map(|_| size * r.range(-1.0, 1.0)).collect();
        for joint in &self.joints {
            let Some((first, _)) = joint.coordinates else { continue };
            let slides = match joint.kind {
                Kind::Translational => first..first + 1,
                Kind::Cylindrical => first + 1..first + 2,
                Kind::Floating => first..first + if self.planar { 2 } else { 3 },
                _ => continue,
            };
            u[slides].iter_mut().for_each(|u| *u = (0.2 * *u).clamp(-2.0, 2.0));
        }
        let nudges: Vec<f64> = (0..n).map(|_| nudge * r.range(-1.0, 1.0)).collect();
        self.drop_driven_elements();
        let hard = self.slopes(|q| self.hard(q));
        let soft = self.slopes(|q| self.deformations(q, true));
        let rates: Vec<f64> = self.drivers.iter().map(|d| d.motion.start()[1]).collect();
        let mut aims = vec![0.0; hard.len() + soft.len()];
        aims[hard.len() - rates.len()..hard.len()].copy_from_slice(&rates);
        let rows: Vec<Vec<f64>> = hard.iter().chain(&soft).cloned().collect();
        let unit: Vec<Vec<f64>> =
            (0..n).map(|i| (0..n).map(|j| f64::from(i == j)).collect()).collect();
        let project = |u: &mut Vec<f64>, count: usize| {
            for _ in 0..3 {
                let give: Vec<f64> =
                    (0..count).map(|i| if i < hard.len() { 1e-9 } else { 1e-6 }).collect();
                let rows = &rows[..count];
                let residual: Vec<f64> =
                    rows.iter().zip(&aims).map(|(row, aim)| aim - along(row, u)).collect();
                let (change, _) = saddle(&unit, rows, &give, &vec![0.0; n], &residual);
                u.iter_mut().zip(&change).for_each(|(u, c)| *u += c);
            }
        };
        // What stays free of settled elements moves at the drawn speed.
        for _ in 0..2 {
            project(&mut u, rows.len());
            self.take_speeds(&u);
            let speed = self.speed().max(self.sliding());
            let factor = (size / speed).min(if speed > 0.02 * size { 50.0 } else { 0.0 });
            if factor > 0.0 {
                u.iter_mut().for_each(|x| *x *= factor);
            }
        }
        u.iter_mut().zip(&nudges).for_each(|(u, nudge)| *u += nudge);
        project(&mut u, rows.len());
        project(&mut u, hard.len());
        self.take_speeds(&u);
        let frequencies = self.drivers.iter().map(|d| d.motion.start()[1].abs());
        let turning = frequencies.fold(self.speed(), f64::max);
        let small = self.bodies.len() <= 2 && !self.adrift && r.chance(0.3);
        let span = if small {
            (100.0 / turning).clamp(1.0, LONGEST)
        } else {
            (25.0 / turning).clamp(0.4, 1.5)
        };
        self.span = (span * 100.0).round() / 100.0;
        self.preload(&u, &rows, hard.len());
    }

    /// Removes the stiff elements that drivers deform, whatever the motion.
    fn drop_driven_elements(&mut self) {
        if self.drivers.is_empty() {
            return;
        }
        let n = self.coordinates();
        let mut rows = self.slopes(|q| self.hard(q));
        let mut known = rank(&rows, 1e-6).0;
        let mut kept = Vec::new();
        for element in &self.elements {
            let parts = self.slopes(|q| Self::deformation(element, &self.maps(q)));
            let free = parts.iter().filter(|row| along(row, row) > 1e-12).count();
            let mut with = rows.clone();
            with.extend(parts);
            let rank = rank(&with, 1e-4).0;
            if element.stiffness < 1e3 || rank == known + free {
                kept.push(element.clone());
                if element.stiffness >= 1e3 {
                    (rows, known) = (with, rank);
                }
            }
        }
        debug_assert!(known <= n);
        self.elements = kept;
    }

    /// Largest speed of a body origin over 0.2 m, 1/s.
    fn sliding(&self) -> f64 {
        self.bodies.iter().map(|b| norm(&b.velocity) / 0.2).fold(0.0, f64::max)
    }

    fn take_speeds(&mut self, u: &[f64]) {
        let n = u.len();
        let dt = STEP / u.iter().fold(1.0f64, |m, x| m.max(x.abs()));
        let at = |s: f64| self.maps(&(0..n).map(|k| s * dt * u[k]).collect::<Vec<_>>());
        let (a, b, c, d) = (at(1.0), at(-1.0), at(0.5), at(-0.5));
        let mut speeds = Vec::new();
        for (i, body) in self.bodies.iter().enumerate() {
            let slope = |f: &dyn Fn(&Map) -> V3| -> V3 {
                let (a, b, c, d) = (f(&a[i]), f(&b[i]), f(&c[i]), f(&d[i]));
                std::array::from_fn(|k| (8.0 * (c[k] - d[k]) - (a[k] - b[k])) / (6.0 * dt))
            };
            let origin = Self::origin(body);
            speeds.push((slope(&|m| m.of(&origin)), slope(&|m| sine_vector(&m.r))));
        }
        for (body, (velocity, angular_velocity)) in self.bodies.iter_mut().zip(speeds) {
            (body.velocity, body.angular_velocity) = (velocity, angular_velocity);
        }
    }

    /// Forces of the settled elements that leave their ends without relative acceleration, and the
    /// fastest vibration and decay.
    fn preload(&mut self, u: &[f64], rows: &[Vec<f64>], hard: usize) {
        let n = u.len();
        let flat =
            |q: &[f64]| -> Vec<f64> { self.mass_points(q).iter().flat_map(|(_, x)| *x).collect() };
        let slopes = self.slopes(flat);
        let bias = Self::curvature(u, flat);
        let masses: Vec<f64> = self.mass_points(&vec![0.0; n]).iter().map(|(m, _)| *m).collect();
        let mut mass = vec![vec![0.0; n]; n];
        let mut push = vec![0.0; n];
        for (k, slope) in slopes.iter().enumerate() {
            let m = masses[k / 3];
            for i in 0..n {
                push[i] += m * slope[i] * (self.gravity[k % 3] - bias[k]);
                for j in 0..n {
                    mass[i][j] += m * slope[i] * slope[j];
                }
            }
        }
        for i in 0..n {
            mass[i][i] += 1e-12;
        }
        // Forces of the others: preload and damping.
        let loose = self.slopes(|q| self.deformations(q, false));
        let mut row = 0;
        for element in self.elements.iter().filter(|e| !e.settled) {
            let parts = Self::deformation(element, &self.maps(&vec![0.0; n])).len();
            for part in 0..parts {
                let slope = &loose[row];
                row += 1;
                let damping = match element.law {
                    Law::Maxwell => 0.0,
                    // A transient is over at once.
                    _ if element.stiffness > STIFF => 0.0,
                    _ => element.damping * element.stiffness * along(slope, u),
                };
                let elastic = element.preload.get(part).copied().unwrap_or(0.0);
                push.iter_mut().zip(slope).for_each(|(p, s)| *p -= s * (elastic + damping));
            }
        }
        let mut aims = Self::curvature(u, |q| self.hard(q));
        aims.extend(Self::curvature(u, |q| self.deformations(q, true)));
        aims.iter_mut().for_each(|x| *x = -*x);
        let first = hard - self.drivers.len();
        for (k, driver) in self.drivers.iter().enumerate() {
            aims[first + k] = driver.motion.start()[2];
        }
        let give = vec![1e-6; rows.len()];
        let (_, forces) = saddle(&mass, rows, &give, &push, &aims);
        let mut next = hard;
        let mut sums = [0.0f64; 2];
        for element in self.elements.iter().filter(|e| e.settled) {
            let parts = Self::deformation(element, &self.maps(&vec![0.0; n])).len();
            for part in 0..parts {
                let turning = if part < 3 { 1.0 } else { element.lever };
                add_rates(&mut sums, element, turning, &mass, &rows[next + part]);
            }
            next += parts;
        }
        let mut next = hard;
        row = 0;
        let design = self.maps(&vec![0.0; n]);
        for i in 0..self.elements.len() {
            let parts = Self::deformation(&self.elements[i], &design).len();
            if self.elements[i].settled {
                let preload = &mut self.elements[i].preload;
                let count = preload.len();
                preload.copy_from_slice(&forces[next..next + count]);
                next += parts;
            } else {
                for slope in &loose[row..row + parts] {
                    add_rates(&mut sums, &self.elements[i], 1.0, &mass, slope);
                }
                row += parts;
            }
        }
        self.fastest = sums[0].sqrt().max(sums[1]);
    }
}

/// Adds to the squares of frequencies and to the rates of decay what one row of an element gives.
fn add_rates(sums: &mut [f64; 2], element: &Element, factor: f64, mass: &[Vec<f64>], row: &[f64]) {
    let mobility = along(row, &solve(mass.to_vec(), row));
    let k = element.stiffness * factor;
    let [branch, time] = element.branch.unwrap_or([0.0, f64::INFINITY]);
    sums[0] += (1.0 + branch) * k * mobility;
    sums[1] += 1.0 / time;
    sums[1] += match element.law {
        Law::Maxwell => 1.0 / element.damping,
        _ => element.damping * k * mobility,
    };
}

fn along(row: &[f64], u: &[f64]) -> f64 {
    row.iter().zip(u).map(|(a, b)| a * b).sum()
}

fn ends(maps: &[Map], between: Between) -> [Map; 2] {
    between.map(|b| b.map_or(STAY, |b| maps[b]))
}

/// Solves M x + Aᵀ f = b, A x − give f = c: x and f.
fn saddle(
    mass: &[Vec<f64>],
    rows: &[Vec<f64>],
    give: &[f64],
    b: &[f64],
    c: &[f64],
) -> (Vec<f64>, Vec<f64>) {
    let (n, m) = (mass.len(), rows.len());
    let mut matrix = vec![vec![0.0; n + m]; n + m];
    for i in 0..n {
        matrix[i][..n].copy_from_slice(&mass[i]);
    }
    for (k, row) in rows.iter().enumerate() {
        matrix[n + k][..n].copy_from_slice(row);
        for i in 0..n {
            matrix[i][n + k] = row[i];
        }
        matrix[n + k][n + k] = -give[k];
    }
    let right: Vec<f64> = b.iter().chain(c).copied().collect();
    let mut x = solve(matrix, &right);
    let forces = x.split_off(n);
    (x, forces)
}
