//! `patch_spectrum`: each patch described by the first eigenvalues of its own Laplacian.
//!
//! The patch glued to its mirror copy is a closed surface, and its spectrum is exactly the union of the
//! patch's Neumann and Dirichlet spectra; so two small problems replace a large one. With A the area of
//! the doubled patch, Weyl's law says that lambda_k A / (4 pi k) tends to 1, which is how descriptors are
//! made free of scale.

use std::f64::consts::PI;
use std::sync::Arc;

use salient_kernels::patch_spectrum::{self as kernel, PatchError, PatchOptions};
use salient_sdk::{
    Artefact, Context, Decoder, Defect, DefectKind, Encoder, FormatError, Inputs, ItemHasher, Memo, Node, NodeError,
    Port, PortValues, Table,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::eigensolve::ContextHooks;
use crate::feature::{self, Feature};
use crate::patch_extract::{Kind, Patch, Patches};

/// How eigenvalues are made free of scale by f(x) = 4 pi x / A.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Normalise {
    /// lambda_k / f(k): the ratio to Weyl's law, tending to 1.
    Elementwise,
    /// lambda_k / f(1): the growth in units of Weyl's slope, about k.
    Slope,
    /// lambda_k as it is, 1 / length².
    Never,
}

/// Params of [`PatchSpectrum`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Number of eigenvalues lambda_1, lambda_2, ... in a descriptor. 1 to 1000, default 21 (paper).
    #[schemars(range(min = 1, max = 1000))]
    pub values: u32,
    /// How they are normalised: `Elementwise` (default), `Slope` or `Never`.
    pub normalise: Normalise,
}

impl Default for Params {
    fn default() -> Self {
        Self { values: 21, normalise: Normalise::Elementwise }
    }
}

/// Patches.
pub struct In {
    patches: Arc<Patches>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[Port::one::<Patches>("patches", "the patches of a shape's features")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { patches: from.one("patches")? })
    }
}

/// What is kept of a patch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PatchSummary {
    /// Disk, annulus, whole or too small.
    pub kind: Kind,
    /// Number of vertices.
    pub vertices: usize,
    /// Area.
    pub area: f64,
}

/// Features with their descriptors: all that matching needs of a shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Features {
    /// The features, in the order of the input.
    pub features: Vec<Feature>,
    /// The patch of each.
    pub patches: Vec<PatchSummary>,
    /// The descriptor of each, or why it has none.
    pub descriptors: Vec<Result<Vec<f64>, String>>,
    /// Geodesic distances between features, f x f row-major, symmetric; -1 where no path leads.
    pub distances: Vec<f64>,
    /// Area of the whole shape.
    pub area: f64,
    /// Length of a descriptor.
    pub values: usize,
}

impl Features {
    /// Geodesic distance between two features, if a path leads from one to the other.
    #[must_use]
    pub fn distance(&self, a: usize, b: usize) -> Option<f64> {
        let d = self.distances[a * self.features.len() + b];
        (d >= 0.0).then_some(d)
    }

    /// The first `count` of them.
    #[must_use]
    pub fn first(&self, count: usize) -> Self {
        let n = count.min(self.features.len());
        let rows = self.distances.chunks(self.features.len().max(1)).take(n);
        Self {
            features: self.features[..n].to_vec(),
            patches: self.patches[..n].to_vec(),
            descriptors: self.descriptors[..n].to_vec(),
            distances: rows.flat_map(|row| row[..n].iter().copied()).collect(),
            area: self.area,
            values: self.values,
        }
    }
}

