//! The artefact: matched pairs, the certificate, and the mirror twin.

use std::collections::BTreeMap;

use salient_sdk::{Artefact, Decoder, Encoder, FormatError, Mesh, NodeError, Table};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// One matched pair of features.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pair {
    /// Index of the left feature.
    pub left: usize,
    /// Index of the right feature.
    pub right: usize,
    /// Its vertex on the left mesh.
    pub left_vertex: u32,
    /// Its vertex on the right mesh.
    pub right_vertex: u32,
    /// Distance of the two descriptors, without unit.
    pub descriptor_distance: f64,
}

/// The best match that sends most features elsewhere: on a symmetric shape, its mirror image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Twin {
    /// Matched pairs, by left feature.
    pub pairs: Vec<Pair>,
    /// Value of the same objective; a local maximum, not proved to be the greatest.
    pub objective: f64,
    /// Share of the features matched in both whose partners lie apart, 0 to 1: the rest is on or near the
    /// plane of symmetry.
    pub moved: f64,
}

/// A correspondence of features with its certificate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Match {
    /// Matched pairs, by left feature.
    pub pairs: Vec<Pair>,
    /// Value of the objective.
    pub objective: f64,
    /// No assignment has a greater one; proved, for the candidates and the stretch that were used.
    pub bound: f64,
    /// `bound - objective`.
    pub gap: f64,
    /// Whether the match is proved to be optimal.
    pub proved: bool,
    /// What ended the search: `proved`, `nodes` or `seconds`; `exchanged` once `orient_match` has put the twin in its place.
    pub stopped: String,
    /// Objective of the heuristic alone, before branching.
    pub heuristic: f64,
    /// Numbers of left and right features.
    pub features: [usize; 2],
    /// Number of candidate pairs.
    pub candidates: usize,
    /// Sigmas used: of descriptors, geodesic distances and logarithmic scale ratios.
    pub sigmas: [f64; 3],
    /// Factor by which left lengths were enlarged, after division by the unit: 1 unless searched.
    pub stretch: f64,
    /// The best match that sends most features elsewhere; null if none scores half as much as the match. After
    /// `orient_match`, the best such one of the other orientation, if there is one.
    pub twin: Option<Twin>,
    /// Further ones, each apart from all before, best first; at most two.
    pub others: Vec<Twin>,
    /// What `orient_match` found; null before.
    pub orientation: Option<Orientation>,
}

/// How well two correspondences keep the orientation of the surface, from -1 (all is mirrored) to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Orientation {
    /// Of the match, as it now is.
    pub own: f64,
    /// Of its twin, as it now is; null if there is none.
    pub twin: Option<f64>,
    /// Whether the two were exchanged. `bound` stays true, but nothing is proved of the match any more.
    pub exchanged: bool,
}

impl Match {
    /// The twin's objective over the match's: near 1 where left and right cannot be told apart.
    #[must_use]
    pub fn twin_ratio(&self) -> Option<f64> {
        self.twin.as_ref().filter(|_| self.objective != 0.0).map(|t| t.objective / self.objective)
    }

    /// Refuses meshes that lack a vertex of the match or its twin.
    pub fn check_vertices(&self, left: &Mesh, right: &Mesh) -> Result<(), NodeError> {
        for p in self.pairs.iter().chain(self.twin.iter().chain(&self.others).flat_map(|t| &t.pairs)) {
            for (side, vertex, mesh) in [("left", p.left_vertex, left), ("right", p.right_vertex, right)] {
                let n = mesh.vertices.len();
                if vertex as usize >= n {
                    let message = format!("a match names {side} vertex {vertex}, but that mesh has {n}");
                    let help = format!("wire `{side}` to the mesh whose features were matched");
                    return Err(NodeError::new(message).help(help));
                }
            }
        }
        Ok(())
    }
}

impl Artefact for Match {
    const TYPE: &'static str = "match";
    const FORMAT: u32 = 2;
    const DOC: &'static str = "A one-to-one correspondence of features, `pairs` [p, 2] (left and right feature) and `vertices` [p, 2], \
        with the value of the objective, a proved upper bound and their gap; its mirror twin as `twin_pairs` and `twin_vertices` [q, 2].";

