//! `match_all`: every query matched with every target, as `iqp_match` does it, but only for what each match comes to.
//!
//! One node for all pairs, and not one for each: a match takes milliseconds, and 80,000 calls cost more than that to look up and to
//! keep. Pairs are remembered one by one, so a new shape costs its own row. A pair and its reverse are one.

use std::collections::BTreeMap;
use std::sync::Arc;

use salient_sdk::{Context, Inputs, ItemHasher, ItemKey, Memo, Node, NodeError, Port, PortValues};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::iqp_match::{self, Compare, IqpMatch, Scales, Unit};
use crate::lists::Order;
use crate::pair_scores::{PairScore, PairScores, Shape};
use crate::patch_spectrum::Features;
use crate::similarity::{Similarity, keep_known, united};

/// How equations 19 to 26 are read: see `iqp_match`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Reading {
    /// The defaults of `iqp_match`: distances in sqrt(area), compared by their ratio; absolute scales.
    Robust,
    /// As printed: distances over scales, compared by their difference; relative scales.
    Paper,
}

/// Params of [`MatchAll`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// How many features of each shape are matched, the first ones. At least 1, default 50.
    #[schemars(range(min = 1))]
    pub features: u32,
    /// `Robust` (default) or `Paper`, as in `corrected.ron`; the paper's has `agreement: 0` and no sigmas, too.
    pub reading: Reading,
    /// Candidates of each feature, as in `iqp_match`. 1 to 1000, default 3.
    #[schemars(range(min = 1, max = 1000))]
    pub candidates: u32,
    /// Weight of the descriptors' term against the relations'. At least 0, default 5 (paper: 1).
    #[schemars(range(min = 0.0))]
    pub beta: f64,
    /// How well two matches must agree to support each other, as in `iqp_match`. 0 to 1, default 0.5.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub agreement: f64,
    /// Sigma of descriptor distances. Above 0; default 0.5, the same for all pairs, since scores of different pairs are compared;
    /// `None` for each pair's median.
    #[schemars(range(min = 1e-9))]
    pub sigma_descriptor: Option<f64>,
    /// Sigma of geodesic distances, as in `iqp_match`. Default 0.15.
    #[schemars(range(min = 1e-9))]
    pub sigma_geodesic: Option<f64>,
    /// Sigma of logarithmic scale ratios, as in `iqp_match`. Default 0.15.
    #[schemars(range(min = 1e-9))]
    pub sigma_scale: Option<f64>,
    /// The query's lengths may differ from the target's by a factor up to this, which is searched: for parts. 1 to 10, default 1.
    #[schemars(range(min = 1.0, max = 10.0))]
    pub stretch: f64,
    /// Passes of local search over each match, at most. 0 to 1000, default 10; 0 takes the spectral match as it is.
    #[schemars(range(min = 0, max = 1000))]
    pub passes: u32,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            features: 50,
            reading: Reading::Robust,
            candidates: 3,
            beta: 5.0,
            agreement: 0.5,
            sigma_descriptor: Some(0.5),
            sigma_geodesic: Some(0.15),
            sigma_scale: Some(0.15),
            stretch: 1.0,
            passes: 10,
        }
    }
}

impl Params {
    /// The params of a single match.
    #[must_use]
    pub fn matching(&self) -> iqp_match::Params {
        let (unit, compare, scales) = match self.reading {
            Reading::Robust => (Unit::Area, Compare::LogRatio, Scales::Absolute),
            Reading::Paper => (Unit::Scale, Compare::Difference, Scales::Relative),
        };
        iqp_match::Params {
            candidates: self.candidates,
            beta: self.beta,
            unit,
            compare,
            scales,
            agreement: self.agreement,
            sigma_descriptor: self.sigma_descriptor,
            sigma_geodesic: self.sigma_geodesic,
            sigma_scale: self.sigma_scale,
            stretch: self.stretch,
            ..iqp_match::Params::default()
        }
    }
}

