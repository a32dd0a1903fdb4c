//! The distances along the shortest tree that joins the components.

use super::phase::Phase;
use crate::graph::{Network, Tree};

/// The search for the tree, and buffers.
#[derive(Debug, Default)]
pub(super) struct SpanningTree {
    network: Network,
    tree: Tree,
    /// mass of a component and all that hangs on it
    beyond: Vec<f64>,
}

impl SpanningTree {
    /// The sum over the edges of the tree of 2 W W' d, with W, W' the masses of the two parts that
    /// the edge joins: that over ordered pairs with the distances along the tree. Adds its derivative
    /// by the masses to `potential`, which is 0 before; calls `add(f, a)` for every face f whose
    /// price enters with factor a.
    pub(super) fn sum(
        &mut self,
        phase: &Phase<'_>,
        potential: &mut [f64],
        mut add: impl FnMut(u32, f64),
    ) -> f64 {
        let Self {
            network,
            tree,
            beyond,
        } = self;
        let meetings = &phase.regions.meetings;
        let links = meetings.iter().map(|meeting| meeting.link);
        network.join(phase.masses.len(), links);
        network.spanning_tree(0, tree);
        beyond.clear();
        beyond.extend_from_slice(phase.masses);
        for &child in tree.order[1..].iter().rev() {
            beyond[tree.parents[child as usize] as usize] += beyond[child as usize];
        }
        let total = beyond[0];
        let (mut value, mut rest) = (0.0, 0.0);
        for &child in &tree.order[1..] {
            let child = child as usize;
            let parent = tree.parents[child] as usize;
            let meeting = &meetings[tree.links[child] as usize];
            let length = meeting.link.length;
            let (near, near_slope) = phase.saturation.at(total - beyond[child]);
            let (far, far_slope) = phase.saturation.at(beyond[child]);
            let factor = 2.0 * near * far;
            value += factor * length;
            phase
                .regions
                .accumulate_path(phase.mesh, phase.weights, meeting, factor, &mut add);
            // By the masses on the root's side, which are all but those beyond.
            let here = 2.0 * near_slope * far * length;
            let there = 2.0 * near * far_slope * length;
            rest += here;
            potential[child] = potential[parent] + there - here;
        }
        for slope in potential {
            *slope += rest;
        }
        value
    }
}
