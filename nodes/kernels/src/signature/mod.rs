//! Vectors that stand for a whole surface. By what it looks like in space: [`harmonics`] do not depend on how it is turned, [`views`] and
//! [`panorama`] turn it to its principal axes. By what its points are like: the words of a [`vocabulary`].

pub mod harmonics;
pub mod panorama;
pub mod views;
pub mod vocabulary;

use crate::vec3::{add, norm, normal, scale};

/// Points spread over a surface, by face.
pub(crate) fn samples(vertices: &[[f64; 3]], faces: &[[u32; 3]], count: usize) -> Vec<([f64; 3], f64)> {
    let mut all = Vec::new();
    spread(vertices, faces, count, |_, p, weight| all.push((p, weight)));
    all
}

/// Points spread over a surface: `count` or somewhat more, each with the index of its face and its share of the area (they sum to 1). Every face has
/// some, in a regular pattern.
fn spread(vertices: &[[f64; 3]], faces: &[[u32; 3]], count: usize, mut take: impl FnMut(usize, [f64; 3], f64)) {
    let corners = |f: &[u32; 3]| f.map(|v| vertices[v as usize]);
    let areas: Vec<f64> = faces
        .iter()
        .map(|f| {
            let [a, b, c] = corners(f);
            norm(normal(a, b, c)) / 2.0
        })
        .collect();
    let total: f64 = areas.iter().sum();
    for (index, area) in areas.iter().enumerate().filter(|(_, area)| **area > 0.0) {
        let [a, b, c] = corners(&faces[index]);
        // n² small triangles, by their centres.
        let n = ((count as f64 * area / total).sqrt().ceil() as usize).clamp(1, 200);
        let (step, weight) = (1.0 / n as f64, area / total / (n * n) as f64);
        for i in 0..n {
            for j in 0..n - i {
                let mut put = |u: f64, v: f64| {
                    take(index, add(add(scale(a, 1.0 - u - v), scale(b, u)), scale(c, v)), weight);
                };
                let (u, v) = (i as f64 * step, j as f64 * step);
                put(u + step / 3.0, v + step / 3.0);
                if i + j + 1 < n {
                    put(u + 2.0 * step / 3.0, v + 2.0 * step / 3.0);
                }
            }
        }
    }
}

/// The centre of the area.
pub(crate) fn centre(points: &[([f64; 3], f64)]) -> [f64; 3] {
    points.iter().fold([0.0; 3], |sum, (p, w)| add(sum, scale(*p, *w)))
}

/// Vertices that stand for a surface with their shares of its area: all, or `count` at even steps of the sum of their areas.
#[must_use]
pub fn by_area(mass: &[f64], count: usize) -> Vec<(usize, f64)> {
    let total = mass.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    if mass.len() <= count {
        return mass.iter().map(|m| m / total).enumerate().collect();
    }
    let step = 1.0 / count as f64;
    let mut sum = 0.0;
    let mut taken = 0;
    let mut found = Vec::with_capacity(count);
    for (i, m) in mass.iter().enumerate() {
        sum += m / total;
        // A large vertex stands for several steps; rounding must not lose the last one.
        let reached = if i + 1 == mass.len() { count } else { ((sum / step + 0.5) as usize).min(count) };
        if reached > taken {
            found.push((i, (reached - taken) as f64 * step));
            taken = reached;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertices_stand_for_their_area() {
        assert_eq!(by_area(&[1.0, 3.0], 2), [(0, 0.25), (1, 0.75)]);
        // Steps of 1/4 at 1/8, 3/8, 5/8 and 7/8 of the area.
        assert_eq!(by_area(&[1.0, 0.5, 0.5, 4.5, 0.5, 1.0], 4), [(0, 0.25), (3, 0.5), (4, 0.25)]);
        let many = by_area(&[1.0; 1000], 300);
        assert_eq!(many.len(), 300);
        assert!((many.iter().map(|(_, share)| share).sum::<f64>() - 1.0).abs() < 1e-12);
    }
}
