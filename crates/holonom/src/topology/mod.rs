//! Graph of bodies and joints, without numbers: components, spanning forest, loops.

use crate::model::{BodyIndex, Model};
use std::collections::VecDeque;

/// The graph of a model: bodies and the ground are nodes, joints and drivers edges.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topology {
    /// Connected component of each body; 0 holds the ground.
    pub component: Vec<usize>,
    /// Number of components; those after the first have no connection to the ground.
    pub components: usize,
    /// Joint (index into [`Model::joints`]) that ties each body to its parent in a spanning forest,
    /// breadth first from the ground; `None` at the root of a floating component.
    pub parent_joint: Vec<Option<usize>>,
    /// Joints outside the forest: each closes a loop.
    pub loop_joints: Vec<usize>,
}

impl Topology {
    /// The graph of a model's joints. Drivers connect what their joints connect and are left out.
    pub fn new(model: &Model) -> Self {
        let ends: Vec<[BodyIndex; 2]> =
            model.joints.iter().map(|j| j.frames.map(|f| f.body)).collect();
        Self::of_joints(model.bodies.len(), &ends)
    }

    /// The graph of `count` bodies and joints between the given pairs.
    pub fn of_joints(count: usize, joints: &[[BodyIndex; 2]]) -> Self {
        // Node 0 is the ground, node b + 1 body b.
        let node = |body: BodyIndex| body.map_or(0, |b| b + 1);
        let ends: Vec<[usize; 2]> = joints.iter().map(|j| j.map(node)).collect();
        let mut at = vec![Vec::new(); count + 1];
        for (joint, [i, j]) in ends.iter().enumerate() {
            at[*i].push(joint);
            at[*j].push(joint);
        }
        let mut component = vec![usize::MAX; count + 1];
        let mut parent_joint = vec![None; count + 1];
        let mut components = 0;
        let mut queue = VecDeque::new();
        for root in 0..=count {
            if component[root] != usize::MAX {
                continue;
            }
            component[root] = components;
            queue.push_back(root);
            while let Some(i) = queue.pop_front() {
                for &joint in &at[i] {
                    let [a, b] = ends[joint];
                    let j = if a == i { b } else { a };
                    if component[j] == usize::MAX {
                        component[j] = components;
                        parent_joint[j] = Some(joint);
                        queue.push_back(j);
                    }
                }
            }
            components += 1;
        }
        let loop_joints =
            (0..ends.len()).filter(|joint| !parent_joint.contains(&Some(*joint))).collect();
        Self {
            component: component.split_off(1),
            components,
            parent_joint: parent_joint.split_off(1),
            loop_joints,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test] // independent truth: Euler's count of independent cycles by hand
    fn a_four_bar_has_one_loop_and_a_free_body_is_a_component_of_its_own() {
        let (ground, a, b, c) = (None, Some(0), Some(1), Some(2));
        let open = Topology::of_joints(3, &[[ground, a], [a, b]]);
        assert_eq!((open.components, open.loop_joints.len()), (2, 0));
        assert_eq!(open.component, [0, 0, 1]);
        assert_eq!(open.parent_joint, [Some(0), Some(1), None]);
        let closed = Topology::of_joints(3, &[[ground, a], [a, b], [b, c], [c, ground]]);
        assert_eq!((closed.components, closed.loop_joints.len()), (1, 1));
        // Two joints between the same bodies close a loop, too.
        assert_eq!(Topology::of_joints(1, &[[ground, a], [ground, a]]).loop_joints, [1]);
    }
}
