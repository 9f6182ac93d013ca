//! `match_all`: every query matched with every target, as `iqp_match` does it, but only for what each match comes to.
//!
//! One node for all pairs, and not one for each: a match takes milliseconds, and 80,000 calls cost more than that to look up and to
//! keep. Pairs are remembered one by one, so a new shape costs its own row. A pair and its reverse are one.

use std::collections::BTreeMap;
use std::sync::Arc;

use salient_kernels::assignment::Limits;
use salient_sdk::{Context, Inputs, ItemHasher, ItemKey, Memo, Node, NodeError, Port, PortValues};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::iqp_match::{self, Compare, IqpMatch, Scales, Unit};
use crate::pair_scores::{PairScore, PairScores, Shape};
use crate::patch_spectrum::Features;
use crate::similarity::{Similarity, united};

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
    /// How many features of each shape are matched, the first ones. At least 1, default 40.
    #[schemars(range(min = 1))]
    pub features: u32,
    /// `Robust` (default) or `Paper`, as in `corrected.ron`; the paper's has `agreement: 0` and no sigmas, too.
    pub reading: Reading,
    /// Candidates of each feature, as in `iqp_match`. 1 to 1000, default 3.
    #[schemars(range(min = 1, max = 1000))]
    pub candidates: u32,
    /// Weight of the descriptors' term against the relations'. At least 0, default 1.
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
    /// Runs of the tabu search on each pair. 0 to 1000, default 1; 0 takes the greedy match.
    #[schemars(range(min = 0, max = 1000))]
    pub runs: u32,
    /// Moves without improvement that end a run. 0 to 10,000, default 30.
    #[schemars(range(min = 0, max = 10_000))]
    pub idle: u32,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            features: 40,
            reading: Reading::Robust,
            candidates: 3,
            beta: 1.0,
            agreement: 0.5,
            sigma_descriptor: Some(0.5),
            sigma_geodesic: Some(0.15),
            sigma_scale: Some(0.15),
            stretch: 1.0,
            runs: 1,
            idle: 30,
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
        let In { queries, targets, missing, shortlist } = inputs;
        let mut table = Table::new(params);
        let q: Vec<usize> = queries.iter().map(|(_, features)| table.add(features)).collect();
        let t: Vec<usize> = targets.iter().map(|(_, features)| table.add(features)).collect();
        table.same_values()?;
        let wanted = chosen(shortlist.as_deref(), &queries, &targets)?;
        // Each unordered pair once; a shape with itself is known without search.
        let mut place: BTreeMap<(usize, usize), usize> = BTreeMap::new();
        let ordered = |a: usize, b: usize| if table.keys[a] <= table.keys[b] { (a, b) } else { (b, a) };
        let mut items = Vec::new();
        for (i, a) in q.iter().enumerate() {
            for (_, b) in t.iter().enumerate().filter(|(j, b)| *b != a && wanted(i, *j)) {
                place.entry(ordered(*a, *b)).or_insert_with(|| {
                    items.push(ordered(*a, *b));
                    items.len() - 1
                });
            }
        }
        let found = cx.map_memo(&table, &items)?;
        let itself = |a: usize| {
            let features = table.shapes[a].features;
            PairScore {
                objective: table.shapes[a].own,
                descriptors: params.beta * f64::from(features),
                matched: features,
            }
        };
        let mut pairs = Vec::with_capacity(q.len() * t.len());
        for (i, a) in q.iter().enumerate() {
            for (j, b) in t.iter().enumerate() {
                let score = || if a == b { itself(*a) } else { found[place[&ordered(*a, *b)]] };
                pairs.push(wanted(i, j).then(score));
            }
        }
        let named = |names: &Named, at: &[usize]| {
            let shape =
                |((name, _), a): (&(String, _), &usize)| Shape { name: name.clone(), ..table.shapes[*a].clone() };
            names.iter().zip(at).map(shape).collect()
        };
        Ok(PairScores { queries: named(&queries, &q), targets: named(&targets, &t), pairs, missing })
    }
}

/// Which pairs (query, target) a shortlist has; without one, all.
fn chosen<'a>(
    shortlist: Option<&'a Similarity>,
    queries: &[(String, Arc<Features>)],
    targets: &[(String, Arc<Features>)],
) -> Result<Box<dyn Fn(usize, usize) -> bool + 'a>, NodeError> {
    let Some(list) = shortlist else { return Ok(Box::new(|_, _| true)) };
    let index =
        |names: &'a [String]| names.iter().enumerate().map(|(i, n)| (n.as_str(), i)).collect::<BTreeMap<_, _>>();
    let (rows, columns) = (index(&list.queries), index(&list.targets));
    let find = |names: &[(String, Arc<Features>)], known: &BTreeMap<&str, usize>| {
        let one = |(name, _): &(String, _)| {
            known.get(name.as_str()).copied().ok_or_else(|| NodeError::new(format!("`{name}` is not in the shortlist")))
        };
        names.iter().map(one).collect::<Result<Vec<usize>, NodeError>>()
    };
    let (rows, columns) = (find(queries, &rows)?, find(targets, &columns)?);
    let width = list.targets.len();
    let compared = list.compared.as_ref();
    Ok(Box::new(move |i, j| compared.is_none_or(|c| c[rows[i] * width + columns[j]] == 1)))
}

/// Distinct shapes, cut to their first features.
struct Table<'a> {
    params: &'a Params,
    matching: iqp_match::Params,
    effort: Limits,
    features: Vec<Features>,
    shapes: Vec<Shape>,
    keys: Vec<ItemKey>,
    known: BTreeMap<ItemKey, usize>,
}

impl<'a> Table<'a> {
    fn new(params: &'a Params) -> Self {
        let effort = Limits {
            node_limit: 0,
            root_rounds: 0,
            starts: params.runs as usize,
            idle_moves: params.idle as usize,
            ..Limits::default()
        };
        let (features, shapes, keys, known) = Default::default();
        Self { params, matching: params.matching(), effort, features, shapes, keys, known }
    }

    /// The index of a shape, added if there is none of this content.
    fn add(&mut self, features: &Features) -> usize {
        let cut = features.first(self.params.features as usize);
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
        json!({ "matching": self.matching, "runs": self.params.runs, "idle": self.params.idle })
    }

    fn content(&self, (a, b): &(usize, usize), hash: &mut ItemHasher) {
        hash.part(&self.keys[*a]);
        hash.part(&self.keys[*b]);
    }

    fn compute(&self, (a, b): &(usize, usize), cx: Context) -> Result<PairScore, NodeError> {
        iqp_match::outcome(&self.features[*a], &self.features[*b], &self.matching, &self.effort, cx)
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
