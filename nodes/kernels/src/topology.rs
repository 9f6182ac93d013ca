//! Components, defects and repairs of triangle meshes, and their size.
//!
//! Nothing here is changed silently: [`census`] lists what is wrong, and each repair is asked for by name and says where
//! its vertices came from.

use crate::adjacency::{self, Edges, MeshError};
use crate::vec3::{distance2, norm, normal};

/// A face counts as having zero area when twice its area is at most this fraction of its longest edge squared.
pub const ZERO_AREA: f64 = 1e-12;

/// Disjoint sets over `0..n`; the representative of a set is its lowest member.
pub(crate) struct Sets(Vec<u32>);

impl Sets {
    pub(crate) fn new(n: usize) -> Self {
        Self((0..n as u32).collect())
    }

    pub(crate) fn find(&mut self, mut i: u32) -> u32 {
        while self.0[i as usize] != i {
            let up = self.0[self.0[i as usize] as usize];
            self.0[i as usize] = up;
            i = up;
        }
        i
    }

    pub(crate) fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }

    /// Labels `0..k` in order of lowest member, and `k`.
    pub(crate) fn labels(&mut self) -> (Vec<u32>, usize) {
        let mut label = vec![0; self.0.len()];
        let mut count = 0;
        for i in 0..self.0.len() as u32 {
            let root = self.find(i);
            if root == i {
                label[i as usize] = count;
                count += 1;
            } else {
                label[i as usize] = label[root as usize];
            }
        }
        (label, count as usize)
    }
}

/// The connected components of a mesh, vertices being connected through faces.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Components {
    /// The component of each vertex, counted in order of each component's lowest vertex. An unreferenced vertex is a component.
    pub label: Vec<u32>,
    /// Vertices in each component.
    pub vertices: Vec<usize>,
    /// Faces in each component.
    pub faces: Vec<usize>,
}

/// Finds the connected components.
pub fn components(vertex_count: usize, faces: &[[u32; 3]]) -> Result<Components, MeshError> {
    adjacency::check_faces(vertex_count, faces)?;
    let mut sets = Sets::new(vertex_count);
    for &[a, b, c] in faces {
        sets.join(a, b);
        sets.join(b, c);
    }
    let (label, count) = sets.labels();
    let (mut vertices, mut per_face) = (vec![0; count], vec![0; count]);
    for &l in &label {
        vertices[l as usize] += 1;
    }
    for f in faces {
        per_face[label[f[0] as usize] as usize] += 1;
    }
    Ok(Components { label, vertices, faces: per_face })
}

/// What keeps a mesh from being a clean closed surface, item by item.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Census {
    /// Edges with more than two faces.
    pub non_manifold_edges: Vec<[u32; 2]>,
    /// Vertices whose faces form more than one fan (faces joined across shared edges).
    pub non_manifold_vertices: Vec<u32>,
    /// Edges with two faces that both run along it in the same direction.
    pub inconsistent_edges: Vec<[u32; 2]>,
    /// Faces without area, by [`ZERO_AREA`], those naming a vertex twice included.
    pub zero_area_faces: Vec<u32>,
    /// Vertices with exactly the coordinates of an earlier one: `[vertex, earlier]`.
    pub duplicate_vertices: Vec<[u32; 2]>,
    /// Vertices that no face names.
    pub unreferenced_vertices: Vec<u32>,
    /// Edges with exactly one face.
    pub boundary_edges: usize,
    /// Closed curves that the boundary edges form; curves that only touch in a vertex are counted apart.
    pub boundary_loops: usize,
    /// Vertices, faces and label of each component.
    pub components: Components,
    /// Vertices - edges + faces of each component; 2 for a sphere, 1 for a disc.
    pub euler: Vec<i64>,
}

impl Census {
    /// Whether the mesh is one closed, consistently oriented manifold without degenerate faces or stray vertices.
    #[must_use]
    pub fn is_closed_manifold(&self) -> bool {
        self.non_manifold_edges.is_empty()
            && self.non_manifold_vertices.is_empty()
            && self.inconsistent_edges.is_empty()
            && self.zero_area_faces.is_empty()
            && self.unreferenced_vertices.is_empty()
            && self.boundary_edges == 0
            && self.euler.len() == 1
    }
}

