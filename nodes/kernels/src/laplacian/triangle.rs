//! One triangle's cotangents and areas, from points or from edge lengths.

/// Below this ratio of twice the area to the longest edge squared a triangle counts as having no area: it is the rounding error of
/// coordinates, and cotangents would be noise.
const FLAT: f64 = 1e-14;

/// What the Laplacian needs of a triangle; index i is the corner, or the edge opposite it.
pub(crate) struct Triangle {
    pub cotangents: [f64; 3],
    /// Squared edge lengths.
    pub squared: [f64; 3],
    pub area: f64,
}

/// Whether [`crate::laplacian::laplacian`] refuses this triangle as having no area: twice its area is at most 1e-14 of its longest
/// edge squared. Scale does not matter; slivers of aspect 1e6 pass with ease.
#[must_use]
pub fn is_zero_area(points: [[f64; 3]; 3]) -> bool {
    Triangle::from_points(points).is_none()
}

impl Triangle {
    /// The triangle of three points, or nothing if it is flat.
    pub fn from_points(p: [[f64; 3]; 3]) -> Option<Self> {
        // Edge i runs from corner i+1 to corner i+2; the cross product of two edges is better conditioned on slivers than Heron's formula.
        let edge: [[f64; 3]; 3] = std::array::from_fn(|i| {
            let (from, to) = (p[(i + 1) % 3], p[(i + 2) % 3]);
            std::array::from_fn(|x| to[x] - from[x])
        });
        let squared = edge.map(|e| dot(e, e));
        // The two shorter edges: the least cancellation.
        let longest = (0..3).fold(0, |best, i| if squared[i] > squared[best] { i } else { best });
        let normal = cross(edge[(longest + 1) % 3], edge[(longest + 2) % 3]);
        let double_area = dot(normal, normal).sqrt();
        let products = std::array::from_fn(|i| -dot(edge[(i + 1) % 3], edge[(i + 2) % 3]));
        Self::new(products, squared, double_area)
    }

    /// The triangle of three edge lengths, or nothing if it is flat or impossible.
    pub fn from_lengths(lengths: [f64; 3]) -> Option<Self> {
        if lengths.iter().any(|l| !(l.is_finite() && *l > 0.0)) {
            return None;
        }
        let mut sorted = lengths;
        sorted.sort_by(f64::total_cmp);
        let [c, b, a] = sorted;
        // Kahan's form of Heron's formula; the parentheses matter.
        let product = (a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c));
        let double_area = if product > 0.0 { 0.5 * product.sqrt() } else { 0.0 };
        let products = std::array::from_fn(|i| {
            let (a, b, c) = (lengths[i], lengths[(i + 1) % 3], lengths[(i + 2) % 3]);
            // b c cos = (b^2 + c^2 - a^2) / 2, factored so that nearly equal lengths do not cancel.
            let (short, long) = if b < c { (b, c) } else { (c, b) };
            0.5 * (short * short + (long - a) * (long + a))
        });
        Self::new(products, lengths.map(|l| l * l), double_area)
    }

    /// `products[i]`: scalar product of the edges leaving corner i.
    fn new(products: [f64; 3], squared: [f64; 3], double_area: f64) -> Option<Self> {
        let longest = squared.iter().fold(0.0f64, |m, &s| m.max(s));
        let has_area = double_area.is_finite() && longest.is_finite() && double_area > FLAT * longest;
        has_area.then(|| Self { cotangents: products.map(|p| p / double_area), squared, area: 0.5 * double_area })
    }

    /// Meyer's mixed area of each corner; they sum to the triangle's area.
    pub fn mixed_areas(&self) -> [f64; 3] {
        match self.cotangents.iter().position(|c| *c < 0.0) {
            Some(obtuse) => std::array::from_fn(|i| self.area * if i == obtuse { 0.5 } else { 0.25 }),
            None => std::array::from_fn(|i| {
                let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                (self.squared[j] * self.cotangents[j] + self.squared[k] * self.cotangents[k]) / 8.0
            }),
        }
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_and_lengths_agree_on_slivers() {
        // Thin caps and needles of aspect up to 1e6, for which the cotangents are known in closed form.
        for height in [1.0, 1e-3, 1e-6] {
            for foot in [0.5, 0.1, 1.0] {
                let p = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [foot, height, 0.0]];
                let t = Triangle::from_points(p).expect("has area");
                let exact = [foot / height, (1.0 - foot) / height, (height * height - foot * (1.0 - foot)) / height];
                for (a, b) in t.cotangents.iter().zip(exact) {
                    assert!((a - b).abs() <= 1e-13 * (1.0 + b.abs()), "{a} {b}");
                }
                assert!((t.area - height / 2.0).abs() <= 1e-15 * height);
                let sum: f64 = t.mixed_areas().iter().sum();
                assert!((sum - t.area).abs() <= 1e-12 * t.area, "height {height} foot {foot}");
                let l = Triangle::from_lengths(t.squared.map(f64::sqrt)).expect("has area");
                // Lengths alone determine a cap of height h only to eps / h^2.
                let tolerance = 4e-16 / (height * height);
                assert!((l.area - t.area).abs() <= tolerance.max(1e-15) * t.area, "{} {}", l.area, t.area);
            }
        }
    }

    #[test]
    fn flat_triangles_are_refused_at_any_scale() {
        for scale in [1e-6, 1.0, 1e6] {
            let at = |x: f64, y: f64| [x * scale, y * scale, 0.3 * x * scale];
            assert!(is_zero_area([at(0.0, 0.0), at(0.1, 0.1), at(0.3, 0.3)]));
            assert!(is_zero_area([at(0.0, 0.0), at(0.0, 0.0), at(0.3, 0.3)]));
            assert!(!is_zero_area([at(0.0, 0.0), at(1.0, 0.0), at(0.5, 1e-6)]));
        }
        assert!(Triangle::from_lengths([1.0, 1.0, 2.5]).is_none());
        assert!(Triangle::from_lengths([1.0, f64::NAN, 1.0]).is_none());
    }
}