    fn encode(&self, out: &mut Encoder) {
        let mut arrays = |features: &str, vertices: &str, pairs: &[Pair]| {
            let two = [pairs.len(), 2];
            let f: Vec<u32> = pairs.iter().flat_map(|p| [p.left as u32, p.right as u32]).collect();
            let v: Vec<u32> = pairs.iter().flat_map(|p| [p.left_vertex, p.right_vertex]).collect();
            out.u32(features, &f, &two);
            out.u32(vertices, &v, &two);
        };
        arrays("pairs", "vertices", &self.pairs);
        if let Some(twin) = &self.twin {
            arrays("twin_pairs", "twin_vertices", &twin.pairs);
        }
        out.header("match", self);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        from.header("match")
    }

    fn json(&self) -> Value {
        json!(self)
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        let [left, right] = self.features;
        let proof = if self.proved {
            "proved optimal".to_owned()
        } else {
            let why = if self.stopped == "exchanged" {
                "exchanged with the twin"
            } else {
                &format!("stopped by {}", self.stopped)
            };
            format!("gap {:.2} % ({why})", 100.0 * self.gap / self.objective.abs())
        };
        let mut lines = vec![
            ("matches", format!("{} of {left} and {right} features", self.pairs.len())),
            ("objective", format!("{:.6}", self.objective)),
            ("bound", format!("{:.6}, {proof}", self.bound)),
        ];
        if self.stretch != 1.0 {
            lines.push(("stretch", format!("left lengths times {:.3}", self.stretch)));
        }
        lines.push(("mirror twin", self.twin_line()));
        if let Some(o) = &self.orientation {
            let twin = o.twin.map_or(String::new(), |t| format!(", its twin {t:.2}"));
            let exchanged = if o.exchanged { "; exchanged with the twin" } else { "" };
            lines.push(("orientation", format!("{:.2}{twin} (1: kept, -1: mirrored){exchanged}", o.own)));
        }
        lines
    }

    fn table(&self) -> Option<Table> {
        let columns =
            ["left", "left_vertex", "right", "right_vertex", "descriptor_distance", "twin_right", "twin_right_vertex"];
        let mut rows: BTreeMap<usize, [Option<&Pair>; 2]> = BTreeMap::new();
        for p in &self.pairs {
            rows.entry(p.left).or_default()[0] = Some(p);
        }
        for p in self.twin.iter().flat_map(|t| &t.pairs) {
            rows.entry(p.left).or_default()[1] = Some(p);
        }
        let row = |(left, [own, twin]): (&usize, &[Option<&Pair>; 2])| {
            let text = |x: Option<String>| x.unwrap_or_default();
            vec![
                left.to_string(),
                text(own.or(*twin).map(|p| p.left_vertex.to_string())),
                text(own.map(|p| p.right.to_string())),
                text(own.map(|p| p.right_vertex.to_string())),
                text(own.map(|p| p.descriptor_distance.to_string())),
                text(twin.map(|p| p.right.to_string())),
                text(twin.map(|p| p.right_vertex.to_string())),
            ]
        };
        Some(Table::new(&columns, rows.iter().map(row).collect()))
    }

    fn differences(&self, other: &Self, surfaces: &salient_sdk::Surfaces) -> Vec<salient_sdk::Difference> {
        crate::differences::matches(self, other, surfaces)
    }

    fn view(&self) -> salient_sdk::View<'_> {
        crate::views::matched(self)
    }
}

impl Match {
    fn twin_line(&self) -> String {
        match (&self.twin, self.twin_ratio()) {
            (Some(t), Some(ratio)) => format!(
                "{} matches, {:.0} % of them elsewhere, objective {:.6} ({:.1} % of the match's)",
                t.pairs.len(),
                100.0 * t.moved,
                t.objective,
                100.0 * ratio
            ),
            _ => "none".to_owned(),
        }
    }
}
