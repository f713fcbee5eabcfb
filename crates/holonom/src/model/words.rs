//! What a word states of a run: one definition for model files, calls and the rooms that carry it out.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// An enum of plain variants with the word for each; their docs are those of the schema.
macro_rules! words {
    ($(#[$about:meta])* $name:ident { $($(#[$of:meta])* $variant:ident = $word:literal,)+ }) => {
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize, JsonSchema)]
        $(#[$about])*
        pub enum $name {
            $($(#[$of])* #[serde(rename = $word)] $variant,)+
        }

        impl $name {
            /// All of them with their words.
            pub const ALL: &'static [(Self, &'static str)] = &[$((Self::$variant, $word)),+];

            /// The word in files and options.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $word,)+
                }
            }
        }
    };
}

words! {
    /// What the independent variables are.
    #[schemars(rename = "Parametrization")]
    ParametrizationKind {
        /// Relative coordinates of a spanning forest of the bodies.
        #[default]
        Tree = "tree",
        /// Some of the coordinates.
        Partitioning = "partitioning",
        /// Combinations of coordinates along the tangent plane of the constraints, by QR.
        TangentPlane = "tangent_plane",
        /// The same by singular values.
        TangentPlaneSvd = "tangent_plane_svd",
    }
}

words! {
    /// Where the integration Jacobian comes from.
    JacobianSource {
        /// Derivatives of the elements' equations.
        #[default]
        Analytic = "analytic",
        /// Differences of accelerations; not for ForRosen.
        Differences = "differences",
    }
}

words! {
    /// How the integration Jacobian is represented.
    #[schemars(rename = "Newton")]
    Representation {
        /// By predicted cost.
        #[default]
        Auto = "auto",
        /// Of the independent variables alone.
        Dense = "dense",
        /// With the graph of the mechanism: its cost grows like the number of bodies, and steps are those of the dense one.
        Sparse = "sparse",
        /// The sparse one without how joints turn, while iterations with it contract.
        Simplified = "simplified",
    }
}

words! {
    /// Where accelerations and multipliers come from.
    Accelerations {
        /// By predicted cost.
        #[default]
        Auto = "auto",
        /// From body to body along a tree; there are no loops.
        Recursive = "recursive",
        /// A dense matrix of the independent variables alone.
        NullSpace = "null_space",
        /// A matrix of the multipliers alone, by blocks of joints; every body needs mass and inertia.
        Reduced = "reduced",
        /// A sparse matrix of accelerations and multipliers.
        Augmented = "augmented",
    }
}

words! {
    /// Which coordinates recoveries and derivatives go through.
    Coordinates {
        /// Joint for trees, and for models with loops of up to 200 degrees of freedom where few loops hang together; else
        /// Cartesian.
        #[default]
        Auto = "auto",
        /// Poses of bodies, with equations for every joint.
        Cartesian = "cartesian",
        /// Relative coordinates along the spanning tree, with equations for what closes loops.
        Joint = "joint",
    }
}

words! {
    /// Choices that go with a code.
    Profile {
        /// Norm over all coordinates, filtered estimates, reuse of Jacobians.
        #[default]
        Improved = "improved",
        /// As in the thesis that the codes come from.
        Thesis = "thesis",
    }
}
