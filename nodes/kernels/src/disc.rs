//! Geodesic discs: the part of a mesh within a given distance of a vertex, as a mesh of its own.
//!
//! The patches of Hu & Hua (2009), section 4, are discs of radius `1.7 / sqrt(lambda)` about a feature. Cutting the
//! triangles at the iso-distance, rather than keeping whole triangles, makes patches of different triangulations alike.

use crate::adjacency::{self, Csr, MeshError};
use crate::geodesic::Ball;
use crate::topology::{Fans, Sets};
use crate::vec3::{distance2, lerp, norm, normal};

/// In [`Patch::source`]: the vertex was made by cutting an edge.
pub const CUT: u32 = u32::MAX;

/// A cut nearer than this fraction of an edge to one of its ends is moved onto that end, so that no slivers arise.
pub const SNAP: f64 = 0.03;

/// What a patch looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PatchKind {
    /// A topological disc about the centre.
    Disk,
    /// Bounded, but not a disc: it wraps around a limb, a hole or a handle. The name is the commonest case's.
    Annulus,
    /// Without boundary: the disc covers a closed component.
    Whole,
    /// No face, or the centre lies on the rim of the patch: the radius is too small for the mesh.
    TooSmall,
}

/// A piece of a mesh about a vertex, connected across edges and manifold.
#[derive(Debug, Clone, PartialEq)]
pub struct Patch {
    /// Vertex positions. Points where the piece only touches itself are split into one vertex for each side.
    pub vertices: Vec<[f64; 3]>,
    /// Faces over `vertices`, oriented as in the mesh.
    pub faces: Vec<[u32; 3]>,
    /// The mesh vertex of each patch vertex, or [`CUT`].
    pub source: Vec<u32>,
    /// Distance of each patch vertex from the centre; the radius at cuts.
    pub distance: Vec<f64>,
    /// The centre's index among `vertices` (0 for a patch without faces).
    pub center: u32,
    /// Whether the centre lies on the boundary of the mesh itself.
    pub center_on_boundary: bool,
    /// Number of boundary curves.
    pub loops: usize,
    /// Vertices - edges + faces: 1 for a disc, 0 for an annulus, 2 for a sphere.
    pub euler: i64,
    /// Total area of the faces.
    pub area: f64,
    /// What the patch looks like.
    pub kind: PatchKind,
}

impl Patch {
    fn empty() -> Self {
        Self {
            vertices: Vec::new(),
            faces: Vec::new(),
            source: Vec::new(),
            distance: Vec::new(),
            center: 0,
            center_on_boundary: false,
            loops: 0,
            euler: 0,
            area: 0.0,
            kind: PatchKind::TooSmall,
        }
    }
}

/// On which side of the iso-distance a vertex lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    In,
    On,
    Out,
}

/// Cuts discs out of one mesh: holds what is shared between them.
#[derive(Debug, Clone)]
pub struct DiscCutter<'a> {
    vertices: &'a [[f64; 3]],
    faces: &'a [[u32; 3]],
    incidence: Csr,
    distance: Vec<f64>,
    side: Vec<Side>,
    face_seen: Vec<bool>,
    /// The number of each vertex in the patch being made; [`NO_NUMBER`] between cuts.
    number: Vec<u32>,
}

const NO_NUMBER: u32 = u32::MAX;

/// A patch being put together: corners name mesh vertices, or `mesh vertex count + cut`.
struct Pieces {
    faces: Vec<[u32; 3]>,
    /// The mesh edge (inside end first) of each piece's cut corners.
    cuts: Vec<[u32; 2]>,
}

impl<'a> DiscCutter<'a> {
    /// Prepares a mesh. Refuses indices out of range and coordinates that are not finite.
    pub fn new(vertices: &'a [[f64; 3]], faces: &'a [[u32; 3]]) -> Result<Self, MeshError> {
        adjacency::check_mesh(vertices, faces)?;
        Ok(Self {
            vertices,
            faces,
            incidence: adjacency::vertex_faces(vertices.len(), faces)?,
            distance: vec![f64::INFINITY; vertices.len()],
            side: vec![Side::Out; vertices.len()],
            face_seen: vec![false; faces.len()],
            number: vec![NO_NUMBER; vertices.len()],
        })
    }

