//! Volume, centroid and second moments of simple solids and of what a closed surface encloses.

/// `[row][column]`.
type Mat3 = [[f64; 3]; 3];

/// The integrals of 1, x and x xᵀ over a solid.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Solid {
    /// Volume.
    pub volume: f64,
    /// Centroid; the origin where there is no volume.
    pub centroid: [f64; 3],
    /// ∫ (x − c)(x − c)ᵀ dV about the centroid c.
    pub second: Mat3,
}

/// An edge of a surface that does not lie between two triangles of one orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpenEdge {
    /// Indices of its ends.
    pub ends: [usize; 2],
    /// Triangles that run through it in this direction, and in the other.
    pub triangles: [usize; 2],
}

impl Solid {
    /// A box of these edges along the axes, about the origin.
    pub fn cuboid(size: [f64; 3]) -> Self {
        let volume = size[0] * size[1] * size[2];
        Self::about_origin(volume, size.map(|edge| volume * edge * edge / 12.0))
    }

    /// A circular cylinder along z, about the origin.
    pub fn cylinder(radius: f64, length: f64) -> Self {
        let volume = std::f64::consts::PI * radius * radius * length;
        let across = 0.25 * volume * radius * radius;
        Self::about_origin(volume, [across, across, volume * length * length / 12.0])
    }

    /// A ball about the origin.
    pub fn sphere(radius: f64) -> Self {
        let volume = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
        Self::about_origin(volume, [0.2 * volume * radius * radius; 3])
    }

    /// A cylinder along z with half a ball at either end; `length` is that of the cylinder.
    pub fn capsule(radius: f64, length: f64) -> Self {
        let (r, l) = (radius, length);
        let (middle, ends) = (Self::cylinder(r, l), Self::sphere(r));
        // A half ball has its centroid at 3/8 r from its flat side, which is at l/2.
        let along = 0.25 * l * l + 0.375 * l * r + 0.2 * r * r;
        let across = middle.second[0][0] + ends.second[0][0];
        let along = middle.second[2][2] + ends.volume * along;
        Self::about_origin(middle.volume + ends.volume, [across, across, along])
    }

    /// What a surface of triangles encloses, by Gauss's theorem: the sum over the tetrahedra that its
    /// triangles span with one point.
    ///
    /// # Errors
    /// The first edge that is open, or that triangles of different orientation share.
    pub fn enclosed(vertices: &[[f64; 3]], faces: &[[usize; 3]]) -> Result<Self, OpenEdge> {
        if let Some(edge) = open_edge(faces) {
            return Err(edge);
        }
        // A point among the vertices, so that a surface far from the origin loses no digits.
        let base = vertices.first().copied().unwrap_or_default();
        let (mut volume, mut first, mut second) = (0.0, [0.0; 3], [[0.0; 3]; 3]);
        for face in faces {
            let [a, b, c] = face.map(|i| [0, 1, 2].map(|k| vertices[i][k] - base[k]));
            let det = a[0] * (b[1] * c[2] - b[2] * c[1])
                + a[1] * (b[2] * c[0] - b[0] * c[2])
                + a[2] * (b[0] * c[1] - b[1] * c[0]);
            let sum = [0, 1, 2].map(|k| a[k] + b[k] + c[k]);
            volume += det / 6.0;
            for i in 0..3 {
                first[i] += det / 24.0 * sum[i];
                for j in 0..3 {
                    let squares = a[i] * a[j] + b[i] * b[j] + c[i] * c[j];
                    second[i][j] += det / 120.0 * (squares + sum[i] * sum[j]);
                }
            }
        }
        if volume == 0.0 {
            return Ok(Self::default());
        }
        let from_base = first.map(|x| x / volume);
        for i in 0..3 {
            for j in 0..3 {
                second[i][j] -= volume * from_base[i] * from_base[j];
            }
        }
        // Triangles that all face inwards enclose the same.
        let sign = volume.signum();
        Ok(Self {
            volume: sign * volume,
            centroid: [0, 1, 2].map(|k| base[k] + from_base[k]),
            second: second.map(|row| row.map(|x| sign * x)),
        })
    }

    /// The same turned by a rotation matrix, then moved.
    #[must_use]
    pub fn placed(&self, rotation: &Mat3, position: [f64; 3]) -> Self {
        let turned = |v: [f64; 3]| rotation.map(|row| (0..3).map(|k| row[k] * v[k]).sum::<f64>());
        let centroid = turned(self.centroid);
        let mut second = [[0.0; 3]; 3];
        for i in 0..3 {
            for j in 0..3 {
                for k in 0..3 {
                    for l in 0..3 {
                        second[i][j] += rotation[i][k] * self.second[k][l] * rotation[j][l];
                    }
                }
            }
        }
        Self { centroid: [0, 1, 2].map(|k| centroid[k] + position[k]), second, ..*self }
    }