/// Features of all shapes, by name.
pub struct In {
    queries: Named,
    targets: Named,
    missing: Vec<String>,
    shortlist: Option<Arc<Similarity>>,
}

type Named = Vec<(String, Arc<Features>)>;

impl Inputs for In {
    const PORTS: &'static [Port] = &[
        Port::surviving::<Features>("queries", "features of the shapes to look for"),
        Port::surviving::<Features>(
            "targets",
            "features of the database; the same as the queries to rank it against itself",
        ),
        Port::optional::<Similarity>("shortlist", "which pairs are matched, from `shortlist`; without it, all are"),
    ];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self {
            missing: united(&from.missing("queries"), &from.missing("targets")),
            queries: from.many("queries")?,
            targets: from.many("targets")?,
            shortlist: from.optional("shortlist")?,
        })
    }
}

/// The node.
pub struct MatchAll;

impl Node for MatchAll {
    const KIND: &'static str = "match_all";
    const VERSION: u32 = 1;
    const DOC: &'static str = "What matching each query with each target comes to: the objective of eq. 19-26 of the best match that quick heuristics find, \
        without proof. Pairs are remembered one by one. Shapes that failed are listed.";
    const EXAMPLE: &'static str = r#"
        "a":       synthesize(pose: 0),
        "b":       synthesize(pose: 1),
        "fa":      graph(file: "salient_features.ron", mesh: "a"),
        "fb":      graph(file: "salient_features.ron", mesh: "b"),
        "matches": match_all(queries: ["fa", "fb"], targets: ["fa", "fb"]),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = PairScores;

    fn check(params: &Params) -> Vec<(&'static str, String)> {
        IqpMatch::check(&params.matching())
    }

    fn run(params: &Params, inputs: In, cx: Context) -> Result<PairScores, NodeError> {
        let In { mut queries, mut targets, mut missing, shortlist } = inputs;
        if let Some(list) = &shortlist {
            let lost = [keep_known(&mut queries, &list.queries), keep_known(&mut targets, &list.targets)];
            missing = united(&united(&missing, &list.missing), &lost.concat());
        }
        if queries.is_empty() || targets.is_empty() {
            return Err(NodeError::new(format!("there are no features: all {} shapes failed", missing.len())));
        }
        let mut table = Table::new(params);
        let q: Vec<usize> = queries.iter().map(|(_, features)| table.add(features)).collect();
        let t: Vec<usize> = targets.iter().map(|(_, features)| table.add(features)).collect();
        table.same_values()?;
        let names = |of: &Named| of.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
        let compared = shortlist.map(|list| list.listed(&names(&queries), &names(&targets))).transpose()?;
        let order = Order { targets: targets.len(), lists: compared.as_ref() };
        // Each unordered pair once; a shape with itself is known without search.
        let ordered = |a: usize, b: usize| if table.keys[a] <= table.keys[b] { (a, b) } else { (b, a) };
        let row = |(i, a): (usize, &usize)| order.row(i).map(|j| ordered(*a, t[j])).collect::<Vec<_>>();
        let mut items: Vec<(usize, usize)> = q.iter().enumerate().flat_map(row).filter(|(a, b)| a != b).collect();
        items.sort_unstable();
        items.dedup();
        let found = cx.map_memo(&table, &items)?;
        let score = |a: usize, b: usize| match items.binary_search(&ordered(a, b)) {
            Ok(at) => found[at],
            Err(_) => table.itself(a),
        };
        let row = |(i, a): (usize, &usize)| order.row(i).map(|j| score(*a, t[j])).collect::<Vec<_>>();
        let pairs = q.iter().enumerate().flat_map(row).collect();
        let named = |names: &Named, at: &[usize]| {
            let shape =
                |((name, _), a): (&(String, _), &usize)| Shape { name: name.clone(), ..table.shapes[*a].clone() };
            names.iter().zip(at).map(shape).collect()
        };
        Ok(PairScores { queries: named(&queries, &q), targets: named(&targets, &t), pairs, compared, missing })
    }
}

