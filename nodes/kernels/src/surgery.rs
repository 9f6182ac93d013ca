//! A triangle mesh that can be edited: edge collapse, split and flip that keep its topology.
//!
//! Shared by decimation and remeshing. Each vertex holds the list of its live faces; lists are short (about six).

use crate::vec3::{distance2, dot, norm, normal};

/// The editable connectivity. Removed faces and vertices keep their numbers and are marked.
pub(crate) struct Surgery {
    pub(crate) faces: Vec<[u32; 3]>,
    pub(crate) alive: Vec<bool>,
    /// Live faces of each vertex; empty for removed vertices.
    pub(crate) star: Vec<Vec<u32>>,
    /// Memory of [`Self::can_collapse`].
    rings: [Vec<u32>; 2],
}

/// The one or two faces at an edge and the corners opposite to it.
#[derive(Clone, Copy)]
pub(crate) struct EdgeSide {
    pub(crate) face: u32,
    pub(crate) far: u32,
}

impl Surgery {
    /// Faces naming a vertex twice are left out.
    pub(crate) fn new(vertex_count: usize, faces: &[[u32; 3]]) -> Self {
        let mut counts = vec![0; vertex_count];
        faces.iter().flatten().for_each(|&v| counts[v as usize] += 1);
        // A collapse adds two faces, as a rule.
        let mut star: Vec<Vec<u32>> = counts.into_iter().map(|count| Vec::with_capacity(count + 2)).collect();
        let mut alive = vec![true; faces.len()];
        for (f, &[a, b, c]) in faces.iter().enumerate() {
            if a == b || b == c || c == a {
                alive[f] = false;
            } else {
                for v in [a, b, c] {
                    star[v as usize].push(f as u32);
                }
            }
        }
        Self { faces: faces.to_vec(), alive, star, rings: Default::default() }
    }

    /// The faces at edge `ab`, by ascending number.
    pub(crate) fn sides(&self, a: u32, b: u32) -> Vec<EdgeSide> {
        let mut sides: Vec<EdgeSide> = self.sides_of(a, b).collect();
        sides.sort_unstable_by_key(|s| s.face);
        sides
    }

