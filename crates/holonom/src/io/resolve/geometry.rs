//! Small vectors: from ground axes of the design configuration into bodies.

pub(super) type Vec3 = [f64; 3];
/// `[row][column]`.
pub(super) type Mat3 = [[f64; 3]; 3];

pub(super) const IDENTITY: Mat3 = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Pose of a body (or of the ground) in the design configuration.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pose {
    pub(super) origin: Vec3,
    /// Turns body axes into ground axes.
    pub(super) rotation: Mat3,
}

impl Pose {
    pub(super) const GROUND: Self = Self { origin: [0.0; 3], rotation: IDENTITY };

    /// A point of ground axes, in body axes from the body origin.
    pub(super) fn point_to_body(&self, point: Vec3) -> Vec3 {
        self.direction_to_body([0, 1, 2].map(|i| point[i] - self.origin[i]))
    }

    pub(super) fn point_to_ground(&self, point: Vec3) -> Vec3 {
        let turned = times(&self.rotation, point);
        [0, 1, 2].map(|i| turned[i] + self.origin[i])
    }

    pub(super) fn direction_to_body(&self, v: Vec3) -> Vec3 {
        [0, 1, 2].map(|j| (0..3).map(|i| self.rotation[i][j] * v[i]).sum())
    }

    pub(super) fn direction_to_ground(&self, v: Vec3) -> Vec3 {
        times(&self.rotation, v)
    }

    /// Axes given as columns in ground axes, in body axes.
    pub(super) fn axes_to_body(&self, axes: &Mat3) -> Mat3 {
        from_columns([0, 1, 2].map(|c| self.direction_to_body(column(axes, c))))
    }
}

pub(super) fn planar_rotation(angle: f64) -> Mat3 {
    let (s, c) = angle.sin_cos();
    [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
}

/// A(p) = (e0² − eᵀe) I + 2 e eᵀ + 2 e0 ẽ.
pub(super) fn spatial_rotation([e0, e1, e2, e3]: [f64; 4]) -> Mat3 {
    let d = e0 * e0 - e1 * e1 - e2 * e2 - e3 * e3;
    [
        [d + 2.0 * e1 * e1, 2.0 * (e1 * e2 - e0 * e3), 2.0 * (e1 * e3 + e0 * e2)],
        [2.0 * (e1 * e2 + e0 * e3), d + 2.0 * e2 * e2, 2.0 * (e2 * e3 - e0 * e1)],
        [2.0 * (e1 * e3 - e0 * e2), 2.0 * (e2 * e3 + e0 * e1), d + 2.0 * e3 * e3],
    ]
}

fn times(a: &Mat3, v: Vec3) -> Vec3 {
    a.map(|row| dot(row, v))
}

pub(super) fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn distance(a: Vec3, b: Vec3) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1]).hypot(a[2] - b[2])
}

/// The unit vector along `v`, if `v` has a direction.
pub(super) fn unit(v: Vec3) -> Option<Vec3> {
    // Scaled first, so that neither tiny nor huge vectors lose their direction.
    let largest = v.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    if largest < 1e-100 {
        return None;
    }
    let v = v.map(|x| x / largest);
    let length = dot(v, v).sqrt();
    Some(v.map(|x| x / length))
}

pub(super) fn column(a: &Mat3, c: usize) -> Vec3 {
    [a[0][c], a[1][c], a[2][c]]
}

fn from_columns([f, g, h]: [Vec3; 3]) -> Mat3 {
    [0, 1, 2].map(|i| [f[i], g[i], h[i]])
}

/// Right-handed axes f, g, h (columns) with h as given and f as near to `hint` as h allows.
pub(super) fn triad(h: Vec3, hint: Vec3) -> Mat3 {
    let along = dot(h, hint);
    let f = [0, 1, 2].map(|i| hint[i] - along * h[i]);
    // Where the hint is along h, the ground axis farthest from h serves.
    let f = unit(f).filter(|_| dot(f, f) > 1e-12).unwrap_or_else(|| {
        let farthest = (0..3).min_by(|&a, &b| h[a].abs().total_cmp(&h[b].abs())).unwrap_or(0);
        let e = IDENTITY[farthest];
        unit([0, 1, 2].map(|i| e[i] - h[farthest] * h[i])).unwrap_or(e)
    });
    from_columns([f, cross(h, f), h])
}

