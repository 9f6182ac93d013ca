//! The node hierarchy: local transforms, global matrices, joint matrices.

use gltf::json::{Index, Root};
use salient_sdk::NodeError;

use super::accessor::Buffers;
use super::{FORMAT, bad, get};

/// An affine map: columns of a 4 x 4 matrix without its last row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Matrix([[f64; 3]; 4]);

impl Matrix {
    pub const IDENTITY: Self = Self([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0; 3]]);

    /// From 16 numbers, column-major.
    fn from_columns(m: &[f64; 16]) -> Self {
        Self([0, 1, 2, 3].map(|c| [m[4 * c], m[4 * c + 1], m[4 * c + 2]]))
    }

    /// Translation times rotation (a quaternion x, y, z, w, brought to unit length) times scale.
    fn from_trs(t: [f64; 3], [x, y, z, w]: [f64; 4], s: [f64; 3]) -> Self {
        let n = (x * x + y * y + z * z + w * w).sqrt();
        let (x, y, z, w) = (x / n, y / n, z / n, w / n);
        let columns = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)],
            [2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)],
            [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)],
        ];
        let [a, b, c] = [0, 1, 2].map(|i| columns[i].map(|r| r * s[i]));
        Self([a, b, c, t])
    }

    fn times(&self, other: &Self) -> Self {
        let o = &other.0;
        let [a, b, c] = [0, 1, 2].map(|i| self.direction(o[i]));
        Self([a, b, c, self.point(o[3])])
    }

    fn direction(&self, p: [f64; 3]) -> [f64; 3] {
        let m = &self.0;
        [0, 1, 2].map(|r| m[0][r] * p[0] + m[1][r] * p[1] + m[2][r] * p[2])
    }

    /// The image of a point.
    pub fn point(&self, p: [f64; 3]) -> [f64; 3] {
        let d = self.direction(p);
        [0, 1, 2].map(|r| d[r] + self.0[3][r])
    }

    /// Negative if the map mirrors.
    pub fn determinant(&self) -> f64 {
        let [a, b, c, _] = self.0;
        a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    }
}

/// A node's own transform.
#[derive(Clone)]
pub struct Local {
    /// Given instead of the other three; no clip may move such a node.
    pub matrix: Option<Matrix>,
    pub translation: [f64; 3],
    /// A quaternion x, y, z, w.
    pub rotation: [f64; 4],
    pub scale: [f64; 3],
    /// Weights of the morph targets, where a clip sets them.
    pub morph: Option<Vec<f64>>,
}

/// All nodes of a document with their transforms.
pub struct Scene {
    pub locals: Vec<Local>,
    globals: Vec<Matrix>,
}

impl Scene {
    /// The nodes as they stand in the file.
    pub fn new(root: &Root) -> Result<Self, NodeError> {
        let local = |node: &gltf::json::Node| Local {
            matrix: node.matrix.map(|m| Matrix::from_columns(&m.map(f64::from))),
            translation: node.translation.unwrap_or([0.0; 3]).map(f64::from),
            rotation: node.rotation.map_or([0.0, 0.0, 0.0, 1.0], |r| r.0.map(f64::from)),
            scale: node.scale.unwrap_or([1.0; 3]).map(f64::from),
            morph: None,
        };
        let locals: Vec<Local> = root.nodes.iter().map(local).collect();
        for (i, local) in locals.iter().enumerate() {
            let zero = local.rotation.iter().all(|x| *x == 0.0);
            if zero && local.matrix.is_none() {
                return Err(bad(FORMAT, format_args!("node {i}"), "the rotation is the zero quaternion"));
            }
        }
        Ok(Self { globals: vec![Matrix::IDENTITY; locals.len()], locals })
    }

    /// Computes the global matrices from the local ones. The nodes must form trees.
    pub fn place(&mut self, root: &Root) -> Result<(), NodeError> {
        let n = root.nodes.len();
        let mut child = vec![false; n];
        for (i, node) in root.nodes.iter().enumerate() {
            for c in node.children.iter().flatten().map(Index::value) {
                if c >= n || std::mem::replace(&mut child[c], true) {
                    return Err(bad(
                        FORMAT,
                        format_args!("node {i}"),
                        format_args!("child {c} has two parents or is not there"),
                    ));
                }
            }
        }
        let mut stack: Vec<(usize, Matrix)> = (0..n).filter(|i| !child[*i]).map(|i| (i, Matrix::IDENTITY)).collect();
        let mut placed = 0;
        while let Some((i, parent)) = stack.pop() {
            placed += 1;
            let local = &self.locals[i];
            let trs = || Matrix::from_trs(local.translation, local.rotation, local.scale);
            let own = local.matrix.unwrap_or_else(trs);
            self.globals[i] = parent.times(&own);
            let children = root.nodes[i].children.iter().flatten();
            stack.extend(children.map(|c| (c.value(), self.globals[i])));
        }
        if placed == n {
            return Ok(());
        }
        Err(bad(FORMAT, "nodes", format_args!("{} nodes are their own ancestors", n - placed)))
    }

    /// A node's matrix in the scene.
    pub fn global(&self, node: usize) -> Matrix {
        self.globals[node]
    }

    /// A node's morph weights, if a clip sets them.
    pub fn morph(&self, node: usize) -> Option<&[f64]> {
        self.locals[node].morph.as_deref()
    }

    /// The nodes with meshes of the default scene, depth first: of the first scene if none is the default, of all nodes
    /// if there are no scenes.
    pub fn drawn(root: &Root) -> Result<Vec<usize>, NodeError> {
        let n = root.nodes.len();
        let scene = match root.scene {
            Some(index) => Some(get(root, index, "scene")?),
            None => root.scenes.first(),
        };
        let Some(scene) = scene else {
            return Ok((0..n).filter(|i| root.nodes[*i].mesh.is_some()).collect());
        };
        let mut stack: Vec<usize> = scene.nodes.iter().rev().map(Index::value).collect();
        let (mut seen, mut drawn) = (vec![false; n], Vec::new());
        while let Some(i) = stack.pop() {
            if std::mem::replace(&mut seen[i], true) {
                return Err(bad(FORMAT, "scene", format_args!("node {i} is in it twice")));
            }
            if root.nodes[i].mesh.is_some() {
                drawn.push(i);
            }
            stack.extend(root.nodes[i].children.iter().flatten().rev().map(Index::value));
        }
        Ok(drawn)
    }

    /// The matrices of a skin's joints: global transform times inverse bind matrix.
    pub fn joints(&self, root: &Root, buffers: &Buffers, skin: usize) -> Result<Vec<Matrix>, NodeError> {
        let place = format!("skin {skin}");
        let json = root.skins.get(skin).ok_or_else(|| bad(FORMAT, &place, "is not there"))?;
        let inverse = match json.inverse_bind_matrices {
            Some(index) => buffers.read(root, index, 16, &place)?,
            None => Vec::new(),
        };
        let inverse = inverse.as_chunks::<16>().0;
        if json.inverse_bind_matrices.is_some() && inverse.len() < json.joints.len() {
            let (m, n) = (inverse.len(), json.joints.len());
            return Err(bad(FORMAT, place, format_args!("{m} inverse bind matrices for {n} joints")));
        }
        let matrix = |(j, joint): (usize, &Index<gltf::json::Node>)| {
            let global = self.globals[joint.value()];
            inverse.get(j).map_or(global, |m| global.times(&Matrix::from_columns(m)))
        };
        Ok(json.joints.iter().enumerate().map(matrix).collect())
    }
}