    /// The same in no order, without a list.
    fn sides_of(&self, a: u32, b: u32) -> impl Iterator<Item = EdgeSide> + '_ {
        let side = move |&face: &u32| {
            let corners = self.faces[face as usize];
            let far = corners.into_iter().find(|&v| v != a && v != b).filter(|_| corners.contains(&b));
            far.map(|far| EdgeSide { face, far })
        };
        self.star[a as usize].iter().filter_map(side)
    }

    /// How many faces are at edge `ab`.
    pub(crate) fn sides_at(&self, a: u32, b: u32) -> usize {
        self.sides_of(a, b).count()
    }

    /// The neighbours of `v`, ascending, and whether some edge at `v` has one face only.
    pub(crate) fn ring(&self, v: u32) -> (Vec<u32>, bool) {
        let mut ring = Vec::new();
        let boundary = self.write_ring(v, &mut ring);
        (ring, boundary)
    }

    /// The same into a list that is there.
    pub(crate) fn write_ring(&self, v: u32, ring: &mut Vec<u32>) -> bool {
        ring.clear();
        for &f in &self.star[v as usize] {
            ring.extend(self.opposite(f, v));
        }
        ring.sort_unstable();
        let boundary = ring.chunk_by(|a, b| a == b).any(|run| run.len() == 1);
        ring.dedup();
        boundary
    }

    /// The two other corners of a face, in its order after `v`.
    pub(crate) fn opposite(&self, face: u32, v: u32) -> [u32; 2] {
        let [a, b, c] = self.faces[face as usize];
        match v {
            _ if v == a => [b, c],
            _ if v == b => [c, a],
            _ => [a, b],
        }
    }

    /// The link condition (Dey et al. 1999): collapsing `ab` keeps the topology, boundary included.
    pub(crate) fn can_collapse(&mut self, a: u32, b: u32) -> bool {
        let (mut sides, mut far) = (0, [u32::MAX; 2]);
        for side in self.sides_of(a, b) {
            if sides == 2 {
                return false;
            }
            far[sides] = side.far;
            sides += 1;
        }
        if sides == 0 {
            return false;
        }
        let mut rings = std::mem::take(&mut self.rings);
        let on_rim =
            [a, b].into_iter().zip(&mut rings).map(|(v, ring)| self.write_ring(v, ring)).fold(true, |x, y| x & y);
        let linked = !(on_rim && sides == 2) && common(&rings[0], &rings[1], &mut far[..sides]);
        self.rings = rings;
        if !linked {
            return false;
        }
        // No edge may be opposite to both ends, which could only be the one between the far corners: two faces would become one (the last
        // tetrahedron).
        let mesh = &*self;
        let across = |v: u32| {
            let mut edges = mesh.star[v as usize].iter().map(|&f| mesh.opposite(f, v));
            edges.any(|[p, q]| [p.min(q), p.max(q)] == far)
        };
        if across(a) && across(b) {
            return false;
        }
        // A lone boundary triangle, or one hanging by a corner, must not vanish into an edge.
        sides == 2 || self.sides_at(a, far[0]) + self.sides_at(b, far[0]) > 2
    }

    /// Collapses `b` into `a`. The caller has asked [`Self::can_collapse`].
    pub(crate) fn collapse(&mut self, a: u32, b: u32) {
        for face in std::mem::take(&mut self.star[b as usize]) {
            let corners = self.faces[face as usize];
            if corners.contains(&a) {
                self.alive[face as usize] = false;
                for v in corners {
                    self.star[v as usize].retain(|&f| f != face);
                }
            } else {
                self.faces[face as usize] = corners.map(|v| if v == b { a } else { v });
                self.star[a as usize].push(face);
            }
        }
        self.star[a as usize].sort_unstable();
    }

    /// Puts the new vertex `middle` (the next free number) on edge `ab`.
    pub(crate) fn split(&mut self, a: u32, b: u32) -> u32 {
        let middle = self.star.len() as u32;
        self.star.push(Vec::new());
        for EdgeSide { face, .. } in self.sides(a, b) {
            let corners = self.faces[face as usize];
            let added = self.faces.len() as u32;
            self.faces[face as usize] = corners.map(|v| if v == b { middle } else { v });
            self.faces.push(corners.map(|v| if v == a { middle } else { v }));
            self.alive.push(true);
            self.star[b as usize].retain(|&f| f != face);
            for v in self.faces[added as usize] {
                self.star[v as usize].push(added);
            }
            self.star[middle as usize].push(face);
        }
        middle
    }

    /// Turns edge `ab` of two consistently oriented faces into the edge between their far corners, if that edge is new.
    pub(crate) fn flip(&mut self, a: u32, b: u32) -> bool {
        let [left, right] = self.sides(a, b)[..] else {
            return false;
        };
        let (p, q) = (left.far, right.far);
        if p == q || !self.sides(p, q).is_empty() || self.star[a as usize].len() < 4 || self.star[b as usize].len() < 4
        {
            return false;
        }
        // `left` keeps a, `right` keeps b; each takes the other's far corner in place of its lost one.
        let put = |corners: [u32; 3], old: u32, new: u32| corners.map(|v| if v == old { new } else { v });
        self.faces[left.face as usize] = put(self.faces[left.face as usize], b, q);
        self.faces[right.face as usize] = put(self.faces[right.face as usize], a, p);
        self.star[b as usize].retain(|&f| f != left.face);
        self.star[a as usize].retain(|&f| f != right.face);
        self.star[q as usize].push(left.face);
        self.star[p as usize].push(right.face);
        for v in [p, q] {
            self.star[v as usize].sort_unstable();
        }
        true
    }

    /// Whether the faces of `v` that do not contain `other` keep their orientation when `v` moves to `to`: the normals turn
    /// by less than the angle of cosine `least`, and no face becomes flatter than `flattest` (height over longest edge), unless it was flat before.
    pub(crate) fn move_keeps_normals(
        &self,
        points: &[[f64; 3]],
        v: u32,
        other: u32,
        to: [f64; 3],
        least: f64,
        flattest: f64,
    ) -> bool {
        self.star[v as usize].iter().all(|&f| {
            let [p, q] = self.opposite(f, v);
            if p == other || q == other {
                return true;
            }
            let (p, q) = (points[p as usize], points[q as usize]);
            let (old, new) = (normal(points[v as usize], p, q), normal(to, p, q));
            let shape = |apex: [f64; 3], doubled: [f64; 3]| {
                let longest2 = distance2(apex, p).max(distance2(p, q)).max(distance2(q, apex));
                if longest2 > 0.0 { norm(doubled) / longest2 } else { 0.0 }
            };
            let was = shape(points[v as usize], old);
            // A face that was flat had no direction worth keeping.
            let turned = was > flattest && dot(old, new) < least * norm(old) * norm(new);
            !turned && shape(to, new) > flattest.min(0.5 * was)
        })
    }

    /// The live edges, lower end first, ascending.
    pub(crate) fn edges(&self) -> Vec<[u32; 2]> {
        let (mut edges, mut ends) = (Vec::with_capacity(self.faces.len() * 3 / 2), Vec::new());
        for (v, star) in self.star.iter().enumerate() {
            let v = v as u32;
            ends.clear();
            ends.extend(star.iter().flat_map(|&f| self.faces[f as usize]).filter(|w| *w > v));
            ends.sort_unstable();
            ends.dedup();
            edges.extend(ends.iter().map(|w| [v, *w]));
        }
        edges
    }

    /// The live vertices, ascending, and the live faces over their new numbers.
    pub(crate) fn finish(&self) -> (Vec<u32>, Vec<[u32; 3]>) {
        let kept: Vec<u32> = (0..self.star.len() as u32).filter(|&v| !self.star[v as usize].is_empty()).collect();
        let mut new_of = vec![u32::MAX; self.star.len()];
        for (new, &old) in kept.iter().enumerate() {
            new_of[old as usize] = new as u32;
        }
        let live = self.faces.iter().zip(&self.alive).filter(|(_, alive)| **alive);
        let faces = live.map(|(f, _)| f.map(|v| new_of[v as usize])).collect();
        (kept, faces)
    }
}

/// Whether two ascending lists have just these in common, which are sorted for it.
fn common(x: &[u32], y: &[u32], expected: &mut [u32]) -> bool {
    expected.sort_unstable();
    let both = x.iter().filter(|v| y.binary_search(v).is_ok());
    both.eq(&*expected)
}