/// Distinct shapes, cut to their first features.
struct Table<'a> {
    params: &'a Params,
    matching: iqp_match::Params,
    features: Vec<Arc<Features>>,
    shapes: Vec<Shape>,
    keys: Vec<ItemKey>,
    known: BTreeMap<ItemKey, usize>,
}

impl<'a> Table<'a> {
    fn new(params: &'a Params) -> Self {
        let (features, shapes, keys, known) = Default::default();
        Self { params, matching: params.matching(), features, shapes, keys, known }
    }

    /// The index of a shape, added if there is none of this content.
    fn add(&mut self, features: &Arc<Features>) -> usize {
        let count = self.params.features as usize;
        // Ten thousand shapes are not held twice.
        let cut = if features.features.len() <= count { features.clone() } else { Arc::new(features.first(count)) };
        let key = content(&cut);
        let next = self.features.len();
        let at = *self.known.entry(key).or_insert(next);
        if at == next {
            let described = cut.descriptors.iter().filter(|d| d.is_ok()).count() as u32;
            let own = iqp_match::own(&cut, &self.matching);
            self.shapes.push(Shape { name: String::new(), features: described, own });
            self.features.push(cut);
            self.keys.push(key);
        }
        at
    }

    /// What a shape comes to with itself.
    fn itself(&self, a: usize) -> PairScore {
        let Shape { features, own, .. } = self.shapes[a];
        PairScore { objective: own, descriptors: self.params.beta * f64::from(features), matched: features }
    }

    fn same_values(&self) -> Result<(), NodeError> {
        let mut all: Vec<usize> = self.features.iter().map(|f| f.values).collect();
        all.sort_unstable();
        all.dedup();
        if all.len() <= 1 {
            Ok(())
        } else {
            Err(NodeError::new(format!("descriptors have different numbers of values: {all:?}")))
        }
    }
}

/// Hash of all of a shape that matching depends on.
fn content(shape: &Features) -> ItemKey {
    let mut hash = ItemHasher::default();
    hash.f64s(&shape.features.iter().map(|f| f.scale).collect::<Vec<_>>());
    for descriptor in &shape.descriptors {
        hash.f64s(descriptor.as_ref().map_or(&[], Vec::as_slice));
    }
    hash.f64s(&shape.distances);
    hash.f64s(&[shape.area]);
    hash.finish()
}

impl Memo for Table<'_> {
    /// Indices of two shapes.
    type Item = (usize, usize);
    type Value = PairScore;

    fn name(&self) -> &'static str {
        "pairs"
    }

    fn scope(&self) -> Value {
        // The number of features is in the content.
        json!({ "matching": self.matching, "passes": self.params.passes })
    }

    fn content(&self, (a, b): &(usize, usize), hash: &mut ItemHasher) {
        hash.part(&self.keys[*a]);
        hash.part(&self.keys[*b]);
    }

    fn compute(&self, (a, b): &(usize, usize), cx: Context) -> Result<PairScore, NodeError> {
        iqp_match::outcome(&self.features[*a], &self.features[*b], &self.matching, self.params.passes as usize, cx)
    }

    fn encode(&self, value: &PairScore) -> Option<Vec<u8>> {
        let numbers = [value.objective, value.descriptors, f64::from(value.matched)];
        Some(numbers.iter().flat_map(|x| x.to_le_bytes()).collect())
    }

    fn decode(&self, bytes: &[u8]) -> Option<PairScore> {
        let (numbers, []) = bytes.as_chunks() else { return None };
        let [objective, descriptors, matched] = numbers.iter().map(|b| f64::from_le_bytes(*b)).collect::<Vec<_>>()[..]
        else {
            return None;
        };
        Some(PairScore { objective, descriptors, matched: matched as u32 })
    }
}
