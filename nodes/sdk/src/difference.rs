//! How two artefacts of one type differ, in the terms of the field.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::mesh::Mesh;

/// One respect in which an artefact differs from another of its type.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Difference {
    /// What was compared: `eigenvalues`, `features`, `objective`.
    pub figure: String,
    /// How large the difference is, at least 0; what it measures is said in `text`.
    pub size: f64,
    /// The figure on both sides, where it is one number.
    pub values: Option<[f64; 2]>,
    /// The difference in words.
    pub text: String,
    /// Particulars for programs: an object with documented keys; null if there are none.
    pub details: Value,
}

impl Difference {
    /// A difference in words, of some size.
    #[must_use]
    pub fn new(figure: &str, size: f64, text: impl Into<String>) -> Self {
        Self { figure: figure.to_owned(), size, values: None, text: text.into(), details: Value::Null }
    }

    /// The change of one number, its size relative to the larger of the two; `None` if it is the same.
    #[must_use]
    pub fn of_number(figure: &str, one: f64, other: f64) -> Option<Self> {
        if one == other {
            return None;
        }
        let size = relative(one, other);
        let text = format!("{} -> {} ({})", short(one), short(other), percent(one, other));
        Some(Self { values: Some([one, other]), ..Self::new(figure, size, text) })
    }

    /// The change of a count, its size the number of more or fewer; `None` if it is the same.
    #[must_use]
    pub fn of_count(figure: &str, one: usize, other: usize) -> Option<Self> {
        let text = format!("{one} -> {other}");
        let values = Some([one as f64, other as f64]);
        (one != other).then(|| Self { values, ..Self::new(figure, one.abs_diff(other) as f64, text) })
    }

    /// The same with particulars.
    #[must_use]
    pub fn details(self, details: Value) -> Self {
        Self { details, ..self }
    }
}

/// |a - b| over the larger of |a| and |b|; 0 for two zeros.
#[must_use]
pub fn relative(a: f64, b: f64) -> f64 {
    let scale = a.abs().max(b.abs());
    if scale > 0.0 { (a - b).abs() / scale } else { 0.0 }
}

