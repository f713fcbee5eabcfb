//! Displacements between two bodies as functions s(q) with their derivatives: the same measures that
//! joints and drivers are made of.

use super::cartesian::{Cartesian, Space};
use super::{Displacement, State};
use crate::elements::{ConstraintElement, RowBlocks};
use crate::math::TimeFunction;
use crate::model::{
    BodyIndex, Driver, DriverKind, ElasticLaw, ForceKind, Frame, Joint, JointKind, Model,
};

/// The function s(q) of a displacement and the law of the force along it, if there is one.
#[derive(Debug, Clone)]
pub(super) struct Measured<C> {
    element: C,
    law: Option<Law>,
}

#[derive(Debug, Clone)]
enum Law {
    Constant(f64),
    /// A spring of this free length with the elongation (l² − l₀²) / (2 l₀).
    Spring(ElasticLaw, f64),
}

/// Displacements of a model with their functions:
///
/// - along the axis of each joint that slides between moving bodies;
/// - the elongation (l² − l₀²) / (2 l₀) of each spring of free length l₀: l − l₀ to first order;
/// - the translations of each bushing along the axes of its first frame.
pub(super) fn find<S: Space<D, N>, const D: usize, const N: usize>(
    model: &Model,
    center: impl Fn(BodyIndex) -> [f64; 3],
) -> (Vec<Displacement>, Vec<Measured<S::Constraint>>) {
    let mut all = Vec::new();
    let mut measures = Vec::new();
    let mut add = |name: &str, bodies: [BodyIndex; 2], length, element, law| {
        all.push(Displacement { name: name.to_owned(), bodies, length });
        measures.push(Measured { element, law });
    };
    // A translation driver measures along the last axis of the frames, in a plane along the first.
    let along = |name: &str, frames: [Frame; 2]| {
        let driver = Driver {
            name: name.to_owned(),
            kind: DriverKind::Translation,
            frames,
            motion: TimeFunction::Constant(0.0),
        };
        S::driver(&driver, frames.map(|f| center(f.body)))
    };
    for j in &model.joints {
        let slides = matches!(j.kind, JointKind::Translational | JointKind::Cylindrical);
        let ends = j.frames.map(|f| f.body);
        if slides && ends.iter().all(Option::is_some) {
            add(&j.name, ends, f64::INFINITY, along(&j.name, j.frames), None);
        }
    }
    for f in &model.forces {
        match &f.kind {
            ForceKind::Tsda { frames, law, free_length, .. } if *free_length > 0.0 => {
                let joint = Joint {
                    name: f.name.clone(),
                    kind: JointKind::Distance { length: *free_length },
                    frames: *frames,
                };
                let ends = frames.map(|f| f.body);
                let law = Law::Spring(law.clone(), *free_length);
                add(&f.name, ends, *free_length, S::joint(&joint, ends.map(&center)), Some(law));
            }
            ForceKind::Bushing { frames, stiffness, .. } => {
                for axis in 0..3 {
                    let turned = |f: Frame| {
                        let axes = f
                            .axes
                            .map(|row| std::array::from_fn(|column| row[(column + axis + 1) % 3]));
                        Frame { axes, ..f }
                    };
                    let element = along(&f.name, frames.map(turned));
                    let law = Law::Constant(stiffness[axis][axis]);
                    let ends = frames.map(|f| f.body);
                    add(&f.name, ends, f64::INFINITY, element, Some(law));
                }
            }
            _ => {}
        }
    }
    (all, measures)
}

pub(super) fn value<S: Space<D, N>, const D: usize, const N: usize>(
    system: &Cartesian<S, D, N>,
    k: usize,
    q: &[f64],
) -> f64 {
    let mut u = [0.0; 6];
    system.measures[k].element.value(pair(system, k, q), &mut u);
    u[0]
}

pub(super) fn gradient<S: Space<D, N>, const D: usize, const N: usize>(
    system: &Cartesian<S, D, N>,
    k: usize,
    q: &[f64],
    out: &mut [f64],
) {
    let mut rows = RowBlocks::zero();
    system.measures[k].element.jacobian(pair(system, k, q), &mut rows);
    place(&rows, out);
}

pub(super) fn curvature<S: Space<D, N>, const D: usize, const N: usize>(
    system: &Cartesian<S, D, N>,
    k: usize,
    q: &[f64],
    v: &[f64],
) -> f64 {
    let mut u = [0.0; 6];
    system.measures[k].element.curvature(pair(system, k, q), rates(system, k, v), &mut u);
    u[0]
}

pub(super) fn blocks<S: Space<D, N>, const D: usize, const N: usize>(
    system: &Cartesian<S, D, N>,
    k: usize,
    state: &State,
    a0: &mut [f64],
    a1: &mut [f64],
) {
    let measure = &system.measures[k].element;
    let q = pair(system, k, &state.q);
    let (v, a) = (rates(system, k, &state.v), rates(system, k, &state.a));
    let mut rows = RowBlocks::zero();
    measure.directional(q, v, &mut rows);
    place(&rows, a0);
    measure.directional(q, a, &mut rows);
    place(&rows, a1);
    measure.curvature_gradient(q, v, &mut rows);
    for (out, side) in a1.chunks_exact_mut(N).zip(&rows.0) {
        for (out, x) in out.iter_mut().zip(&side[0]) {
            *out += x;
        }
    }
}

pub(super) fn stiffness<S: Space<D, N>, const D: usize, const N: usize>(
    system: &Cartesian<S, D, N>,
    k: usize,
    q: &[f64],
) -> Option<f64> {
    match system.measures[k].law.as_ref()? {
        Law::Constant(stiffness) | Law::Spring(ElasticLaw::Linear(stiffness), _) => {
            Some(*stiffness)
        }
        Law::Spring(ElasticLaw::Table(table), free_length) => {
            let square = free_length * (free_length + 2.0 * value(system, k, q));
            Some(table.value_and_slope(square.max(0.0).sqrt() - free_length).1)
        }
    }
}

fn pair<'a, S: Space<D, N>, const D: usize, const N: usize>(
    system: &Cartesian<S, D, N>,
    k: usize,
    q: &'a [f64],
) -> [&'a [f64; N]; 2] {
    Cartesian::<S, D, N>::pair(q, system.displacements[k].bodies)
}

fn rates<'a, S: Space<D, N>, const D: usize, const N: usize>(
    system: &Cartesian<S, D, N>,
    k: usize,
    v: &'a [f64],
) -> [&'a [f64; N]; 2] {
    Cartesian::<S, D, N>::rates(v, system.displacements[k].bodies)
}

fn place<const N: usize>(rows: &RowBlocks<f64, N>, out: &mut [f64]) {
    for (out, side) in out.chunks_exact_mut(N).zip(&rows.0) {
        out.copy_from_slice(&side[0]);
    }
}
