//! Vectors that stand for a whole surface, by what it looks like in space: [`harmonics`] do not depend on how it is turned,
//! [`views`] turn it to its principal axes.

pub mod harmonics;
pub mod views;

use crate::vec3::{add, norm, normal, scale};

/// Points spread over a surface: `count` or somewhat more, each with its share of the area (they sum to 1). Every face has some, in a regular pattern.
pub(crate) fn samples(vertices: &[[f64; 3]], faces: &[[u32; 3]], count: usize) -> Vec<([f64; 3], f64)> {
    let corners = |f: &[u32; 3]| f.map(|v| vertices[v as usize]);
    let areas: Vec<f64> = faces
        .iter()
        .map(|f| {
            let [a, b, c] = corners(f);
            norm(normal(a, b, c)) / 2.0
        })
        .collect();
    let total: f64 = areas.iter().sum();
    let mut all = Vec::new();
    for (face, area) in faces.iter().zip(&areas).filter(|(_, area)| **area > 0.0) {
        let [a, b, c] = corners(face);
        // n² small triangles, by their centres.
        let n = ((count as f64 * area / total).sqrt().ceil() as usize).clamp(1, 200);
        let (step, weight) = (1.0 / n as f64, area / total / (n * n) as f64);
        for i in 0..n {
            for j in 0..n - i {
                let mut put = |u: f64, v: f64| {
                    let p = add(add(scale(a, 1.0 - u - v), scale(b, u)), scale(c, v));
                    all.push((p, weight));
                };
                let (u, v) = (i as f64 * step, j as f64 * step);
                put(u + step / 3.0, v + step / 3.0);
                if i + j + 1 < n {
                    put(u + 2.0 * step / 3.0, v + 2.0 * step / 3.0);
                }
            }
        }
    }
    all
}

/// The centre of the area.
pub(crate) fn centre(points: &[([f64; 3], f64)]) -> [f64; 3] {
    points.iter().fold([0.0; 3], |sum, (p, w)| add(sum, scale(*p, *w)))
}