    /// All integrals times a factor: of a density, the mass in the place of the volume.
    #[must_use]
    pub fn times(&self, factor: f64) -> Self {
        Self {
            volume: factor * self.volume,
            second: self.second.map(|row| row.map(|x| factor * x)),
            ..*self
        }
    }

    /// Two solids as one, by the theorem of parallel axes.
    #[must_use]
    pub fn with(&self, other: &Self) -> Self {
        let volume = self.volume + other.volume;
        if volume == 0.0 {
            return *self;
        }
        let part = other.volume / volume;
        let apart = [0, 1, 2].map(|k| other.centroid[k] - self.centroid[k]);
        let mut second = self.second;
        for i in 0..3 {
            for j in 0..3 {
                second[i][j] += other.second[i][j] + self.volume * part * apart[i] * apart[j];
            }
        }
        let centroid = [0, 1, 2].map(|k| self.centroid[k] + part * apart[k]);
        Self { volume, centroid, second }
    }

    /// tr(S) I − S with S the second moments: the inertia tensor about the centroid, if the volume is a
    /// mass.
    pub fn inertia(&self) -> Mat3 {
        let s = &self.second;
        let trace = s[0][0] + s[1][1] + s[2][2];
        let mut out = s.map(|row| row.map(|x| -x));
        for k in 0..3 {
            out[k][k] = trace - s[k][k];
        }
        out
    }

    fn about_origin(volume: f64, diagonal: [f64; 3]) -> Self {
        let [x, y, z] = diagonal;
        let second = [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]];
        Self { volume, centroid: [0.0; 3], second }
    }
}

