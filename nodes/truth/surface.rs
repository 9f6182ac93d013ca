//! The nearest point on a set of triangles.

use salient_kernels::nearest::NearestVertex;

use super::Place;

/// Triangles, with a ball about each.
pub(super) struct Surface {
    points: Vec<[f64; 3]>,
    faces: Vec<[u32; 3]>,
    /// Centroid of each face and the distance to its farthest corner.
    balls: Vec<([f64; 3], f64)>,
    nearest: NearestVertex,
}

impl Surface {
    pub fn new(points: Vec<[f64; 3]>, faces: &[[u32; 3]]) -> Self {
        let ball = |f: &[u32; 3]| {
            let corners = f.map(|v| points[v as usize]);
            let centre: [f64; 3] = std::array::from_fn(|i| (corners[0][i] + corners[1][i] + corners[2][i]) / 3.0);
            let radius = corners.iter().map(|c| length(sub(*c, centre))).fold(0.0, f64::max);
            (centre, radius)
        };
        let balls = faces.iter().map(ball).collect();
        let nearest = NearestVertex::new(&points);
        Self { faces: faces.to_vec(), balls, nearest, points }
    }

    /// The nearest point and its distance; a vertex if no face is nearer.
    pub fn nearest(&self, query: [f64; 3]) -> Option<(Place, f64)> {
        let (vertex, mut best) = self.nearest.nearest(query)?;
        let mut place = Place::vertex(vertex);
        for (face, (centre, radius)) in self.faces.iter().zip(&self.balls) {
            // No point of the face is nearer than its ball.
            if length(sub(query, *centre)) - radius >= best {
                continue;
            }
            let corners = face.map(|v| self.points[v as usize]);
            let weights = nearest_in_triangle(query, corners);
            let point: [f64; 3] = std::array::from_fn(|i| (0..3).map(|c| weights[c] * corners[c][i]).sum());
            let distance = length(sub(query, point));
            if distance < best {
                (best, place) = (distance, Place { corners: *face, weights });
            }
        }
        Some((place, best))
    }
}

/// Barycentric weights of the point of a triangle nearest to `p`: the foot of the perpendicular, if it lies inside, or the
/// nearest of the nearest points on the three sides.
fn nearest_in_triangle(p: [f64; 3], [a, b, c]: [[f64; 3]; 3]) -> [f64; 3] {
    let (u, v, w) = (sub(b, a), sub(c, a), sub(p, a));
    let (uu, uv, vv, wu, wv) = (dot(u, u), dot(u, v), dot(v, v), dot(w, u), dot(w, v));
    let det = uu * vv - uv * uv;
    if det > 0.0 {
        let (s, t) = ((vv * wu - uv * wv) / det, (uu * wv - uv * wu) / det);
        if s >= 0.0 && t >= 0.0 && s + t <= 1.0 {
            return [1.0 - s - t, s, t];
        }
    }
    let side = |from: usize, to: usize| {
        let corners = [a, b, c];
        let along = sub(corners[to], corners[from]);
        let square = dot(along, along);
        let t = if square > 0.0 { (dot(sub(p, corners[from]), along) / square).clamp(0.0, 1.0) } else { 0.0 };
        let mut weights = [0.0; 3];
        (weights[from], weights[to]) = (1.0 - t, t);
        let foot: [f64; 3] = std::array::from_fn(|i| corners[from][i] + t * along[i]);
        (weights, length(sub(p, foot)))
    };
    let sides = [side(0, 1), side(1, 2), side(2, 0)];
    let nearer = |best: usize, i: usize| if sides[i].1 < sides[best].1 { i } else { best };
    sides[(1..3).fold(0, nearer)].0
}

fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn length(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use salient_kernels::random::Random;

    #[test]
    fn the_nearest_point_is_no_farther_than_any_sampled_one() {
        let mut random = Random::from_state(5);
        let mut number = || random.signed();
        for _ in 0..200 {
            let mut point = || [number(), number(), number()];
            let (corners, query) = ([point(), point(), point()], point());
            let surface = Surface::new(corners.to_vec(), &[[0, 1, 2]]);
            let (place, found) = surface.nearest(query).unwrap();
            assert!((place.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            assert!(place.weights.iter().all(|w| *w >= 0.0));
            let mut least = f64::INFINITY;
            for i in 0..=60 {
                for j in 0..=60 - i {
                    let (s, t) = (f64::from(i) / 60.0, f64::from(j) / 60.0);
                    let at: [f64; 3] =
                        std::array::from_fn(|k| (1.0 - s - t) * corners[0][k] + s * corners[1][k] + t * corners[2][k]);
                    least = least.min(length(sub(query, at)));
                }
            }
            assert!(found <= least + 1e-12 && least - found < 0.05, "{found} {least}");
        }
    }

    #[test]
    fn interpolation_is_linear_and_infinite_where_a_corner_with_weight_is() {
        let place = Place { corners: [0, 1, 2], weights: [0.5, 0.5, 0.0] };
        assert_eq!(place.value(&[1.0, 3.0, f64::INFINITY]), 2.0);
        assert_eq!(place.value(&[f64::INFINITY, 3.0, 0.0]), f64::INFINITY);
        assert_eq!(Place::vertex(1).value(&[0.0, 7.0]), 7.0);
    }
}
