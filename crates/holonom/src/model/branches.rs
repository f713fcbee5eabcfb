//! Rules of bushings and of their branches, and where extra states begin.

use super::validation::{Rules, SLACK, matrix_rules, semidefinite};
use super::{Branch, ForceKind, InitialExtraState, Model};
use crate::error::{Code, shown};

/// Branches of one bushing: each has six extra states that the others of the bushing see.
const MOST_BRANCHES: usize = 32;

impl Model {
    /// Extra states at the start, force by force: what is stated of them, else zero.
    pub(crate) fn initial_extra_states(&self) -> Vec<f64> {
        let mut out = Vec::new();
        for force in &self.forces {
            let all = &self.initial.extra_states;
            let stated = all.iter().find(|(name, _)| *name == force.name).map(|(_, stated)| stated);
            match (&force.kind, stated) {
                (ForceKind::Maxwell { .. }, Some(InitialExtraState::Spring(x))) => out.push(*x),
                (ForceKind::Maxwell { .. }, _) => out.push(0.0),
                (ForceKind::Bushing { branches, .. }, stated) => {
                    for branch in branches {
                        let of_branch = match stated {
                            Some(InitialExtraState::Branches(all)) => {
                                all.iter().find(|(name, _)| *name == branch.name)
                            }
                            _ => None,
                        };
                        let x = of_branch.map_or([0.0; 6], |(_, x)| *x);
                        out.extend(branch.directions().map(|k| x[k]));
                    }
                }
                _ => {}
            }
        }
        out
    }
}

impl Rules {
    pub(super) fn bushing(&mut self, item: &str, own: [&[[f64; 6]; 6]; 2], branches: &[Branch]) {
        self.matrices(item, own);
        if branches.len() > MOST_BRANCHES {
            let (path, count) = (format!("{item}.branches"), branches.len());
            let message = format!("`{path}` are {count}; expected no more than {MOST_BRANCHES}");
            self.refuse(Code::OutOfRange, &path, message, "join those of similar times");
        }
        for branch in branches {
            self.branch(&format!("{item}.branches.{}", branch.name), branch);
        }
    }

    /// Whether both matrices are what they should be.
    fn matrices(&mut self, item: &str, [stiffness, damping]: [&[[f64; 6]; 6]; 2]) -> bool {
        let mut sound = true;
        for (name, matrix) in [("stiffness_matrix", stiffness), ("damping_matrix", damping)] {
            if let Err((message, help)) = matrix_rules(matrix) {
                let path = format!("{item}.{name}");
                self.refuse(Code::Matrix, &path, format!("`{path}` {message}"), help);
                sound = false;
            }
        }
        sound
    }

    /// A spring and a damper in series have the same directions.
    fn branch(&mut self, item: &str, branch: &Branch) {
        let Branch { stiffness, damping, .. } = branch;
        if !self.matrices(item, [stiffness, damping]) {
            return;
        }
        let help = "a branch is a spring and a damper in series: where it has one it has both";
        if branch.directions().next().is_none() {
            let path = format!("{item}.stiffness");
            let message = format!("`{item}` has no stiffness; expected some above zero");
            return self.refuse(Code::OutOfRange, &path, message, help);
        }
        let acts = |matrix: &[[f64; 6]; 6], k: usize| matrix[k].iter().any(|x| *x != 0.0);
        for k in 0..6 {
            let [spring, damper] = [acts(stiffness, k), acts(damping, k)];
            if spring != damper {
                let [stiff, damp] = [("stiffness", stiffness), ("damping", damping)]
                    .map(|(name, matrix)| format!("{item}.{}", entry(name, matrix, k)));
                let (path, other) = if spring { (damp, stiff) } else { (stiff, damp) };
                let message =
                    format!("`{path}` is 0; expected a number above zero, as `{other}` is");
                self.refuse(Code::OutOfRange, &path, message, help);
                return;
            }
        }
        let mut held = *damping;
        (0..6).filter(|&k| !acts(damping, k)).for_each(|k| held[k][k] = 1.0);
        if !definite(&held) {
            let path = format!("{item}.damping_matrix");
            let message = format!(
                "`{path}` is not positive definite: some deformation of the spring has no damper"
            );
            self.refuse(Code::Matrix, &path, message, help);
        }
    }

    /// A branch without a spring in a direction has no state there.
    pub(super) fn extra_states(&mut self, model: &Model) {
        for (name, stated) in &model.initial.extra_states {
            let force = model.forces.iter().find(|force| force.name == *name);
            let (Some(ForceKind::Bushing { branches, .. }), InitialExtraState::Branches(stated)) =
                (force.map(|force| &force.kind), stated)
            else {
                continue;
            };
            for (of, x) in stated {
                let Some(branch) = branches.iter().find(|branch| branch.name == *of) else {
                    continue;
                };
                for (k, extension) in x[..3].iter().enumerate() {
                    let path = format!("initial.extra_states.{name}.{of}.extension[{k}]");
                    self.within(&path, *extension);
                }
                let held: Vec<usize> = branch.directions().collect();
                for k in (0..6).filter(|k| x[*k] != 0.0 && !held.contains(k)) {
                    let field = if k < 3 { "extension" } else { "rotation" };
                    let path = format!("initial.extra_states.{name}.{of}.{field}[{}]", k % 3);
                    let message = format!(
                        "`{path}` is {}; expected 0, as the branch has no spring there",
                        shown(x[k])
                    );
                    self.refuse(Code::OutOfRange, &path, message, "");
                }
            }
        }
    }
}

/// Field and place of the entry in row `k` of the diagonal, as a file states it.
fn entry(name: &str, matrix: &[[f64; 6]; 6], k: usize) -> String {
    let diagonal = (0..6).all(|i| (0..6).all(|j| i == j || matrix[i][j] == 0.0));
    match k {
        _ if !diagonal => format!("{name}_matrix[{k}][{k}]"),
        0..3 => format!("{name}[{k}]"),
        _ => format!("rotational_{name}[{}]", k - 3),
    }
}

/// Whether a symmetric matrix has no eigenvalue near or below zero, rows and columns scaled by its diagonal.
fn definite(a: &[[f64; 6]; 6]) -> bool {
    let scaled =
        std::array::from_fn(|i| std::array::from_fn(|j| a[i][j] / (a[i][i] * a[j][j]).sqrt()));
    (0..6).all(|k| a[k][k] > 0.0) && semidefinite::<6>(&scaled, -SLACK)
}