impl Artefact for Features {
    const TYPE: &'static str = "features";
    const FORMAT: u32 = 1;
    const PLACE: salient_sdk::Place = salient_sdk::Place::OnSurface;
    const DOC: &'static str = "Features with descriptors: the columns of the features, `descriptors` [f, values] (a row of zeros where \
        the header's `why` says that there is none) and geodesic `distances` [f, f] (length; -1: no path).";

    fn encode(&self, out: &mut Encoder) {
        feature::encode(&self.features, out);
        let zeros = vec![0.0; self.values];
        let rows: Vec<f64> =
            self.descriptors.iter().flat_map(|d| d.as_ref().unwrap_or(&zeros).iter().copied()).collect();
        out.f64("descriptors", &rows, &[self.features.len(), self.values]);
        out.f64("distances", &self.distances, &[self.features.len(), self.features.len()]);
        let why: Vec<_> = self.descriptors.iter().map(|d| d.as_ref().err()).collect();
        out.header("why", &why);
        out.header("patches", &self.patches);
        out.header("area", &self.area);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        let features = feature::decode(from)?;
        let (rows, shape) = from.f64("descriptors")?;
        let why: Vec<Option<String>> = from.header("why")?;
        let patches: Vec<PatchSummary> = from.header("patches")?;
        let (distances, square) = from.f64("distances")?;
        let f = features.len();
        if shape.len() != 2 || shape[0] != f || why.len() != f || patches.len() != f || square != [f, f] {
            return Err(FormatError(format!("{f} features, descriptors of shape {shape:?}")));
        }
        let row = |(i, why): (usize, Option<String>)| match why {
            Some(why) => Err(why),
            None => Ok(rows[i * shape[1]..(i + 1) * shape[1]].to_vec()),
        };
        Ok(Self {
            features,
            patches,
            descriptors: why.into_iter().enumerate().map(row).collect(),
            distances,
            area: from.header("area")?,
            values: shape[1],
        })
    }

    fn json(&self) -> Value {
        let entry = |i: usize| {
            let mut entry = self.features[i].json();
            entry["patch"] = json!(self.patches[i]);
            entry["descriptor"] = json!(self.descriptors[i].as_ref().ok());
            entry["why"] = json!(self.descriptors[i].as_ref().err());
            entry
        };
        (0..self.features.len()).map(entry).collect()
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        let described = self.descriptors.iter().filter(|d| d.is_ok()).count();
        vec![
            ("features", self.features.len().to_string()),
            ("described", format!("{described} by {} eigenvalues", self.values)),
        ]
    }

    fn defects(&self) -> Vec<Defect> {
        let without = |i: &usize| self.descriptors[*i].is_err();
        let all: Vec<usize> = (0..self.features.len()).filter(without).collect();
        if all.is_empty() {
            return Vec::new();
        }
        vec![Defect {
            kind: DefectKind::PatchWithoutDescriptor,
            count: all.len(),
            first: all.iter().take(8).map(|i| self.features[*i].vertex).collect(),
            repaired: false,
        }]
    }

    fn table(&self) -> Option<Table> {
        let values: Vec<String> = (1..=self.values).map(|k| format!("d{k}")).collect();
        let columns = feature::COLUMNS.iter().map(|c| (*c).to_owned()).chain(values).collect();
        let row = |(f, d): (&Feature, &Result<Vec<f64>, String>)| {
            let descriptor = match d {
                Ok(d) => d.iter().map(f64::to_string).collect(),
                Err(_) => vec![String::new(); self.values],
            };
            [feature::row(f), descriptor].concat()
        };
        Some(Table { columns, rows: self.features.iter().zip(&self.descriptors).map(row).collect() })
    }

    fn differences(&self, other: &Self, surfaces: &salient_sdk::Surfaces) -> Vec<salient_sdk::Difference> {
        crate::differences::features(self, other, surfaces)
    }

    fn view(&self) -> salient_sdk::View<'_> {
        crate::views::features(self)
    }
}

/// The node.
pub struct PatchSpectrum;

