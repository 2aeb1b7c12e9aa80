//! Coarse to fine: some pixels are searched thoroughly, the others start from what the nearest of
//! those found.
//!
//! Nodes lie on a grid of the whole image: which they are depends on no tile. A pixel whose fit is
//! much worse than that of the nodes about it (a fleck of gold between them) is searched
//! thoroughly, too.

use super::tile::Ladder;

/// Every so many rows and columns there is a node: a sixteenth of the pixels, so that the thorough
/// search of nodes no longer rules the time of the whole.
const STEP: usize = 4;

/// What a pixel of the grid found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    pub(super) ladder: Ladder,
    /// Of photometric stereo.
    pub(super) normal: [f32; 3],
    /// What it left of its samples: a share of their weighted sum of squares, but for a factor that
    /// all pixels have in common.
    pub(super) misfit: f32,
}

impl Node {
    /// A normal of photometric stereo after what the node's first lobe did to its own.
    pub(super) fn turned(&self, normal: [f32; 3]) -> [f32; 3] {
        let found = self.ladder.rungs[1].normal;
        let long: [f32; 3] =
            core::array::from_fn(|axis| normal[axis] + (found[axis] - self.normal[axis]));
        let length = long.iter().map(|v| v * v).sum::<f32>().sqrt();
        // Opposite turns of half a circle cancel.
        if length > 0.0 { long.map(|v| v / length) } else { normal }
    }
}

/// Nodes row by row; none where a pixel cannot be fitted.
#[derive(Debug)]
pub(super) struct Pyramid {
    width: usize,
    columns: usize,
    nodes: Vec<Option<Node>>,
}

impl Pyramid {
    /// The pixels that are nodes.
    pub(super) fn grid(width: usize, height: usize) -> Vec<usize> {
        let rows = (0..height).step_by(STEP);
        rows.flat_map(|row| (0..width).step_by(STEP).map(move |column| row * width + column))
            .collect()
    }

    /// What the pixels of [`Self::grid`] found.
    pub(super) fn new(width: usize, nodes: Vec<Option<Node>>) -> Self {
        Self { width, columns: width.div_ceil(STEP), nodes }
    }

    /// The nodes at the corners of the cell that a pixel lies in, nearest first.
    pub(super) fn about(&self, pixel: usize) -> Vec<&Node> {
        let (row, column) = (pixel / self.width, pixel % self.width);
        let rows = row / STEP..=row.div_ceil(STEP);
        let corners =
            rows.flat_map(|y| (column / STEP..=column.div_ceil(STEP)).map(move |x| [x, y]));
        let mut near: Vec<(usize, &Node)> = corners
            .filter(|&[x, _]| x < self.columns)
            .filter_map(|[x, y]| {
                let away = (x * STEP).abs_diff(column).pow(2) + (y * STEP).abs_diff(row).pow(2);
                Some((away, self.nodes.get(y * self.columns + x)?.as_ref()?))
            })
            .collect();
        near.sort_by_key(|&(away, _)| away);
        near.into_iter().map(|(_, node)| node).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::maps::MOST_LOBES;
    use super::super::tile::Place;
    use super::*;

    fn node(mark: f32) -> Node {
        let place = Place::new([0.0, 0.0, 1.0]);
        let ladder = Ladder { rungs: [place; MOST_LOBES + 1], lobes: 0 };
        Node { ladder, normal: place.normal, misfit: mark }
    }

    #[test]
    fn a_pixel_has_the_nodes_at_its_cells_corners() {
        // Nodes 0 1 2 in row 0, 3 4 5 in row 4; 4 cannot be fitted.
        let nodes = (0..6).map(|i| (i != 4).then(|| node(i as f32))).collect();
        assert_eq!(Pyramid::grid(10, 6), [0, 4, 8, 40, 44, 48]);
        let pyramid = Pyramid::new(10, nodes);
        let about = |row: usize, column: usize| {
            pyramid.about(row * 10 + column).iter().map(|node| node.misfit).collect::<Vec<_>>()
        };
        assert_eq!(about(0, 4), [1.0]);
        assert_eq!(about(1, 3), [1.0, 0.0, 3.0]);
        assert_eq!(about(4, 4), [0.0; 0]);
        assert_eq!(about(5, 9), [5.0]);
        assert_eq!(about(3, 9), [5.0, 2.0]);
    }

    #[test]
    fn a_normal_turns_as_its_node_did() {
        let mut node = node(0.0);
        node.ladder.rungs[1].normal = [0.6, 0.0, 0.8];
        assert_eq!(node.turned(node.normal), [0.6, 0.0, 0.8]);
        let [x, y, z] = node.turned([0.0, 0.6, 0.8]);
        assert!(x > 0.5 && y > 0.5 && (x * x + y * y + z * z - 1.0).abs() < 1e-6);
    }
}
