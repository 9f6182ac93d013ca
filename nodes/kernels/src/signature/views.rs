//! Depth images of a surface along its principal axes, by their low frequencies (after Vranic 2004 and Papadakis et al. 2008).
//!
//! The surface is moved to its centre and turned to the principal axes of its area or of its normals. Along each axis it is seen from both sides,
//! in a box of fixed size over its mean distance from the axis. Magnitudes of frequencies do not change when an image moves;
//! those of (u, v) and (u, -v) are added, and the two sides are taken together by sum and difference, so that the senses of
//! the axes, which nothing fixes, do not matter.

use std::f64::consts::TAU;

use crate::vec3::{add, cross, dot, norm, normal, scale, sub};

/// What the axes are the principal ones of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// Where the area is.
    Area,
    /// Where it faces.
    Normals,
}

/// Pixels of an image, each way.
pub(super) const SIDE: usize = 64;
/// Frequencies of an image, each way, from 0.
pub const FREQUENCIES: usize = 10;
/// Half the box over the mean distance of the surface from its centre.
const REACH: f64 = 2.4;
/// Points on the surface: some for each pixel.
const POINTS: usize = 60_000;

/// For each axis, the largest first: frequencies of the two depth images, their sum and then their difference, then of the outline.
#[must_use]
pub fn views(vertices: &[[f64; 3]], faces: &[[u32; 3]], align: Align) -> Vec<f64> {
    let points = super::samples(vertices, faces, POINTS);
    let pose = Pose::new(&points, vertices, faces, align);
    let turned: Vec<[f64; 3]> = points.iter().map(|(p, _)| pose.place(*p)).collect();
    let mut all = Vec::with_capacity(9 * FREQUENCIES * FREQUENCIES);
    for k in 0..3 {
        let [front, back, outline] = images(&turned, k);
        let (front, back) = (frequencies(&front), frequencies(&back));
        all.extend(front.iter().zip(&back).map(|(f, b)| f + b));
        all.extend(front.iter().zip(&back).map(|(f, b)| (f - b).abs()));
        all.extend(frequencies(&outline));
    }
    all
}

/// How a surface is moved, turned and scaled before it is looked at.
pub(super) struct Pose {
    middle: [f64; 3],
    axes: [[f64; 3]; 3],
    size: f64,
}

impl Pose {
    pub(super) fn new(points: &[([f64; 3], f64)], vertices: &[[f64; 3]], faces: &[[u32; 3]], align: Align) -> Self {
        let middle = super::centre(points);
        let axes = match align {
            Align::Area => axes(points.iter().map(|(p, w)| (sub(*p, middle), *w))),
            Align::Normals => axes(faces.iter().map(|f| {
                let [a, b, c] = f.map(|v| vertices[v as usize]);
                let n = normal(a, b, c);
                let length = norm(n);
                (scale(n, 1.0 / length.max(f64::MIN_POSITIVE)), length)
            })),
        };
        let mean: f64 = points.iter().map(|(p, w)| w * norm(sub(*p, middle))).sum();
        Self { middle, axes, size: (REACH * mean).max(f64::MIN_POSITIVE) }
    }

    /// A point in the box from -1 to 1, where not too far out.
    pub(super) fn place(&self, p: [f64; 3]) -> [f64; 3] {
        self.turn(scale(sub(p, self.middle), 1.0 / self.size))
    }

    /// A direction.
    pub(super) fn turn(&self, d: [f64; 3]) -> [f64; 3] {
        self.axes.map(|axis| dot(d, axis))
    }
}

/// Depth from the front, from the back (0 outside of the shape, to 1), and the outline, along axis `k`.
fn images(points: &[[f64; 3]], k: usize) -> [Vec<f64>; 3] {
    let mut images = [(); 3].map(|()| vec![0.0_f64; SIDE * SIDE]);
    let pixel = |x: f64| ((0.5 * (x + 1.0) * SIDE as f64).clamp(0.0, (SIDE - 1) as f64)) as usize;
    for p in points {
        let at = pixel(p[(k + 1) % 3]) * SIDE + pixel(p[(k + 2) % 3]);
        let depth = p[k].clamp(-1.0, 1.0);
        images[0][at] = images[0][at].max(0.5 * (1.0 + depth));
        images[1][at] = images[1][at].max(0.5 * (1.0 - depth));
        images[2][at] = 1.0;
    }
    images
}