impl Node for PatchSpectrum {
    const KIND: &'static str = "patch_spectrum";
    const VERSION: u32 = 5;
    const DOC: &'static str = "Each patch's first Laplace-Beltrami eigenvalues, doubled across its boundary, as a descriptor free of scale. \
        A patch with too few vertices for them has no descriptor and says why.";
    const EXAMPLE: &'static str = r#"
        "mesh":      synthesize(),
        "laplacian": laplacian(mesh: "mesh"),
        "basis":     eigensolve(operator: "laplacian", pairs: 100),
        "energy":    reconstruction_energy(mesh: "mesh", basis: "basis"),
        "maxima":    maxima(mesh: "mesh", energy: "energy"),
        "patches":   patch_extract(mesh: "mesh", maxima: "maxima"),
        "features":  patch_spectrum(patches: "patches", values: 21),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Features;

    fn run(params: &Params, In { patches }: In, cx: Context) -> Result<Features, NodeError> {
        let spectra = cx.map_memo(&Spectra { values: params.values }, &patches.patches)?;
        let descriptors = spectra.into_iter().map(|s| Ok(normalised(&s?, params.normalise))).collect();
        let summary = |p: &Patch| PatchSummary { kind: p.kind, vertices: p.vertices.len(), area: p.area };
        Ok(Features {
            features: patches.features.clone(),
            patches: patches.patches.iter().map(summary).collect(),
            descriptors,
            distances: patches.distances.clone(),
            area: patches.area,
            values: params.values as usize,
        })
    }
}

/// The spectrum of one patch, which depends on the patch and the number of values alone.
struct Spectra {
    values: u32,
}

/// Eigenvalues, and the area of the closed surface that has them.
struct Spectrum {
    values: Vec<f64>,
    closed_area: f64,
}

impl Memo for Spectra {
    type Item = Patch;
    /// Or why the patch has none.
    type Value = Result<Spectrum, String>;

    fn name(&self) -> &'static str {
        "patches"
    }

    fn scope(&self) -> Value {
        json!({ "values": self.values })
    }

    fn content(&self, patch: &Patch, hash: &mut ItemHasher) {
        hash.u32s(&[patch.kind as u32]);
        hash.f64s(patch.vertices.as_flattened());
        hash.u32s(patch.faces.as_flattened());
    }

    fn weight(&self, patch: &Patch) -> usize {
        patch.vertices.len()
    }

    fn compute(&self, patch: &Patch, cx: Context) -> Result<Self::Value, NodeError> {
        if patch.kind == Kind::TooSmall {
            return Ok(Err("the patch is too small for the mesh: no face lies within its radius".into()));
        }
        let (count, options) = (self.values as usize, PatchOptions::default());
        match kernel::patch_spectrum(&patch.vertices, &patch.faces, count, &options, &ContextHooks(cx)) {
            Ok(found) => Ok(Ok(Spectrum { values: found.values, closed_area: found.closed_area })),
            Err(PatchError::Cancelled) => Err(NodeError::cancelled()),
            Err(e) => Ok(Err(e.to_string())),
        }
    }

    fn encode(&self, value: &Self::Value) -> Option<Vec<u8>> {
        let spectrum = value.as_ref().ok()?;
        let numbers = spectrum.values.iter().chain([&spectrum.closed_area]);
        Some(numbers.flat_map(|x| x.to_le_bytes()).collect())
    }

    fn decode(&self, bytes: &[u8]) -> Option<Self::Value> {
        let (numbers, []) = bytes.as_chunks() else { return None };
        let mut values: Vec<f64> = numbers.iter().map(|b| f64::from_le_bytes(*b)).collect();
        let closed_area = values.pop()?;
        (values.len() == self.values as usize).then_some(Ok(Spectrum { values, closed_area }))
    }
}

/// The descriptor that a spectrum gives.
fn normalised(spectrum: &Spectrum, normalise: Normalise) -> Vec<f64> {
    let slope = 4.0 * PI / spectrum.closed_area;
    let normalised = |(i, lambda): (usize, &f64)| match normalise {
        Normalise::Elementwise => lambda / (slope * (i + 1) as f64),
        Normalise::Slope => lambda / slope,
        Normalise::Never => *lambda,
    };
    spectrum.values.iter().enumerate().map(normalised).collect()
}
