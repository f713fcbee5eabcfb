//! Orientations in space, given in one of four ways, become Euler parameters.

use super::geometry::{Vec3, unit};
use crate::error::{Code, Diagnostic};
use crate::io::schema::{AxisAngle, Body, EulerAngles, InitialBody, Placing};
use crate::math::spatial::product;
use crate::model::implausible_angle;

const UNTURNED: [f64; 4] = [1.0, 0.0, 0.0, 0.0];

/// The ways to state how a body is turned.
pub(super) struct Turned {
    euler_parameters: Option<[f64; 4]>,
    axis_angle: Option<AxisAngle>,
    yaw_pitch_roll: Option<[f64; 3]>,
    euler_angles: Option<EulerAngles>,
}

impl Turned {
    pub(super) fn of_body(body: &Body) -> Self {
        Self {
            euler_parameters: body.euler_parameters,
            axis_angle: body.axis_angle,
            yaw_pitch_roll: body.yaw_pitch_roll,
            euler_angles: body.euler_angles,
        }
    }

    pub(super) fn of_initial(body: &InitialBody) -> Self {
        Self {
            euler_parameters: body.euler_parameters,
            axis_angle: body.axis_angle,
            yaw_pitch_roll: body.yaw_pitch_roll,
            euler_angles: body.euler_angles,
        }
    }

    pub(super) fn of_shape(shape: &Placing<'_>) -> Self {
        Self {
            euler_parameters: shape.euler_parameters,
            axis_angle: shape.axis_angle,
            yaw_pitch_roll: shape.yaw_pitch_roll,
            euler_angles: shape.euler_angles,
        }
    }

    /// Euler parameters of unit length; none where nothing is stated. Angles that look like degrees are among the findings.
    pub(super) fn euler_parameters(
        &self,
        item: &str,
        errors: &mut Vec<Diagnostic>,
    ) -> Option<[f64; 4]> {
        let stated = [
            ("euler_parameters", self.euler_parameters.is_some()),
            ("axis_angle", self.axis_angle.is_some()),
            ("yaw_pitch_roll", self.yaw_pitch_roll.is_some()),
            ("euler_angles", self.euler_angles.is_some()),
        ];
        let mut given = stated.iter().filter(|(_, stated)| *stated).map(|(field, _)| *field);
        if let (Some(first), Some(second)) = (given.next(), given.next()) {
            let message =
                format!("`{item}` has both `{first}` and `{second}`; expected one of them");
            let error =
                Diagnostic::new(Code::ConflictingFields, format!("{item}.{second}"), message);
            errors.push(error.help("leave one of them out"));
            return None;
        }
        if let Some(p) = self.euler_parameters {
            return unit_euler_parameters(format!("{item}.euler_parameters"), p, errors);
        }
        if let Some(AxisAngle { axis, angle }) = self.axis_angle {
            let Some(axis) = unit(axis) else {
                let path = format!("{item}.axis_angle.axis");
                let message = format!("`{path}` has length zero; expected a direction");
                let error = Diagnostic::new(Code::ZeroAxis, path, message);
                errors.push(error.help("give a vector along the axis, of any length"));
                return None;
            };
            look(format!("{item}.axis_angle.angle"), angle, errors);
            return Some(turn(axis, angle));
        }
        let mut look_at = |field: &str, angles: [f64; 3]| {
            for (k, angle) in angles.into_iter().enumerate() {
                look(format!("{item}.{field}[{k}]"), angle, errors);
            }
        };
        if let Some(angles) = self.yaw_pitch_roll {
            look_at("yaw_pitch_roll", angles);
            return Some(turns([2, 1, 0], angles));
        }
        let EulerAngles { sequence, angles } = self.euler_angles?;
        look_at("euler_angles.angles", angles);
        Some(turns(sequence.axes(), angles))
    }
}

fn look(path: String, angle: f64, findings: &mut Vec<Diagnostic>) {
    if let Some((message, help)) = implausible_angle(&path, angle) {
        findings.push(Diagnostic::new(Code::Implausible, path, message).help(help));
    }
}

/// The turn about a unit axis.
fn turn([x, y, z]: Vec3, angle: f64) -> [f64; 4] {
    let (s, c) = (0.5 * angle).sin_cos();
    [c, s * x, s * y, s * z]
}

/// Turns about body axes, one after the other.
fn turns(axes: [usize; 3], angles: [f64; 3]) -> [f64; 4] {
    axes.into_iter().zip(angles).fold(UNTURNED, |p, (axis, angle)| {
        let mut unit = [0.0; 3];
        unit[axis] = 1.0;
        product(&p, &turn(unit, angle))
    })
}

/// Rounding in the last digits of Euler parameters is taken out.
fn unit_euler_parameters(
    path: String,
    p: [f64; 4],
    errors: &mut Vec<Diagnostic>,
) -> Option<[f64; 4]> {
    let length = p.iter().map(|x| x * x).sum::<f64>().sqrt();
    if (length - 1.0).abs() <= 1e-6 {
        return Some(p.map(|x| x / length));
    }
    let message = format!("`{path}` has length {length:.9}; expected 1 within 1e-6");
    errors.push(Diagnostic::new(Code::NotUnit, path, message).help(
        "Euler parameters are cos(φ/2) and sin(φ/2) times the unit axis; no turn is [1, 0, 0, 0]",
    ));
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::resolve::geometry::spatial_rotation;

    /// Rotation about a coordinate axis, by hand.
    fn about(axis: usize, angle: f64) -> [[f64; 3]; 3] {
        let (s, c) = angle.sin_cos();
        match axis {
            0 => [[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]],
            1 => [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]],
            _ => [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]],
        }
    }

    fn times(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
        [0, 1, 2].map(|i| [0, 1, 2].map(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
    }

    #[test] // independent truth: products of three rotation matrices written out
    fn turns_about_body_axes_multiply_from_the_right() {
        let angles = [0.4, -1.1, 2.3];
        for axes in [[2, 1, 0], [2, 0, 2], [0, 1, 2], [1, 0, 1]] {
            let [a, b, c] = [0, 1, 2].map(|k| about(axes[k], angles[k]));
            let expected = times(&times(&a, &b), &c);
            let found = spatial_rotation(turns(axes, angles));
            for i in 0..3 {
                for j in 0..3 {
                    assert!((found[i][j] - expected[i][j]).abs() < 1e-15);
                }
            }
        }
    }
}
