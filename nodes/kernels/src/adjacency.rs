//! Incidence of a triangle mesh in compressed rows: one-rings, vertex-face incidence and edges.
//!
//! Everything is built by counting and sorting, so the results depend on nothing but the input.

use std::fmt;

/// Marks "no edge" in [`Edges::face_edges`]: that side joins a vertex to itself.
pub const NO_EDGE: u32 = u32::MAX;

/// Why arrays are not a triangle mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeshError {
    /// A face names a vertex that does not exist.
    IndexOutOfRange {
        /// Position of the face in the face array.
        face: usize,
        /// The index it names.
        index: u32,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A coordinate is infinite or not a number.
    NonFinite {
        /// Position of the vertex in the vertex array.
        vertex: usize,
    },
    /// More vertices or faces than 32-bit indices (with one value reserved) can name.
    TooLarge,
}

impl fmt::Display for MeshError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::IndexOutOfRange { face, index, vertices } => {
                write!(f, "face {face} names vertex {index}, but there are {vertices} vertices")
            }
            Self::NonFinite { vertex } => {
                write!(f, "vertex {vertex} has a coordinate that is not finite")
            }
            Self::TooLarge => write!(f, "the mesh has too many vertices or faces for 32-bit indices"),
        }
    }
}

impl std::error::Error for MeshError {}

/// Checks that every face names existing vertices and that the counts fit 32 bits.
pub fn check_faces(vertex_count: usize, faces: &[[u32; 3]]) -> Result<(), MeshError> {
    // Edges number at most 3 F, and u32::MAX is a marker in several places.
    if vertex_count >= u32::MAX as usize || faces.len() >= (u32::MAX / 3) as usize {
        return Err(MeshError::TooLarge);
    }
    for (face, corners) in faces.iter().enumerate() {
        for &index in corners {
            if index as usize >= vertex_count {
                return Err(MeshError::IndexOutOfRange { face, index, vertices: vertex_count });
            }
        }
    }
    Ok(())
}

/// Checks the faces as [`check_faces`] does, and that all coordinates are finite.
pub fn check_mesh(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Result<(), MeshError> {
    check_faces(vertices.len(), faces)?;
    match vertices.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
        Some(vertex) => Err(MeshError::NonFinite { vertex }),
        None => Ok(()),
    }
}

/// Lists of indices in compressed rows: row `i` is `targets[offsets[i]..offsets[i + 1]]`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Csr {
    /// Where each row begins; one more entry than there are rows.
    pub offsets: Vec<usize>,
    /// The rows, one after the other.
    pub targets: Vec<u32>,
}

impl Csr {
    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// Whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Row `i`. Panics, as slices do, when there is no such row.
    #[must_use]
    pub fn row(&self, i: usize) -> &[u32] {
        &self.targets[self.offsets[i]..self.offsets[i + 1]]
    }

    /// Buckets `(row, target)` pairs by row, keeping the order of pairs within a row.
    pub(crate) fn bucket(rows: usize, pairs: impl Iterator<Item = (u32, u32)> + Clone) -> Self {
        let mut offsets = vec![0usize; rows + 1];
        for (row, _) in pairs.clone() {
            offsets[row as usize + 1] += 1;
        }
        for i in 0..rows {
            offsets[i + 1] += offsets[i];
        }
        let mut next = offsets.clone();
        let mut targets = vec![0; offsets[rows]];
        for (row, target) in pairs {
            targets[next[row as usize]] = target;
            next[row as usize] += 1;
        }
        Self { offsets, targets }
    }

    /// Sorts each row and drops repeats in it.
    fn sort_rows(&mut self) {
        let mut kept = 0;
        for i in 0..self.len() {
            let (start, end) = (self.offsets[i], self.offsets[i + 1]);
            self.targets[start..end].sort_unstable();
            self.offsets[i] = kept;
            for k in start..end {
                let target = self.targets[k];
                if kept == self.offsets[i] || self.targets[kept - 1] != target {
                    self.targets[kept] = target;
                    kept += 1;
                }
            }
        }
        self.targets.truncate(kept);
        if let Some(last) = self.offsets.last_mut() {
            *last = kept;
        }
    }
}

/// The vertices sharing a face with each vertex: sorted, without repeats, without the vertex itself.
pub fn one_ring(vertex_count: usize, faces: &[[u32; 3]]) -> Result<Csr, MeshError> {
    check_faces(vertex_count, faces)?;
    let pairs = faces.iter().flat_map(|&[a, b, c]| [(a, b), (b, a), (b, c), (c, b), (c, a), (a, c)]);
    let mut ring = Csr::bucket(vertex_count, pairs.filter(|(a, b)| a != b));
    ring.sort_rows();
    Ok(ring)
}

/// The faces at each vertex, ascending; a face that names a vertex twice is listed once.
pub fn vertex_faces(vertex_count: usize, faces: &[[u32; 3]]) -> Result<Csr, MeshError> {
    check_faces(vertex_count, faces)?;
    let pairs = faces.iter().zip(0u32..).flat_map(|(corners, face)| corners.map(|v| (v, face)));
    let mut incidence = Csr::bucket(vertex_count, pairs);
    incidence.sort_rows();
    Ok(incidence)
}

/// The undirected edges of a mesh and the faces at each.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Edges {
    /// End points, lower index first; the list is sorted.
    pub ends: Vec<[u32; 2]>,
    /// The faces at each edge, ascending: one on the boundary, two inside, more where the mesh is not a manifold.
    pub faces: Csr,
    /// For each face its edges: entry `k` joins corner `k` to corner `k + 1`. [`NO_EDGE`] where the two corners are the same vertex.
    pub face_edges: Vec<[u32; 3]>,
}

