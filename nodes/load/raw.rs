//! What a mesh file holds before any repair, and how its polygons become triangles.

use std::fmt::Display;

use salient_sdk::{Defect, DefectKind, NodeError};

/// The content of a file.
#[derive(Default)]
pub struct Raw {
    /// Positions, in the order of the file.
    pub vertices: Vec<[f64; 3]>,
    /// Triangles over `vertices`.
    pub faces: Vec<[u32; 3]>,
    /// Polygons that were split into triangles.
    pub polygons: Option<Defect>,
    /// Where vertices were before they were posed: what welding compares. `None`: as in `vertices`.
    pub bind: Option<Vec<[f64; 3]>>,
    /// Number of vertices and faces up to the end of each part; parts are welded apart. Empty: one part.
    pub parts: Vec<(usize, usize)>,
}

/// An error at a place of a file.
pub fn bad(format: &str, place: impl Display, what: impl Display) -> NodeError {
    NodeError::new(format!("{format}, {place}: {what}"))
}

/// Faces as they are read: corners of polygons of any number of sides, at least three.
#[derive(Default)]
pub struct Polygons {
    corners: Vec<u32>,
    ends: Vec<usize>,
}

/// Polygons that are not convex are cut corner by corner, which takes quadratic to cubic time.
const MOST_CORNERS: usize = 1024;

impl Polygons {
    /// Adds a polygon of at least three corners.
    pub fn push(&mut self, corners: impl IntoIterator<Item = u32>) {
        self.corners.extend(corners);
        self.ends.push(self.corners.len());
    }

    /// Splits the polygons: a quad along its shorter diagonal (the inner one if it is not convex), a convex polygon
    /// into a fan about its first corner, any other by cutting ears. Faces keep their order.
    pub fn into_raw(self, format: &str, vertices: Vec<[f64; 3]>) -> Result<Raw, NodeError> {
        let mut faces = Vec::with_capacity(self.ends.len());
        let (mut split, mut first) = (0, Vec::new());
        let mut start = 0;
        for (i, &end) in self.ends.iter().enumerate() {
            let polygon = &self.corners[start..end];
            start = end;
            if let [a, b, c] = *polygon {
                faces.push([a, b, c]);
                continue;
            }
            split += 1;
            if first.len() < 8 {
                first.push(i as u32);
            }
            let points: Vec<_> = polygon.iter().map(|&v| vertices[v as usize]).collect();
            let triangles = triangulate(&points).ok_or_else(|| {
                let n = points.len();
                bad(
                    format,
                    format_args!("face {i}"),
                    format_args!("has {n} corners and is not convex; at most {MOST_CORNERS} can be triangulated"),
                )
            })?;
            faces.extend(triangles.into_iter().map(|t| t.map(|k| polygon[k])));
        }
        let polygons = (split > 0).then_some(Defect { kind: DefectKind::Polygon, count: split, first, repaired: true });
        Ok(Raw { vertices, faces, polygons, ..Raw::default() })
    }
}

/// Triangles over the corners of a polygon, or `None` if it has too many to cut ears.
fn triangulate(p: &[[f64; 3]]) -> Option<Vec<[usize; 3]>> {
    let normal = newell(p);
    if let [a, b, c, d] = *p {
        let inside = |t: [[f64; 3]; 3]| dot(cross(t), normal) > 0.0;
        let ac = inside([a, b, c]) && inside([a, c, d]);
        let bd = inside([a, b, d]) && inside([b, c, d]);
        let along_bd = if ac == bd { length2(b, d) < length2(a, c) } else { bd };
        return Some(if along_bd { vec![[0, 1, 3], [1, 2, 3]] } else { vec![[0, 1, 2], [0, 2, 3]] });
    }
    let n = p.len();
    let convex = (0..n).all(|i| dot(cross([p[i], p[(i + 1) % n], p[(i + 2) % n]]), normal) >= 0.0);
    if convex {
        return Some((2..n).map(|i| [0, i - 1, i]).collect());
    }
    (n <= MOST_CORNERS).then(|| cut_ears(p, normal))
}

/// Cuts the first corner that is convex and whose triangle holds no other corner, again and again. What is left of a
/// polygon that crosses itself, and so has no such corner, is fanned.
fn cut_ears(p: &[[f64; 3]], normal: [f64; 3]) -> Vec<[usize; 3]> {
    let mut left: Vec<usize> = (0..p.len()).collect();
    let mut triangles = Vec::with_capacity(p.len() - 2);
    let side = |a: usize, b: usize, c: usize| dot(cross([p[a], p[b], p[c]]), normal);
    while left.len() > 3 {
        let m = left.len();
        let ear = (0..m).find(|&i| {
            let (a, b, c) = (left[(i + m - 1) % m], left[i], left[(i + 1) % m]);
            let blocked = |&q: &usize| {
                p[q] != p[a]
                    && p[q] != p[b]
                    && p[q] != p[c]
                    && side(a, b, q) >= 0.0
                    && side(b, c, q) >= 0.0
                    && side(c, a, q) >= 0.0
            };
            side(a, b, c) > 0.0 && !left.iter().any(blocked)
        });
        let Some(i) = ear else { break };
        triangles.push([left[(i + m - 1) % m], left[i], left[(i + 1) % m]]);
        left.remove(i);
    }
    triangles.extend((2..left.len()).map(|i| [left[0], left[i - 1], left[i]]));
    triangles
}

/// Twice the vector area of a polygon.
fn newell(p: &[[f64; 3]]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for i in 1..p.len() - 1 {
        let part = cross([p[0], p[i], p[i + 1]]);
        (0..3).for_each(|k| sum[k] += part[k]);
    }
    sum
}

fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
fn length2(a: [f64; 3], b: [f64; 3]) -> f64 {
    dot(sub(a, b), sub(a, b))
}
fn cross([a, b, c]: [[f64; 3]; 3]) -> [f64; 3] {
    let (u, v) = (sub(b, a), sub(c, a));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}