    /// The disc that `ball` describes, `center` being the ball's source: whole triangles within the radius or, with `clip`,
    /// triangles cut where the distance, taken as linear in each, equals the radius.
    ///
    /// The ball must come from a graph on this mesh. A centre that is not in the ball gives [`PatchKind::TooSmall`].
    pub fn cut(&mut self, center: u32, ball: &Ball<'_>, clip: bool) -> Patch {
        let known = |&&(v, _): &&(u32, f64)| (v as usize) < self.vertices.len();
        let settled: Vec<(u32, f64)> = ball.inside.iter().chain(ball.rim).filter(known).copied().collect();
        for &(v, d) in &settled {
            self.distance[v as usize] = d;
            self.side[v as usize] = if d <= ball.radius { Side::In } else { Side::Out };
        }
        let near = self.faces_about(ball.inside);
        if clip {
            self.snap(&near, ball.radius);
        }
        let pieces = if clip { self.clipped(&near, ball.radius) } else { self.unclipped(&near) };
        let patch = self.assemble(center, &pieces, ball.radius);
        for &(v, _) in &settled {
            self.distance[v as usize] = f64::INFINITY;
            self.side[v as usize] = Side::Out;
        }
        for &f in &near {
            self.face_seen[f as usize] = false;
        }
        patch
    }

    /// The faces with a vertex within the radius, ascending.
    fn faces_about(&mut self, inside: &[(u32, f64)]) -> Vec<u32> {
        let mut near = Vec::new();
        for &(v, _) in inside.iter().filter(|&&(v, _)| (v as usize) < self.vertices.len()) {
            for &f in self.incidence.row(v as usize) {
                if !std::mem::replace(&mut self.face_seen[f as usize], true) {
                    near.push(f);
                }
            }
        }
        near.sort_unstable();
        near
    }

    /// Where the iso-distance cuts an edge from an inside end, as a fraction of the edge.
    fn fraction(&self, a: u32, b: u32, radius: f64) -> f64 {
        let (da, db) = (self.distance[a as usize], self.distance[b as usize]);
        ((radius - da) / (db - da)).clamp(0.0, 1.0)
    }

    /// Puts vertices onto the iso-distance that a cut of some edge nearly meets. Each vertex is judged by the original sides.
    fn snap(&mut self, near: &[u32], radius: f64) {
        let mut on = Vec::new();
        for &f in near {
            let face = self.faces[f as usize];
            for (i, j) in [(0, 1), (1, 2), (2, 0), (1, 0), (2, 1), (0, 2)] {
                let (a, b) = (face[i], face[j]);
                if self.side[a as usize] == Side::In && self.side[b as usize] == Side::Out {
                    let t = self.fraction(a, b, radius);
                    if t <= SNAP {
                        on.push(a);
                    } else if t >= 1.0 - SNAP {
                        on.push(b);
                    }
                }
            }
        }
        for v in on {
            self.side[v as usize] = Side::On;
        }
    }

    fn unclipped(&self, near: &[u32]) -> Pieces {
        let inside = |f: &[u32; 3]| f.iter().all(|&v| self.side[v as usize] == Side::In);
        let faces = near.iter().map(|&f| self.faces[f as usize]).filter(inside).collect();
        Pieces { faces, cuts: Vec::new() }
    }