/// Pairs of different vertices by (lower end, higher end, number of the pair), and where each lower end begins. An entry is the higher end above
/// the number. Pairs of a vertex with itself are left out.
pub(crate) fn ordered_pairs(
    vertex_count: usize,
    pairs: impl Iterator<Item = (u32, u32)> + Clone,
) -> (Vec<u32>, Vec<u64>) {
    let mut starts = vec![0u32; vertex_count + 1];
    for (a, b) in pairs.clone() {
        starts[a.min(b) as usize + 1] += u32::from(a != b);
    }
    for v in 0..vertex_count {
        starts[v + 1] += starts[v];
    }
    // Bucketed by the lower end: some six to a bucket.
    let mut next = starts.clone();
    let mut ordered = vec![0u64; starts[vertex_count] as usize];
    for ((a, b), number) in pairs.zip(0u32..) {
        if a != b {
            let slot = &mut next[a.min(b) as usize];
            ordered[*slot as usize] = u64::from(a.max(b)) << 32 | u64::from(number);
            *slot += 1;
        }
    }
    for v in 0..vertex_count {
        ordered[starts[v] as usize..starts[v + 1] as usize].sort_unstable();
    }
    (starts, ordered)
}

/// The side from each corner of each face to the next one.
fn sides(faces: &[[u32; 3]]) -> impl Iterator<Item = (u32, u32)> + Clone {
    faces.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
}

/// The side opposite each corner of each face.
pub(crate) fn opposite_sides(faces: &[[u32; 3]]) -> impl Iterator<Item = (u32, u32)> + Clone {
    faces.iter().flat_map(|&[a, b, c]| [(b, c), (c, a), (a, b)])
}

/// Finds the edges of a mesh.
pub fn edges(vertex_count: usize, faces: &[[u32; 3]]) -> Result<Edges, MeshError> {
    check_faces(vertex_count, faces)?;
    let (starts, ordered) = ordered_pairs(vertex_count, sides(faces));
    let mut ends: Vec<[u32; 2]> = Vec::with_capacity(ordered.len() / 2 + 1);
    let mut incident =
        Csr { offsets: Vec::with_capacity(ordered.len() / 2 + 2), targets: Vec::with_capacity(ordered.len()) };
    let mut face_edges = vec![[NO_EDGE; 3]; faces.len()];
    for v in 0..vertex_count {
        let mut last = u32::MAX;
        for &packed in &ordered[starts[v] as usize..starts[v + 1] as usize] {
            let (high, side) = ((packed >> 32) as u32, packed as u32);
            let (face, k) = (side / 3, (side % 3) as usize);
            let new = high != last;
            if new {
                last = high;
                ends.push([v as u32, high]);
                incident.offsets.push(incident.targets.len());
            }
            // A face that folds back on itself (a, b, a) is at its edge once.
            if new || incident.targets.last() != Some(&face) {
                incident.targets.push(face);
            }
            face_edges[face as usize][k] = ends.len() as u32 - 1;
        }
    }
    incident.offsets.push(incident.targets.len());
    Ok(Edges { ends, faces: incident, face_edges })
}

/// Marks the vertices on edges that have exactly one side.
pub(crate) fn on_rim(vertex_count: usize, faces: &[[u32; 3]]) -> Vec<bool> {
    let (starts, ordered) = ordered_pairs(vertex_count, sides(faces));
    let mut rim = vec![false; vertex_count];
    for v in 0..vertex_count {
        let row = &ordered[starts[v] as usize..starts[v + 1] as usize];
        for group in row.chunk_by(|x, y| x >> 32 == y >> 32) {
            if let [single] = *group {
                rim[v] = true;
                rim[(single >> 32) as usize] = true;
            }
        }
    }
    rim
}

/// The edges at each vertex, ascending, of a list of edges with ends below `vertex_count`.
pub(crate) fn spokes(vertex_count: usize, ends: &[[u32; 2]]) -> Csr {
    Csr::bucket(vertex_count, ends.iter().zip(0u32..).flat_map(|(&[a, b], e)| [(a, e), (b, e)]))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: [[u32; 3]; 2] = [[0, 1, 2], [2, 1, 3]];

    #[test]
    fn rings_of_two_triangles() {
        let ring = one_ring(5, &TWO).unwrap();
        let rows: Vec<&[u32]> = (0..5).map(|i| ring.row(i)).collect();
        assert_eq!(rows, [&[1, 2][..], &[0, 2, 3], &[0, 1, 3], &[1, 2], &[]]);
        assert_eq!(vertex_faces(5, &TWO).unwrap().row(1), [0, 1]);
    }

    #[test]
    fn edges_know_their_faces() {
        let edges = edges(5, &TWO).unwrap();
        assert_eq!(edges.ends, [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]]);
        assert_eq!(edges.faces.row(2), [0, 1]);
        assert_eq!(edges.face_edges, [[0, 2, 1], [2, 3, 4]]);
    }

    #[test]
    fn degenerate_and_empty_input() {
        let edges = edges(3, &[[0, 0, 1], [2, 2, 2]]).unwrap();
        assert_eq!(edges.ends, [[0, 1]]);
        assert_eq!(edges.faces.row(0), [0]);
        assert_eq!(edges.face_edges, [[NO_EDGE, 0, 0], [NO_EDGE; 3]]);
        assert!(one_ring(0, &[]).unwrap().is_empty());
        let refused = one_ring(2, &[[0, 1, 2]]).unwrap_err();
        assert_eq!(refused, MeshError::IndexOutOfRange { face: 0, index: 2, vertices: 2 });
        let nan = check_mesh(&[[0.0; 3], [f64::NAN, 0.0, 0.0]], &[]).unwrap_err();
        assert_eq!(nan, MeshError::NonFinite { vertex: 1 });
    }
}
