//! Panoramic views of a surface: what is seen from its axes, looking around (after Papadakis, Pratikakis, Theoharis & Perantonis 2010).
//!
//! The surface is moved to its centre and turned to the principal axes of its area or of its normals. About each axis it is projected to a cylinder:
//! for each height and angle, how far out the outermost point is, how squarely the surface faces outward there, and how far out the innermost
//! point is. A turn about the axis shifts these images, and a flip mirrors them; magnitudes of frequencies see neither of both.

use std::f64::consts::TAU;

use super::views::{Align, FREQUENCIES, Pose, SIDE, frequencies};
use crate::vec3::{norm, normal, scale};

/// Points on the surface: some for each pixel.
const POINTS: usize = 60_000;

/// For each axis, the largest first: frequencies of the outermost distance, of its facing, and of the innermost distance.
#[must_use]
pub fn panorama(vertices: &[[f64; 3]], faces: &[[u32; 3]], align: Align) -> Vec<f64> {
    let (mut points, mut of) = (Vec::new(), Vec::new());
    super::spread(vertices, faces, POINTS, |face, p, weight| {
        points.push((p, weight));
        of.push(face);
    });
    let pose = Pose::new(&points, vertices, faces, align);
    let normals: Vec<[f64; 3]> = faces
        .iter()
        .map(|f| {
            let [a, b, c] = f.map(|v| vertices[v as usize]);
            let n = normal(a, b, c);
            pose.turn(scale(n, 1.0 / norm(n).max(f64::MIN_POSITIVE)))
        })
        .collect();
    let turned: Vec<([f64; 3], [f64; 3])> =
        points.iter().zip(&of).map(|((p, _), face)| (pose.place(*p), normals[*face])).collect();
    let mut all = Vec::with_capacity(9 * FREQUENCIES * FREQUENCIES);
    for k in 0..3 {
        for image in images(&turned, k) {
            all.extend(frequencies(&image));
        }
    }
    all
}

/// Images by height and angle about axis `k` of points with their normals; 0 where there is no surface.
fn images(points: &[([f64; 3], [f64; 3])], k: usize) -> [Vec<f64>; 3] {
    let mut outer = vec![0.0_f64; SIDE * SIDE];
    let mut facing = outer.clone();
    let mut inner = outer.clone();
    for (p, n) in points {
        let (x, y) = (p[(k + 1) % 3], p[(k + 2) % 3]);
        let r = x.hypot(y);
        let height = (0.5 * (p[k] + 1.0) * SIDE as f64).clamp(0.0, (SIDE - 1) as f64) as usize;
        let angle = ((y.atan2(x) / TAU + 0.5) * SIDE as f64) as usize % SIDE;
        let at = height * SIDE + angle;
        if r >= outer[at] {
            outer[at] = r;
            facing[at] = (n[(k + 1) % 3] * x + n[(k + 2) % 3] * y).abs() / r.max(1e-9);
        }
        if inner[at] == 0.0 || r < inner[at] {
            inner[at] = r;
        }
    }
    [outer, facing, inner]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tube about axis 0: radius, half its length.
    fn tube(radius: f64, half: f64) -> Vec<([f64; 3], [f64; 3])> {
        let point = |i: usize| {
            let (angle, height) = ((i % 640) as f64 / 640.0 * TAU + 0.001, (i / 640) as f64 / 200.0 * 2.0 - 1.0);
            let (s, c) = angle.sin_cos();
            ([half * height, radius * c, radius * s], [0.0, c, s])
        };
        (0..640 * 200).map(point).collect()
    }

    #[test]
    fn a_tube_is_a_band_of_its_radius() {
        let [outer, facing, inner] = images(&tube(0.3, 0.5), 0);
        // From -0.5 to 0.5 are half of the rows.
        for row in 0..SIDE {
            for at in row * SIDE..(row + 1) * SIDE {
                let expected = if (16..48).contains(&row) { [0.3, 1.0, 0.3] } else { [0.0; 3] };
                for (x, e) in [outer[at], facing[at], inner[at]].into_iter().zip(expected) {
                    assert!((x - e).abs() < 1e-12, "{row}: {x}, not {e}");
                }
            }
        }
        // In another about the same axis, only the distances differ.
        let both: Vec<_> = tube(0.3, 0.5).into_iter().chain(tube(0.7, 0.5)).collect();
        let [outer, _, inner] = images(&both, 0);
        assert!((outer[20 * SIDE] - 0.7).abs() < 1e-12 && (inner[20 * SIDE] - 0.3).abs() < 1e-12);
    }

    #[test]
    fn turns_and_sizes_do_not_matter() {
        // A box with a smaller one at a corner has three different moments.
        let (mut vertices, mut faces) = (Vec::new(), Vec::new());
        for (low, high) in [([0.0; 3], [3.0, 2.0, 1.0]), ([2.0, 1.0, 1.0], [2.8, 1.7, 1.9])] {
            let first = vertices.len() as u32;
            vertices
                .extend((0..8).map(|i: usize| std::array::from_fn(|k| if i >> k & 1 == 0 { low[k] } else { high[k] })));
            for [a, b, c, d] in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
                faces.extend([[a, b, c], [a, c, d]].map(|f: [u32; 3]| f.map(|v| v + first)));
            }
        }
        let before = panorama(&vertices, &faces, Align::Area);
        let (s, c) = 0.7_f64.sin_cos();
        // A turn about two axes and a factor.
        let turn = |[x, y, z]: [f64; 3]| {
            let [x, y] = [c * x - s * y, s * x + c * y];
            [5.0 * (c * x + s * z), 5.0 * y, 5.0 * (c * z - s * x)]
        };
        let turned: Vec<[f64; 3]> = vertices.iter().map(|p| turn(*p)).collect();
        let after = panorama(&turned, &faces, Align::Area);
        let (size, change) = before
            .iter()
            .zip(&after)
            .fold((0.0, 0.0), |(size, change), (a, b)| (size + a.abs(), change + (a - b).abs()));
        assert!(change < 0.02 * size, "{change} of {size}");
    }
}
