//! Windows: the part of an edge that straight lines from one (pseudo-)source reach through one sequence of triangles.

/// Distances on an interval of an edge, from a source unfolded into the plane of the edge.
///
/// Positions along the edge run from 0 at its lower end. The distance at `t` is `offset + |(t, 0) - (x, y)|`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cone {
    /// The interval.
    pub(super) start: f64,
    pub(super) end: f64,
    /// The unfolded source; `y` is its height over the edge.
    pub(super) x: f64,
    pub(super) y: f64,
    /// Distance of the unfolded source from the true one.
    pub(super) offset: f64,
}

impl Cone {
    pub(super) fn at(&self, t: f64) -> f64 {
        let dx = t - self.x;
        self.offset + (dx * dx + self.y * self.y).sqrt()
    }

    /// The least distance on the interval.
    pub(super) fn least(&self) -> f64 {
        self.at(self.x.clamp(self.start, self.end))
    }

    /// The same seen from the other end of an edge of this length.
    pub(super) fn mirrored(self, length: f64) -> Self {
        Self { start: length - self.end, end: length - self.start, x: length - self.x, ..self }
    }

    /// The lines through this interval of a base edge of `length`, followed to the edge that leaves the base's first end
    /// for `apex`; as an interval of that edge from that end. Nothing if they all pass on the other side of the apex.
    pub(super) fn turned(&self, apex: [f64; 2], length: f64) -> Option<Self> {
        // Where the line from the source to the apex crosses the base.
        let split = self.x + (apex[0] - self.x) * self.y / (self.y + apex[1]);
        if !(self.start < split && length > 0.0) {
            return None;
        }
        let unit = apex.map(|c| c / length);
        let hit = |b: f64| {
            let denominator = unit[0] * self.y + unit[1] * (self.x - b);
            if b <= 0.0 {
                0.0
            } else if denominator > 0.0 {
                (self.y * b / denominator).min(length)
            } else {
                length
            }
        };
        Some(Self {
            start: hit(self.start),
            end: if self.end >= split { length } else { hit(self.end) },
            x: self.x * unit[0] - self.y * unit[1],
            y: (unit[0] * self.y + unit[1] * self.x).abs(),
            offset: self.offset,
        })
    }
}

/// Who is nearer on which part of an interval: up to three parts in order, as (end, whether the newcomer is nearer).
pub(super) struct Verdict {
    pub(super) parts: [(f64, bool); 3],
    pub(super) count: usize,
}

impl Verdict {
    fn all(end: f64, newcomer: bool) -> Self {
        Self { parts: [(end, newcomer); 3], count: 1 }
    }
}

/// A newcomer must be nearer by this share of the distance: what is equal but for rounding stays as it is.
const TIE: f64 = 1e-14;

/// Compares two windows on `[a, b]`. Where they are equally far the old one stays.
///
/// The points nearer to one source than to another, by a fixed difference, are bounded by a branch of a hyperbola; they are
/// convex if the source's own offset is the larger. An edge crosses the branch at most twice.
pub(super) fn contest(new: &Cone, old: &Cone, a: f64, b: f64) -> Verdict {
    let lead = |t: f64| {
        let (n, o) = (new.at(t), old.at(t));
        n - o + TIE * o
    };
    let (fa, fb) = (lead(a), lead(b));
    let (new_at_a, new_at_b) = (fa < 0.0, fb < 0.0);
    if new_at_a == new_at_b {
        let convex = if new_at_a { new.offset >= old.offset } else { old.offset >= new.offset };
        // The difference changes by at most twice the way.
        if convex || fa.abs() + fb.abs() >= 2.0 * (b - a) {
            return Verdict::all(b, new_at_a);
        }
        return match roots(new, old, a) {
            Some([r, s]) if a < r && r < s && s < b && (lead(f64::midpoint(r, s)) < 0.0) != new_at_a => {
                Verdict { parts: [(r, new_at_a), (s, !new_at_a), (b, new_at_a)], count: 3 }
            }
            _ => Verdict::all(b, new_at_a),
        };
    }
    let cut = crossing(new, old, (a, fa), (b, fb));
    Verdict { parts: [(cut, new_at_a), (b, new_at_b), (b, new_at_b)], count: 2 }
}

/// The two positions at which the distances may be equal, ascending, counted from `base` for accuracy.
fn roots(new: &Cone, old: &Cone, base: f64) -> Option<[f64; 2]> {
    let (xn, xo) = (new.x - base, old.x - base);
    // |t - new| = c + |t - old|, squared twice.
    let c = old.offset - new.offset;
    let p = 2.0 * (xo - xn);
    let m = (xn - xo) * (xn + xo) + (new.y - old.y) * (new.y + old.y) - c * c;
    let quadratic = p * p - 4.0 * c * c;
    let half = p * m + 4.0 * c * c * xo;
    let constant = m * m - 4.0 * c * c * (xo * xo + old.y * old.y);
    let discriminant = half * half - quadratic * constant;
    if discriminant.is_nan() || discriminant < 0.0 {
        return None;
    }
    let q = -(half + half.signum() * discriminant.sqrt());
    let (r, s) = (q / quadratic, constant / q);
    let (r, s) = if r.is_finite() { (r, s) } else { (s, s) };
    s.is_finite().then(|| [base + r.min(s), base + r.max(s)])
}

/// The position between `a` and `b` where the sign of the difference changes.
fn crossing(new: &Cone, old: &Cone, (mut a, fa): (f64, f64), (mut b, _): (f64, f64)) -> f64 {
    let mut t = f64::midpoint(a, b);
    if let Some(found) = roots(new, old, a) {
        let inside = |r: &f64| a < *r && *r < b;
        t = found.into_iter().find(inside).unwrap_or(t);
    }
    // The closed form may have picked up rounding, or the other branch: Newton's method, kept between the signs.
    for _ in 0..60 {
        let (dn, d_o) = (t - new.x, t - old.x);
        let (hn, ho) = ((dn * dn + new.y * new.y).sqrt(), (d_o * d_o + old.y * old.y).sqrt());
        let f = new.offset + hn - (old.offset + ho);
        if (f < 0.0) == (fa < 0.0) {
            a = t;
        } else {
            b = t;
        }
        let step = f / (dn / hn - d_o / ho);
        let small = 4.0 * f64::EPSILON * (hn + ho);
        if f.abs() <= small || b - a <= small {
            break;
        }
        let next = t - step;
        t = if a < next && next < b { next } else { f64::midpoint(a, b) };
    }
    t
}