    fn clipped(&self, near: &[u32], radius: f64) -> Pieces {
        let mut raw: Vec<([u32; 2], usize)> = Vec::new();
        let mut faces: Vec<[u32; 3]> = Vec::new();
        // Cut corners are numbered as they are met, and merged by edge afterwards.
        let base = self.vertices.len() as u32;
        for &f in near {
            let face = self.faces[f as usize];
            let mut polygon: Vec<u32> = Vec::with_capacity(4);
            for k in 0..3 {
                let (a, b) = (face[k], face[(k + 1) % 3]);
                let (sa, sb) = (self.side[a as usize], self.side[b as usize]);
                if sa != Side::Out {
                    polygon.push(a);
                }
                if matches!((sa, sb), (Side::In, Side::Out) | (Side::Out, Side::In)) {
                    polygon.push(base + raw.len() as u32);
                    raw.push((if sa == Side::In { [a, b] } else { [b, a] }, raw.len()));
                }
            }
            let sides = face.map(|v| self.side[v as usize]);
            let mean = face.iter().map(|&v| self.distance[v as usize]).sum::<f64>() / 3.0;
            let keep = sides.contains(&Side::In) || (!sides.contains(&Side::Out) && mean <= radius);
            match (keep, polygon.as_slice()) {
                (true, &[a, b, c]) => faces.push([a, b, c]),
                (true, &[a, b, c, d]) => {
                    let at = |corner: u32| self.point(corner, &raw, radius);
                    if distance2(at(a), at(c)) <= distance2(at(b), at(d)) {
                        faces.extend([[a, b, c], [a, c, d]]);
                    } else {
                        faces.extend([[a, b, d], [b, c, d]]);
                    }
                }
                _ => {}
            }
        }
        merge_cuts(faces, raw, base)
    }

    /// The position of a corner while cuts are still numbered as met.
    fn point(&self, corner: u32, raw: &[([u32; 2], usize)], radius: f64) -> [f64; 3] {
        match (corner as usize).checked_sub(self.vertices.len()) {
            None => self.vertices[corner as usize],
            Some(cut) => self.cut_point(raw[cut].0, radius),
        }
    }

    fn cut_point(&self, [a, b]: [u32; 2], radius: f64) -> [f64; 3] {
        lerp(self.vertices[a as usize], self.vertices[b as usize], self.fraction(a, b, radius))
    }

    /// Keeps the part about the centre, splits it into a manifold and measures it.
    fn assemble(&mut self, center: u32, pieces: &Pieces, radius: f64) -> Patch {
        let (names, faces) = self.compact(pieces);
        let Some(local) = Local::new(&names, faces, center) else {
            return Patch::empty();
        };
        let mut patch = Patch::empty();
        for &corner in &local.vertex {
            let cut = (corner as usize).checked_sub(self.vertices.len());
            patch.vertices.push(match cut {
                None => self.vertices[corner as usize],
                Some(cut) => self.cut_point(pieces.cuts[cut], radius),
            });
            patch.source.push(if cut.is_some() { CUT } else { corner });
            patch.distance.push(if cut.is_some() { radius } else { self.distance[corner as usize] });
        }
        let doubled = |f: &[u32; 3]| {
            let [a, b, c] = f.map(|v| patch.vertices[v as usize]);
            norm(normal(a, b, c))
        };
        patch.area = local.faces.iter().map(doubled).sum::<f64>() / 2.0;
        patch.center = local.center;
        patch.loops = local.loops;
        patch.euler = local.euler;
        patch.center_on_boundary = self.on_boundary(center);
        patch.kind = match (local.loops, local.euler) {
            _ if local.center_on_rim && !patch.center_on_boundary => PatchKind::TooSmall,
            (0, _) => PatchKind::Whole,
            (1, 1) => PatchKind::Disk,
            _ => PatchKind::Annulus,
        };
        patch.faces = local.faces;
        patch
    }

    /// Renumbers the corners in use to `0..k`, ascending: their names, and the faces over them.
    fn compact(&mut self, pieces: &Pieces) -> (Vec<u32>, Vec<[u32; 3]>) {
        let base = self.vertices.len() as u32;
        let mut names = Vec::with_capacity(pieces.faces.len() / 2 + 2);
        for &corner in pieces.faces.iter().flatten().filter(|c| **c < base) {
            if std::mem::replace(&mut self.number[corner as usize], 0) == NO_NUMBER {
                names.push(corner);
            }
        }
        names.sort_unstable();
        for (&name, number) in names.iter().zip(0u32..) {
            self.number[name as usize] = number;
        }
        // Of cuts each is in use, or its edge would have no kept face; they come last, in their own order.
        let whole = names.len() as u32;
        names.extend((0..pieces.cuts.len() as u32).map(|cut| base + cut));
        let number = |corner: u32| if corner < base { self.number[corner as usize] } else { whole + (corner - base) };
        let faces = pieces.faces.iter().map(|f| f.map(number)).collect();
        for &name in &names[..whole as usize] {
            self.number[name as usize] = NO_NUMBER;
        }
        (names, faces)
    }

