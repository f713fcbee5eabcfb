//! What a row of a joint or driver prescribes.

use std::fmt;

/// An axis of the ground, or of the frame of a joint on its first body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// First of the ground.
    X,
    /// Second of the ground.
    Y,
    /// Third of the ground.
    Z,
    /// First of the frame.
    F,
    /// Second of the frame.
    G,
    /// Third of the frame.
    H,
}

impl Axis {
    /// Place among the axes of the frame; none for an axis of the ground.
    pub fn of_frame(self) -> Option<usize> {
        match self {
            Self::X | Self::Y | Self::Z => None,
            Self::F => Some(0),
            Self::G => Some(1),
            Self::H => Some(2),
        }
    }
}

impl fmt::Display for Axis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
            Self::F => "f",
            Self::G => "g",
            Self::H => "h",
        })
    }
}

/// What a row prescribes. As text it is how messages name the row: "translation along x", "rotation about g".
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RowKind {
    /// A displacement along an axis.
    Translation(Axis),
    /// A rotation about an axis.
    Rotation(Axis),
    /// The rotation in the plane.
    PlanarRotation,
    /// The rotation about the normal of the two axes of a universal joint.
    RotationAboutNormal,
    /// The distance of two points.
    Distance,
    /// The length of a body's Euler parameters.
    Normalization,
}

impl RowKind {
    /// Whether the row is in metres; else it is in radians, direction cosines or another pure number.
    pub fn is_length(self) -> bool {
        match self {
            Self::Translation(_) | Self::Distance => true,
            Self::Rotation(_)
            | Self::PlanarRotation
            | Self::RotationAboutNormal
            | Self::Normalization => false,
        }
    }

    /// The motion that is prescribed and its axis, where there is one of the ground or of the frame.
    pub fn motion(self) -> Option<(&'static str, Axis)> {
        match self {
            Self::Translation(axis) => Some(("translation along", axis)),
            Self::Rotation(axis) => Some(("rotation about", axis)),
            _ => None,
        }
    }
}

impl fmt::Display for RowKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some((motion, axis)) = self.motion() {
            return write!(f, "{motion} {axis}");
        }
        f.write_str(match self {
            Self::RotationAboutNormal => "rotation about the common normal of both axes",
            Self::Distance => "distance",
            Self::Normalization => "unit Euler parameters",
            _ => "rotation",
        })
    }
}