/// A number with six significant digits at most.
#[must_use]
pub fn short(x: f64) -> String {
    let magnitude = x.abs();
    if x == 0.0 || (1e-3..1e6).contains(&magnitude) {
        let digits = if x == 0.0 { 0 } else { (5 - magnitude.log10().floor() as i32).clamp(0, 9) as usize };
        let text = format!("{x:.digits$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    } else {
        format!("{x:.5e}")
    }
}

fn percent(one: f64, other: f64) -> String {
    if one == 0.0 || one.signum() != other.signum() {
        return format!("{:+.3e}", other - one);
    }
    let change = 100.0 * (other - one) / one.abs();
    if change.abs() < 0.01 { format!("{change:+.1e} %") } else { format!("{change:+.2} %") }
}

/// Differences between two summaries, line by line: what can be said of any type.
#[must_use]
pub fn of_summaries(one: &[(&'static str, String)], other: &[(&'static str, String)]) -> Vec<Difference> {
    let value = |of: &[(&'static str, String)], label: &str| {
        of.iter().find(|(name, _)| *name == label).map(|(_, value)| value.clone())
    };
    let mut labels: Vec<&str> = one.iter().chain(other).map(|(label, _)| *label).collect();
    let mut seen = std::collections::BTreeSet::new();
    labels.retain(|label| seen.insert(*label));
    let line = |label: &&str| {
        let (a, b) = (value(one, label), value(other, label));
        let say = |x: &Option<String>| x.clone().unwrap_or_else(|| "nothing".into());
        (a != b).then(|| Difference::new(label, 1.0, format!("{} -> {}", say(&a), say(&b))))
    };
    labels.iter().filter_map(line).collect()
}

/// The surfaces that two compared artefacts rest on, by the port through which they do: so that positions can be
/// given, and vertices of two meshes told to be the same point.
#[derive(Default)]
pub struct Surfaces(BTreeMap<String, Common>);

impl Surfaces {
    /// Adds the surfaces at a port, of one and of the other.
    pub fn push(&mut self, port: &str, one: Arc<Mesh>, other: Arc<Mesh>) {
        self.0.insert(port.to_owned(), Common::new(one, other));
    }

    /// The surfaces at a port; if there is no such port, the only ones there are.
    #[must_use]
    pub fn at(&self, port: &str) -> Option<&Common> {
        match self.0.get(port) {
            None if self.0.len() == 1 => self.0.values().next(),
            found => found,
        }
    }
}

/// Share of the square root of the area within which vertices of two meshes are taken for the same point.
pub const SAME_POINT: f64 = 0.02;

/// Two meshes of what may be one shape.
pub struct Common {
    meshes: [Arc<Mesh>; 2],
    /// Whether vertex indices mean the same on both.
    same: bool,
    /// Whether both know where their vertices are in a common reference pose.
    reference: bool,
    /// A length; see [`SAME_POINT`].
    tolerance: f64,
}

impl Common {
    fn new(one: Arc<Mesh>, other: Arc<Mesh>) -> Self {
        let same =
            Arc::ptr_eq(&one, &other) || (one.faces == other.faces && one.vertices.len() == other.vertices.len());
        let reference = one.reference.is_some() && other.reference.is_some();
        let tolerance = SAME_POINT * one.area().min(other.area()).sqrt();
        Self { meshes: [one, other], same, reference, tolerance }
    }

    /// Whether the two have the same faces over as many vertices, so that indices can be compared.
    #[must_use]
    pub fn same_vertices(&self) -> bool {
        self.same
    }

    /// Where a vertex of the first (0) or second (1) mesh is, in the units of its file.
    #[must_use]
    pub fn position(&self, side: usize, vertex: u32) -> Option<[f64; 3]> {
        self.meshes[side].vertices.get(vertex as usize).copied()
    }

    /// How far a vertex of the first and one of the second are apart in units of the tolerance: at most 1 for the same
    /// point. Equal indices are the same point of meshes with the same faces; else positions decide, those in the
    /// reference pose if both meshes have it.
    #[must_use]
    pub fn apart(&self, one: u32, other: u32) -> f64 {
        if self.same {
            return if one == other { 0.0 } else { f64::INFINITY };
        }
        let place = |side: usize, vertex: u32| {
            let mesh = &self.meshes[side];
            let points = mesh.reference.as_ref().filter(|_| self.reference).unwrap_or(&mesh.vertices);
            points.get(vertex as usize).copied()
        };
        match place(0, one).zip(place(1, other)) {
            Some((p, q)) => {
                let square: f64 = p.iter().zip(q).map(|(a, b)| (a - b).powi(2)).sum();
                square.sqrt() / self.tolerance.max(f64::MIN_POSITIVE)
            }
            None => f64::INFINITY,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_their_change_relative() {
        assert_eq!(short(1_741.249_269), "1741.25");
        assert_eq!(short(0.0), "0");
        assert_eq!(short(12.5), "12.5");
        assert_eq!(short(-0.002), "-0.002");
        assert_eq!(short(1.0 / 3.0 * 1e-6), "3.33333e-7");
        let change = Difference::of_number("objective", 200.0, 190.0).unwrap();
        assert_eq!((change.size, change.text.as_str()), (0.05, "200 -> 190 (-5.00 %)"));
        assert_eq!(Difference::of_number("objective", 2.0, 2.0), None);
        assert_eq!(relative(0.0, 0.0), 0.0);
        assert_eq!(relative(0.0, -3.0), 1.0);
    }

    #[test]
    fn points_are_told_by_index_position_or_reference() {
        let square = |shift: f64| Mesh {
            vertices: vec![[shift, 0.0, 0.0], [1.0 + shift, 0.0, 0.0], [1.0 + shift, 1.0, 0.0], [shift, 1.0, 0.0]],
            faces: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        };
        let mut surfaces = Surfaces::default();
        surfaces.push("mesh", Arc::new(square(0.0)), Arc::new(square(9.0)));
        let moved = surfaces.at("patches").unwrap();
        assert!(moved.same_vertices() && moved.apart(2, 2) == 0.0 && moved.apart(2, 3) > 1.0);
        // Renumbered by one.
        let mut other = square(0.0);
        other.vertices.rotate_left(1);
        other.faces = vec![[3, 0, 1], [3, 1, 2]];
        let common = Common::new(Arc::new(square(0.0)), Arc::new(other.clone()));
        assert!(common.apart(1, 0) == 0.0 && common.apart(1, 1) > 1.0);
        // Posed elsewhere, but with the truth known.
        let with = |mesh: Mesh, by: f64| {
            let reference = Some(mesh.vertices.clone());
            let vertices = mesh.vertices.iter().map(|p| [p[0] + by, p[1], p[2]]).collect();
            Arc::new(Mesh { vertices, reference, ..mesh })
        };
        let common = Common::new(with(square(0.0), 0.0), with(other, 50.0));
        assert_eq!(common.apart(1, 0), 0.0);
        assert_eq!(common.position(1, 0), Some([51.0, 0.0, 0.0]));
        assert_eq!(common.position(1, 9), None);
    }
}