/// A vector turned by the least rotation that makes the first axis, of unit length, parallel to the second.
pub(super) fn turned_least([first, second]: [Vec3; 2], x: Vec3) -> Vec3 {
    let cosine = dot(first, second);
    let second = second.map(|c| c * cosine.signum());
    let v = cross(first, second);
    let (across, along) = (cross(v, x), dot(v, x) / (1.0 + cosine.abs()));
    [0, 1, 2].map(|i| cosine.abs() * x[i] + across[i] + along * v[i])
}

/// Axes with the first along `f` and the second in the half plane of `g`.
pub(super) fn triad_of_first_two(f: Vec3, g: Vec3) -> Option<Mat3> {
    let h = unit(cross(f, g))?;
    Some(from_columns([f, cross(h, f), h]))
}

/// Planar axes with f along the given direction.
pub(super) fn planar_axes(f: Vec3) -> Mat3 {
    [[f[0], -f[1], 0.0], [f[1], f[0], 0.0], [0.0, 0.0, 1.0]]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_right_handed_and_orthonormal(a: &Mat3) -> bool {
        let [f, g, h] = [0, 1, 2].map(|c| column(a, c));
        let unit = |v| (dot(v, v) - 1.0).abs() < 1e-14;
        unit(f) && unit(g) && dot(f, g).abs() < 1e-14 && distance(cross(f, g), h) < 1e-14
    }

    #[test] // independent truth: the axis comes to the other one, what is across both stays, lengths are kept
    fn the_least_turn_makes_axes_parallel_and_turns_about_what_is_across() {
        for second in [[0.0, 0.6, 0.8], [0.6, 0.0, -0.8], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]] {
            let axes = [[0.0, 0.0, 1.0], second];
            let turned = turned_least(axes, axes[0]);
            assert!(distance(turned, second.map(|c| c * second[2].signum())) < 1e-15);
            let across = cross(axes[0], second);
            assert!(distance(turned_least(axes, across), across) < 1e-15);
            let x = turned_least(axes, [0.3, -0.4, 1.2]);
            assert!((dot(x, x) - 1.69).abs() < 1e-14);
        }
    }

    #[test] // independent truth: the definition of a right-handed orthonormal triad
    fn triads_are_triads_for_every_axis_and_hint() {
        let some: Vec<Vec3> = (0..7)
            .flat_map(|i| (0..7).map(move |j| (i, j)))
            .map(|(i, j)| {
                let (a, b) = (0.9 * f64::from(i), 1.1 * f64::from(j));
                [a.cos() * b.cos(), a.sin() * b.cos(), b.sin()]
            })
            .chain(IDENTITY)
            .collect();
        for &h in &some {
            for &hint in &some {
                let t = triad(h, hint);
                assert!(is_right_handed_and_orthonormal(&t), "{h:?} {hint:?} {t:?}");
                assert!(distance(column(&t, 2), h) < 1e-15);
            }
        }
    }

    #[test] // independent truth: a turn by the angle φ about the axis u, Rodrigues' formula
    fn euler_parameters_turn_about_their_axis() {
        let (u, angle) = ([2.0 / 3.0, -1.0 / 3.0, 2.0 / 3.0], 0.8_f64);
        let (s, c) = (0.5 * angle).sin_cos();
        let a = spatial_rotation([c, s * u[0], s * u[1], s * u[2]]);
        let v = [0.3, -1.2, 0.7];
        let (uv, d) = (cross(u, v), dot(u, v));
        let expected = [0, 1, 2]
            .map(|i| v[i] * angle.cos() + uv[i] * angle.sin() + u[i] * d * (1.0 - angle.cos()));
        assert!(distance(times(&a, v), expected) < 1e-15);
    }

    #[test]
    fn a_point_goes_into_its_body_and_back() {
        let p = [0.5, 0.5, -0.5, 0.5];
        let pose = Pose { origin: [1.0, -2.0, 3.0], rotation: spatial_rotation(p) };
        let point = [0.3, 0.8, -0.4];
        assert!(distance(pose.point_to_ground(pose.point_to_body(point)), point) < 1e-15);
    }

    #[test]
    fn directions_of_any_size_are_found_and_zero_is_not_one() {
        for scale in [1e-90, 1.0, 1e300] {
            assert!((unit([3.0 * scale, 0.0, 4.0 * scale]).unwrap()[2] - 0.8).abs() < 1e-15);
        }
        assert_eq!(unit([0.0; 3]), None);
    }
}