/// Magnitudes of the lowest frequencies over the number of pixels, those of (u, v) and (u, -v) added.
pub(super) fn frequencies(image: &[f64]) -> Vec<f64> {
    let wave: Vec<(f64, f64)> = (0..SIDE).map(|i| (TAU * i as f64 / SIDE as f64).sin_cos()).collect();
    // Rows first: (row, v) as real and imaginary parts.
    let mut rows = vec![[0.0, 0.0]; SIDE * FREQUENCIES];
    for (row, line) in image.chunks(SIDE).enumerate() {
        for v in 0..FREQUENCIES {
            let mut sum = [0.0, 0.0];
            for (i, x) in line.iter().enumerate() {
                let (s, c) = wave[i * v % SIDE];
                sum = [sum[0] + c * x, sum[1] - s * x];
            }
            rows[row * FREQUENCIES + v] = sum;
        }
    }
    let mut found = Vec::with_capacity(FREQUENCIES * FREQUENCIES);
    for u in 0..FREQUENCIES {
        for v in 0..FREQUENCIES {
            let magnitude = |sign: f64| {
                let mut sum = [0.0, 0.0];
                for row in 0..SIDE {
                    let (s, c) = wave[row * u % SIDE];
                    let [re, im] = rows[row * FREQUENCIES + v];
                    sum = [sum[0] + c * re + sign * s * im, sum[1] + c * im - sign * s * re];
                }
                sum[0].hypot(sum[1]) / (SIDE * SIDE) as f64
            };
            found.push(magnitude(1.0) + magnitude(-1.0));
        }
    }
    found
}

/// Principal axes of weighted vectors, that of the largest moment first: unit vectors, of no particular sense.
fn axes(of: impl Iterator<Item = ([f64; 3], f64)>) -> [[f64; 3]; 3] {
    let mut m = [[0.0; 3]; 3];
    for (p, w) in of {
        for i in 0..3 {
            m[i] = add(m[i], scale(p, w * p[i]));
        }
    }
    let mut turn = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    // Cyclic Jacobi rotations; 3 x 3 matrices converge in a handful of sweeps.
    for _ in 0..30 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if m[p][q] == 0.0 {
                continue;
            }
            let angle = 0.5 * (2.0 * m[p][q]).atan2(m[q][q] - m[p][p]);
            let (s, c) = angle.sin_cos();
            for row in &mut m {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            for other in [&mut m, &mut turn] {
                let (a, b) = (other[p], other[q]);
                other[p] = sub(scale(a, c), scale(b, s));
                other[q] = add(scale(a, s), scale(b, c));
            }
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| m[*b][*b].total_cmp(&m[*a][*a]).then(a.cmp(b)));
    let first = turn[order[0]];
    let second = turn[order[1]];
    [first, second, cross(first, second)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_of_a_turned_box_are_its_edges() {
        let (s, c) = 0.3_f64.sin_cos();
        let edges = [[c, s, 0.0], [-s * c, c * c, s], [s * s, -c * s, c]];
        let mut points = Vec::new();
        for signs in 0..8 {
            let sign = |k: usize| if signs >> k & 1 == 0 { 1.0 } else { -1.0 };
            let along = |k: usize, length: f64| scale(edges[k], sign(k) * length);
            points.push((add(add(along(0, 1.0), along(1, 3.0)), along(2, 2.0)), 1.0));
        }
        let found = axes(points.into_iter());
        for (axis, edge) in found.iter().zip([1, 2, 0]) {
            assert!((dot(*axis, edges[edge]).abs() - 1.0).abs() < 1e-12, "{axis:?}");
        }
    }

    #[test]
    fn frequencies_do_not_see_shifts_and_flips() {
        let mut image = vec![0.0; SIDE * SIDE];
        let mut flipped = image.clone();
        for (x, y, value) in [(20, 30, 1.0), (21, 33, 0.5), (29, 30, 0.7)] {
            image[x * SIDE + y] = value;
            flipped[(x + 5) * SIDE + SIDE - y] = value;
        }
        for (a, b) in frequencies(&image).iter().zip(frequencies(&flipped)) {
            assert!((a - b).abs() < 1e-12);
        }
        // The lowest one is the sum of all pixels, twice.
        assert!((frequencies(&image)[0] - 2.0 * 2.2 / (SIDE * SIDE) as f64).abs() < 1e-15);
    }
}