/// Takes the census of a mesh. Refuses indices out of range and coordinates that are not finite.
pub fn census(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Result<Census, MeshError> {
    adjacency::check_mesh(vertices, faces)?;
    let edges = adjacency::edges(vertices.len(), faces)?;
    let components = components(vertices.len(), faces)?;
    let (mut non_manifold_edges, mut inconsistent_edges) = (Vec::new(), Vec::new());
    let mut euler: Vec<i64> =
        (0..components.vertices.len()).map(|c| components.vertices[c] as i64 + components.faces[c] as i64).collect();
    for (e, &ends) in edges.ends.iter().enumerate() {
        euler[components.label[ends[0] as usize] as usize] -= 1;
        match edges.faces.row(e) {
            &[left, right] if forward(faces, left, ends) == forward(faces, right, ends) => {
                inconsistent_edges.push(ends);
            }
            row if row.len() > 2 => non_manifold_edges.push(ends),
            _ => {}
        }
    }
    let fans = Fans::new(faces, &edges, true);
    let mut fan_count = vec![0u32; vertices.len()];
    fans.vertex.iter().for_each(|&v| fan_count[v as usize] += 1);
    let with_fans =
        |wanted: fn(u32) -> bool| (0..vertices.len() as u32).filter(|&v| wanted(fan_count[v as usize])).collect();
    let (boundary_edges, boundary_loops) = boundary(&fans, &edges);
    Ok(Census {
        non_manifold_edges,
        non_manifold_vertices: with_fans(|n| n > 1),
        inconsistent_edges,
        zero_area_faces: (0..faces.len() as u32).filter(|&f| zero_area(vertices, faces[f as usize])).collect(),
        duplicate_vertices: duplicates(vertices),
        unreferenced_vertices: with_fans(|n| n == 0),
        boundary_edges,
        boundary_loops,
        components,
        euler,
    })
}

/// Whether a face runs along the edge from its first end to its second.
fn forward(faces: &[[u32; 3]], face: u32, [a, b]: [u32; 2]) -> bool {
    let f = faces[face as usize];
    (0..3).any(|k| f[k] == a && f[(k + 1) % 3] == b)
}

/// Whether a face has no area, by [`ZERO_AREA`].
fn zero_area(vertices: &[[f64; 3]], face: [u32; 3]) -> bool {
    let [a, b, c] = face.map(|v| vertices[v as usize]);
    let longest = distance2(a, b).max(distance2(b, c)).max(distance2(c, a));
    norm(normal(a, b, c)) <= ZERO_AREA * longest
}

/// Pairs `[vertex, first vertex with the same coordinates]`, ascending.
fn duplicates(vertices: &[[f64; 3]]) -> Vec<[u32; 2]> {
    // Adding zero turns -0.0 into 0.0, so that the two compare as equal.
    let key = |i: u32| vertices[i as usize].map(|x| x + 0.0);
    let compare = |i: &u32, j: &u32| {
        let (p, q) = (key(*i), key(*j));
        let by_axis = (0..3).map(|k| p[k].total_cmp(&q[k])).find(|o| o.is_ne());
        by_axis.unwrap_or(std::cmp::Ordering::Equal)
    };
    let mut order: Vec<u32> = (0..vertices.len() as u32).collect();
    order.sort_by(compare);
    let mut found = Vec::new();
    for group in order.chunk_by(|i, j| compare(i, j).is_eq()) {
        found.extend(group[1..].iter().map(|&later| [later, group[0]]));
    }
    found.sort_unstable();
    found
}

/// The corners of a mesh grouped into fans: runs of faces about a vertex, joined across shared edges.
pub(crate) struct Fans {
    /// The fan of each corner of each face.
    pub(crate) corner: Vec<[u32; 3]>,
    /// The vertex of each fan.
    pub(crate) vertex: Vec<u32>,
}

impl Fans {
    /// Groups corners. Edges with more than two faces join them all if `across_singular`, and are cuts otherwise.
    pub(crate) fn new(faces: &[[u32; 3]], edges: &Edges, across_singular: bool) -> Self {
        let mut sets = Sets::new(faces.len() * 3);
        // Corners of one face at one vertex (a face may name a vertex twice) belong together.
        for (f, corners) in faces.iter().enumerate() {
            for (i, j) in [(0, 1), (1, 2), (0, 2)] {
                if corners[i] == corners[j] {
                    sets.join((3 * f + i) as u32, (3 * f + j) as u32);
                }
            }
        }
        let corner_at =
            |face: u32, v: u32| faces[face as usize].iter().position(|&c| c == v).map(|k| 3 * face + k as u32);
        for (e, &ends) in edges.ends.iter().enumerate() {
            let around = edges.faces.row(e);
            if around.len() > 2 && !across_singular {
                continue;
            }
            for pair in around.windows(2) {
                for v in ends {
                    if let (Some(i), Some(j)) = (corner_at(pair[0], v), corner_at(pair[1], v)) {
                        sets.join(i, j);
                    }
                }
            }
        }
        let (label, count) = sets.labels();
        let mut vertex = vec![0; count];
        let corner: Vec<[u32; 3]> = (0..faces.len()).map(|f| [0, 1, 2].map(|k| label[3 * f + k])).collect();
        for (fans, corners) in corner.iter().zip(faces) {
            for (&fan, &v) in fans.iter().zip(corners) {
                vertex[fan as usize] = v;
            }
        }
        Self { corner, vertex }
    }
}

/// Number of edges with one face, and of the closed curves they form.
fn boundary(fans: &Fans, edges: &Edges) -> (usize, usize) {
    let mut sets = Sets::new(fans.vertex.len());
    let mut on_boundary = vec![false; fans.vertex.len()];
    let mut count = 0;
    for (face, sides) in edges.face_edges.iter().enumerate() {
        for (k, &side) in sides.iter().enumerate() {
            if side != adjacency::NO_EDGE && edges.faces.row(side as usize).len() == 1 {
                let (i, j) = (fans.corner[face][k], fans.corner[face][(k + 1) % 3]);
                sets.join(i, j);
                on_boundary[i as usize] = true;
                on_boundary[j as usize] = true;
                count += 1;
            }
        }
    }
    let loops = (0..fans.vertex.len() as u32).filter(|&f| on_boundary[f as usize] && sets.find(f) == f);
    (count, loops.count())
}

/// A mesh after a repair.
#[derive(Debug, Clone, PartialEq)]
pub struct Repaired {
    /// Vertex positions, taken over unchanged.
    pub vertices: Vec<[f64; 3]>,
    /// Faces over the new vertices.
    pub faces: Vec<[u32; 3]>,
    /// For each new vertex the old vertex it came from, ascending.
    pub source: Vec<u32>,
}

/// Keeps the vertices for which `target` names themselves, and renames the others to their target in the faces.
fn rebuild(vertices: &[[f64; 3]], faces: impl Iterator<Item = [u32; 3]>, target: &[Option<u32>]) -> Repaired {
    let source: Vec<u32> = (0..vertices.len() as u32).filter(|&v| target[v as usize] == Some(v)).collect();
    let mut renamed = vec![u32::MAX; vertices.len()];
    for (new, &old) in source.iter().enumerate() {
        renamed[old as usize] = new as u32;
    }
    let of = |v: u32| target[v as usize].map_or(u32::MAX, |kept| renamed[kept as usize]);
    Repaired {
        vertices: source.iter().map(|&v| vertices[v as usize]).collect(),
        faces: faces.map(|f| f.map(of)).collect(),
        source,
    }
}

/// Merges vertices with exactly equal coordinates into the first of them. Faces that collapse stay, as zero-area faces:
/// [`drop_degenerate`] removes them.
pub fn weld(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Result<Repaired, MeshError> {
    adjacency::check_mesh(vertices, faces)?;
    let mut target: Vec<Option<u32>> = (0..vertices.len() as u32).map(Some).collect();
    for [vertex, first] in duplicates(vertices) {
        target[vertex as usize] = Some(first);
    }
    Ok(rebuild(vertices, faces.iter().copied(), &target))
}

/// Removes the faces without area, by [`ZERO_AREA`]. All vertices stay: [`drop_unreferenced`] removes those left alone.
pub fn drop_degenerate(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Result<Repaired, MeshError> {
    adjacency::check_mesh(vertices, faces)?;
    let target: Vec<Option<u32>> = (0..vertices.len() as u32).map(Some).collect();
    Ok(rebuild(vertices, faces.iter().copied().filter(|&f| !zero_area(vertices, f)), &target))
}

/// Removes the vertices that no face names.
pub fn drop_unreferenced(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Result<Repaired, MeshError> {
    adjacency::check_mesh(vertices, faces)?;
    let mut target = vec![None; vertices.len()];
    faces.iter().flatten().for_each(|&v| target[v as usize] = Some(v));
    Ok(rebuild(vertices, faces.iter().copied(), &target))
}

/// Keeps the component with the most faces; the one with the lowest vertex among equals.
pub fn largest_component(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Result<Repaired, MeshError> {
    adjacency::check_mesh(vertices, faces)?;
    let found = components(vertices.len(), faces)?;
    let largest = (0..found.faces.len()).max_by_key(|&c| (found.faces[c], std::cmp::Reverse(c)));
    let kept = |v: u32| (Some(found.label[v as usize] as usize) == largest).then_some(v);
    let target: Vec<Option<u32>> = (0..vertices.len() as u32).map(kept).collect();
    Ok(rebuild(vertices, faces.iter().copied().filter(|f| kept(f[0]).is_some()), &target))
}

/// Total area of the faces. Refuses indices out of range and coordinates that are not finite.
pub fn surface_area(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Result<f64, MeshError> {
    adjacency::check_mesh(vertices, faces)?;
    let doubled: f64 = faces
        .iter()
        .map(|f| {
            let [a, b, c] = f.map(|v| vertices[v as usize]);
            norm(normal(a, b, c))
        })
        .sum();
    Ok(doubled / 2.0)
}

/// The lowest and the highest coordinates, or `None` without vertices.
#[must_use]
pub fn bounding_box(vertices: &[[f64; 3]]) -> Option<([f64; 3], [f64; 3])> {
    let first = *vertices.first()?;
    Some(vertices.iter().fold((first, first), |(low, high), p| {
        ([0, 1, 2].map(|k| low[k].min(p[k])), [0, 1, 2].map(|k| high[k].max(p[k])))
    }))
}
