//! `maxima`: salient features, where the reconstruction energy peaks over space and frequency.
//!
//! A vertex i is a feature at frequency k if E(i, k) is strictly above the energy of its one-ring at
//! k-1, k and k+1 and above its own at k-1 and k+1. A vertex may be a feature at several frequencies.
//!
//! The definition gives more maxima than vertices, so the node also ranks and selects: by energy,
//! then scale, then index.

use std::cmp::Ordering;
use std::sync::Arc;

use salient_kernels::adjacency::one_ring;
use salient_sdk::{
    Artefact, Context, Decoder, Encoder, FormatError, Inputs, Mesh, Node, NodeError, Port, PortValues, Table,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::feature::{self, Feature};
use crate::reconstruction_energy::Energy;

/// Params of [`Maxima`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// How many features are kept, the highest energy first. At least 1, default 50.
    #[schemars(range(min = 1))]
    pub count: u32,
    /// Eigenpairs up to this index (exclusive) are searched. At least 2, default 100 as in the paper.
    #[schemars(range(min = 2))]
    pub frequencies: u32,
}

impl Default for Params {
    fn default() -> Self {
        Self { count: 50, frequencies: 100 }
    }
}

/// A mesh and its energy.
pub struct In {
    mesh: Arc<Mesh>,
    energy: Arc<Energy>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[
        Port::one::<Mesh>("mesh", "the shape, for its one-rings"),
        Port::one::<Energy>("energy", "its reconstruction energy"),
    ];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { mesh: from.one("mesh")?, energy: from.one("energy")? })
    }
}

/// The selected features, best first.
#[derive(Clone, Debug, PartialEq)]
pub struct Salient {
    /// The features, by falling energy.
    pub features: Vec<Feature>,
    /// How many maxima there were before the selection.
    pub found: usize,
}

impl Artefact for Salient {
    const TYPE: &'static str = "maxima";
    const FORMAT: u32 = 1;
    const DOC: &'static str =
        "Salient features, highest energy first: `vertex`, `k`, `lambda` (1/length²), `energy` (length), each [f].";

    fn encode(&self, out: &mut Encoder) {
        feature::encode(&self.features, out);
        out.header("found", &self.found);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        Ok(Self { features: feature::decode(from)?, found: from.header("found")? })
    }

    fn json(&self) -> Value {
        let features: Vec<Value> = self.features.iter().map(Feature::json).collect();
        json!({ "features": features, "found": self.found })
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        vec![("features", format!("{} of {} maxima", self.features.len(), self.found))]
    }

    fn table(&self) -> Option<Table> {
        Some(Table::new(&feature::COLUMNS, self.features.iter().map(feature::row).collect()))
    }

    fn differences(&self, other: &Self, surfaces: &salient_sdk::Surfaces) -> Vec<salient_sdk::Difference> {
        crate::differences::maxima(self, other, surfaces)
    }

    fn view(&self) -> salient_sdk::View<'_> {
        crate::views::maxima(&self.features)
    }
}

/// The node.
pub struct Maxima;

impl Node for Maxima {
    const KIND: &'static str = "maxima";
    const VERSION: u32 = 1;
    const DOC: &'static str = "Salient features: strict maxima of the energy over the one-ring and the neighbouring frequencies. \
        The best are kept, ranked by energy, then scale, then index.";
    const EXAMPLE: &'static str = r#"
        "mesh":      synthesize(),
        "laplacian": laplacian(mesh: "mesh"),
        "basis":     eigensolve(operator: "laplacian", pairs: 100),
        "energy":    reconstruction_energy(mesh: "mesh", basis: "basis"),
        "maxima":    maxima(mesh: "mesh", energy: "energy", count: 50),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Salient;

    fn run(params: &Params, In { mesh, energy }: In, cx: Context) -> Result<Salient, NodeError> {
        let n = mesh.vertices.len();
        if energy.vertices != n {
            return Err(NodeError::new(format!("the energy has {} vertices, but the mesh has {n}", energy.vertices)));
        }
        let ring = one_ring(n, &mesh.faces).map_err(|e| NodeError::new(e.to_string()))?;
        let clusters = energy.first.iter().take_while(|k| **k < params.frequencies).count();
        let mut features = Vec::new();
        for c in 0..clusters {
            cx.check()?;
            let here = energy.cluster(c);
            let around = c.saturating_sub(1)..(c + 2).min(clusters);
            let levels: Vec<&[f64]> = around.map(|level| energy.cluster(level)).collect();
            for (i, value) in here.iter().enumerate() {
                let above = |other: f64| *value > other;
                let peak = levels.iter().all(|level| {
                    let own = std::ptr::eq(*level, here) || above(level[i]);
                    own && ring.row(i).iter().all(|j| above(level[*j as usize]))
                });
                if peak {
                    features.push(Feature::new(i as u32, energy.first[c], energy.lambda[c], *value));
                }
            }
        }
        let found = features.len();
        features.sort_by(rank);
        features.truncate(params.count as usize);
        Ok(Salient { features, found })
    }
}

/// Higher energy first, then larger scale, then lower vertex index.
fn rank(a: &Feature, b: &Feature) -> Ordering {
    b.energy.total_cmp(&a.energy).then(a.k.cmp(&b.k)).then(a.vertex.cmp(&b.vertex))
}