    /// Whether some edge at `v` has one face only.
    fn on_boundary(&self, v: u32) -> bool {
        let star = self.incidence.row(v as usize).iter().flat_map(|&f| self.faces[f as usize]);
        let mut others: Vec<u32> = star.filter(|&w| w != v).collect();
        others.sort_unstable();
        others.chunk_by(|a, b| a == b).any(|run| run.len() == 1)
    }
}

/// Gives the cuts of one edge one number.
fn merge_cuts(mut faces: Vec<[u32; 3]>, mut raw: Vec<([u32; 2], usize)>, base: u32) -> Pieces {
    let mut number = vec![0; raw.len()];
    raw.sort_unstable();
    let mut cuts: Vec<[u32; 2]> = Vec::new();
    for &(edge, met) in &raw {
        if cuts.last() != Some(&edge) {
            cuts.push(edge);
        }
        number[met] = base + cuts.len() as u32 - 1;
    }
    for corner in faces.iter_mut().flatten().filter(|c| **c >= base) {
        *corner = number[(*corner - base) as usize];
    }
    Pieces { faces, cuts }
}

/// The centre's part with its own vertex numbers, manifold, and its topology.
struct Local {
    /// The corner name of each local vertex.
    vertex: Vec<u32>,
    faces: Vec<[u32; 3]>,
    center: u32,
    center_on_rim: bool,
    loops: usize,
    euler: i64,
}

impl Local {
    /// `names` of corners, ascending, and the faces over them.
    fn new(names: &[u32], mut faces: Vec<[u32; 3]>, center: u32) -> Option<Self> {
        let center_name = names.binary_search(&center).ok()?;
        let start = faces.iter().position(|f| f.contains(&(center_name as u32)))?;
        let mut edges = adjacency::edges(names.len(), &faces).ok()?;
        // Faces are joined across proper edges only; an edge with three faces is a seam.
        let mut sets = Sets::new(faces.len());
        for e in 0..edges.ends.len() {
            if let &[left, right] = edges.faces.row(e) {
                sets.join(left, right);
            }
        }
        let home = sets.find(start as u32);
        let kept: Vec<[u32; 3]> = faces.iter().zip(0u32..).filter(|e| sets.find(e.1) == home).map(|e| *e.0).collect();
        let whole = kept.len() == faces.len();
        if !whole {
            faces = kept;
            edges = adjacency::edges(names.len(), &faces).ok()?;
        }
        // Splitting vertices into fans, seams being cuts, leaves a manifold whatever was there.
        let fans = Fans::new(&faces, &edges, false);
        let vertex: Vec<u32> = fans.vertex.iter().map(|&v| names[v as usize]).collect();
        let faces = fans.corner;
        let local_center = vertex.iter().position(|&v| v == center)?;
        // Where nothing was split, fans are the vertices by other numbers, and their edges are known.
        let seams = edges.faces.offsets.windows(2).any(|w| w[1] - w[0] > 2);
        let mut at_center = center_name;
        if !whole || seams || vertex.len() > names.len() {
            edges = adjacency::edges(vertex.len(), &faces).ok()?;
            at_center = local_center;
        }
        let mut rim = Sets::new(vertex.len());
        let mut on_rim = vec![false; vertex.len()];
        for (e, &[a, b]) in edges.ends.iter().enumerate() {
            if edges.faces.row(e).len() == 1 {
                rim.join(a, b);
                on_rim[a as usize] = true;
                on_rim[b as usize] = true;
            }
        }
        let loops = (0..vertex.len() as u32).filter(|&v| on_rim[v as usize] && rim.find(v) == v).count();
        let euler = vertex.len() as i64 - edges.ends.len() as i64 + faces.len() as i64;
        Some(Self { center: local_center as u32, center_on_rim: on_rim[at_center], vertex, faces, loops, euler })
    }
}