/// The first edge, by its ends, that is not run through once in each direction.
fn open_edge(faces: &[[usize; 3]]) -> Option<OpenEdge> {
    let mut edges: Vec<([usize; 2], bool)> = Vec::with_capacity(3 * faces.len());
    for &[a, b, c] in faces {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            edges.push(([from.min(to), from.max(to)], from < to));
        }
    }
    edges.sort_unstable();
    edges.chunk_by(|a, b| a.0 == b.0).find_map(|same| {
        let forth = same.iter().filter(|(_, forth)| *forth).count();
        let triangles = [forth, same.len() - forth];
        (triangles != [1, 1]).then_some(OpenEdge { ends: same[0].0, triangles })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    type Inside = dyn Fn([f64; 3]) -> bool;

    /// The integrals by a sum over cells of a fine grid in the box from −`half` to `half`.
    fn by_cells(half: [f64; 3], count: usize, inside: &Inside) -> Solid {
        let edge = half.map(|h| 2.0 * h / count as f64);
        let cell = edge[0] * edge[1] * edge[2];
        let (mut volume, mut first, mut second) = (0.0, [0.0; 3], [[0.0; 3]; 3]);
        for n in 0..count.pow(3) {
            let at = [n % count, n / count % count, n / count / count];
            let x = [0, 1, 2].map(|k| (at[k] as f64 + 0.5) * edge[k] - half[k]);
            if inside(x) {
                volume += cell;
                for i in 0..3 {
                    first[i] += cell * x[i];
                    for j in 0..3 {
                        second[i][j] += cell * x[i] * x[j];
                    }
                }
            }
        }
        let centroid = first.map(|s| s / volume);
        for i in 0..3 {
            for j in 0..3 {
                second[i][j] -= volume * centroid[i] * centroid[j];
            }
        }
        Solid { volume, centroid, second }
    }

    #[track_caller]
    fn assert_near(found: &Solid, expected: &Solid, part: f64) {
        let size = expected.volume.cbrt();
        let near = |a: f64, b: f64, scale: f64| (a - b).abs() <= part * scale;
        let v = expected.volume;
        assert!(near(found.volume, v, v), "{found:?} {expected:?}");
        for i in 0..3 {
            assert!(near(found.centroid[i], expected.centroid[i], size), "{found:?} {expected:?}");
            for j in 0..3 {
                let (a, b) = (found.second[i][j], expected.second[i][j]);
                assert!(near(a, b, v * size * size), "{found:?} {expected:?}");
            }
        }
    }

    fn turn() -> Mat3 {
        let (u, angle) = ([2.0 / 3.0, -1.0 / 3.0, 2.0 / 3.0], 0.8_f64);
        let (s, c) = (0.5 * angle).sin_cos();
        crate::math::spatial::rotation_matrix(&[c, s * u[0], s * u[1], s * u[2]])
    }

    /// A box as twelve triangles that face outwards.
    fn triangles_of_box(size: [f64; 3]) -> (Vec<[f64; 3]>, Vec<[usize; 3]>) {
        let vertices = (0..8)
            .map(|n| [0, 1, 2].map(|k| if n >> k & 1 == 1 { 0.5 } else { -0.5 } * size[k]))
            .collect();
        let quads =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let faces = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        (vertices, faces)
    }

    #[test] // independent truth: sums over the cells of a fine grid
    fn closed_forms_are_what_cells_sum_up_to() {
        let (r, l) = (0.3, 0.8);
        let in_cylinder = move |x: [f64; 3]| x[0].hypot(x[1]) <= r && x[2].abs() <= 0.5 * l;
        let in_capsule = move |x: [f64; 3]| {
            let beyond = (x[2].abs() - 0.5 * l).max(0.0);
            x[0].hypot(x[1]).hypot(beyond) <= r
        };
        let in_ball = move |x: [f64; 3]| x[0].hypot(x[1]).hypot(x[2]) <= r;
        let cases: [(Solid, [f64; 3], &Inside); 3] = [
            (Solid::cylinder(r, l), [r, r, 0.5 * l], &in_cylinder),
            (Solid::capsule(r, l), [r, r, 0.5 * l + r], &in_capsule),
            (Solid::sphere(r), [r; 3], &in_ball),
        ];
        for (formula, half, inside) in cases {
            assert_near(&formula, &by_cells(half, 120, inside), 2e-3);
        }
    }

    #[test] // independent truth: moments of inertia in tables
    fn inertia_is_that_of_tables() {
        let j = Solid::cuboid([0.2, 0.3, 0.5]).times(1000.0).inertia();
        let m = 1000.0 * 0.2 * 0.3 * 0.5;
        for (k, sum) in [(0, 0.09 + 0.25), (1, 0.04 + 0.25), (2, 0.04 + 0.09)] {
            assert!((j[k][k] - m / 12.0 * sum).abs() < 1e-12 * m);
        }
        let ball = Solid::sphere(0.7).times(2.0);
        assert!((ball.inertia()[1][1] - 0.4 * ball.volume * 0.49).abs() < 1e-13);
        let disc = Solid::cylinder(0.4, 0.1).times(7850.0);
        let (axial, across) = (disc.inertia()[2][2], disc.inertia()[0][0]);
        assert!((axial - 0.5 * disc.volume * 0.16).abs() < 1e-12 * axial);
        let table = disc.volume * (3.0 * 0.16 + 0.01) / 12.0;
        assert!((across - table).abs() < 1e-12 * across);
    }

    #[test] // independent truth: the formula of the box, and cells of a turned L of two boxes
    fn a_closed_surface_has_the_moments_of_what_it_encloses() {
        let size = [0.4, 0.7, 1.1];
        let (mut vertices, mut faces) = triangles_of_box(size);
        let solid = Solid::enclosed(&vertices, &faces).unwrap();
        assert_near(&solid, &Solid::cuboid(size), 1e-14);
        // Far away and inside out it is the same body.
        for vertex in &mut vertices {
            *vertex = [0, 1, 2].map(|k| vertex[k] + [1e5, -2e5, 3e5][k]);
        }
        faces.iter_mut().for_each(|face| face.swap(0, 1));
        let far = Solid::enclosed(&vertices, &faces).unwrap();
        let expected = Solid::cuboid(size).placed(&turn_none(), [1e5, -2e5, 3e5]);
        assert_near(&far, &expected, 1e-9);
    }

    fn turn_none() -> Mat3 {
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    }

    #[test] // independent truth: cells of the union, in axes of the ground
    fn solids_are_turned_moved_and_joined() {
        let (a, b) = ([0.3, 0.5, 0.2], [0.6, 0.2, 0.1]);
        let (rotation, place) = (turn(), [0.1, 0.6, -0.2]);
        let union = Solid::cuboid(a).with(&Solid::cuboid(b).placed(&rotation, place));
        let inside = move |x: [f64; 3]| {
            let in_a = (0..3).all(|k| x[k].abs() <= 0.5 * a[k]);
            let from: [f64; 3] = [0, 1, 2].map(|k| x[k] - place[k]);
            let local: [f64; 3] = [0, 1, 2].map(|k| (0..3).map(|i| rotation[i][k] * from[i]).sum());
            let in_b = (0..3).all(|k| local[k].abs() <= 0.5 * b[k]);
            // Where they overlap, both count.
            assert!(!(in_a && in_b));
            in_a || in_b
        };
        assert_near(&union, &by_cells([0.6, 1.0, 0.8], 160, &inside), 4e-3);
    }

    #[test]
    fn an_open_surface_is_told_by_its_first_edge() {
        let (vertices, mut faces) = triangles_of_box([1.0; 3]);
        let missing = faces.pop().unwrap();
        let open = Solid::enclosed(&vertices, &faces).unwrap_err();
        assert_eq!(open.triangles.iter().sum::<usize>(), 1);
        assert!(open.ends.iter().all(|end| missing.contains(end)));
        faces.push([missing[1], missing[0], missing[2]]); // one triangle inside out
        let turned = Solid::enclosed(&vertices, &faces).unwrap_err();
        assert!(turned.triangles.contains(&2));
    }
}
