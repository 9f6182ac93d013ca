//! Toy nodes: lists of numbers, read, scaled, summed, and nodes that misbehave on purpose.
#![allow(dead_code, missing_docs)]

use std::sync::Arc;
use std::time::{Duration, Instant};

use salient_sdk::{
    AnyNode, Artefact, Context, Decoder, Defect, DefectKind, Difference, Encoder, FileParam, FormatError, Inputs,
    ItemHasher, Memo, Mesh, Node, NodeError, Port, PortValues, Surfaces, Table,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

pub static NODES: &[&dyn AnyNode] =
    &[&Read, &Scale::<1>, &Sign, &Sum, &Rest, &Product, &Fail, &Panics, &Slow, &Bad, &Wide, &Triangle];

/// Some numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Numbers {
    pub values: Vec<f64>,
    pub defects: Vec<Defect>,
}

impl Artefact for Numbers {
    const TYPE: &'static str = "numbers";
    const FORMAT: u32 = 1;
    const DOC: &'static str = "A list of numbers.";
    fn encode(&self, out: &mut Encoder) {
        out.f64("values", &self.values, &[self.values.len()]);
        out.header("defects", &self.defects);
    }
    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        Ok(Self { values: from.f64("values")?.0, defects: from.header("defects")? })
    }
    fn json(&self) -> Value {
        json!({ "values": self.values })
    }
    fn summary(&self) -> Vec<(&'static str, String)> {
        vec![("count", self.values.len().to_string()), ("values", format!("{:?}", self.values))]
    }
    fn defects(&self) -> Vec<Defect> {
        self.defects.clone()
    }
    fn differences(&self, other: &Self, _: &Surfaces) -> Vec<Difference> {
        let total = |of: &Self| of.values.iter().sum::<f64>();
        let count = Difference::of_count("count", self.values.len(), other.values.len());
        let total = Difference::of_number("total", total(self), total(other));
        total.into_iter().chain(count).collect()
    }
    fn table(&self) -> Option<Table> {
        Some(Table::new(&["value"], self.values.iter().map(|x| vec![x.to_string()]).collect()))
    }
}

/// No params.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct None {}

pub struct X {
    x: Arc<Numbers>,
}
impl Inputs for X {
    const PORTS: &'static [Port] = &[Port::one::<Numbers>("x", "numbers")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { x: from.one("x")? })
    }
}

macro_rules! node {
    ($name:ident, $kind:literal, $doc:literal, $params:ty, $inputs:ty, $run:expr) => {
        pub struct $name;
        impl Node for $name {
            const KIND: &'static str = $kind;
            const VERSION: u32 = 1;
            const DOC: &'static str = $doc;
            const EXAMPLE: &'static str = "";
            type Params = $params;
            type Inputs = $inputs;
            type Output = Numbers;
            fn run(p: &$params, i: $inputs, cx: Context) -> Result<Numbers, NodeError> {
                let run: fn(&$params, $inputs, Context) -> Result<Numbers, NodeError> = $run;
                run(p, i, cx)
            }
        }
    };
}

fn numbers(values: Vec<f64>) -> Numbers {
    Numbers { values, defects: vec![] }
}

/// Params of `read`.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReadParams {
    /// A text file: a number a line, or `include FILE`; a line `?` is a defect.
    path: FileParam,
}

node!(Read, "read", "Reads numbers. One a line.", ReadParams, (), |_, (), cx| {
    let mut out = Numbers::default();
    let text = |bytes: Arc<[u8]>| String::from_utf8_lossy(&bytes).into_owned();
    for line in text(cx.read("path")?).lines() {
        if let Some(name) = line.strip_prefix("include ") {
            let more = text(cx.read_beside("path", name)?);
            out.values.extend(more.lines().filter_map(|x| x.parse::<f64>().ok()));
        } else if let Some(name) = line.strip_prefix("maybe ") {
            let found = cx.read_beside("path", name).is_ok();
            out.values.push(f64::from(u8::from(found)));
        } else if line == "?" {
            let first = vec![out.values.len() as u32];
            let kind = DefectKind::DuplicateVertex;
            out.defects.push(Defect { kind, count: 1, first, repaired: false });
        } else {
            let bad = |_| NodeError::new(format!("`{line}` is not a number")).help("write one");
            out.values.push(line.parse().map_err(bad)?);
        }
    }
    cx.record("lines", out.values.len());
    Ok(out)
});

/// Params of `scale`.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScaleParams {
    /// What to multiply by, no unit.
    #[serde(default = "two")]
    #[schemars(range(min = -10.0, max = 10.0))]
    factor: f64,
}

fn two() -> f64 {
    2.0
}

/// `x * factor`, in any version.
pub struct Scale<const VERSION: u32>;
impl<const V: u32> Node for Scale<V> {
    const KIND: &'static str = "scale";
    const VERSION: u32 = V;
    const DOC: &'static str = "Multiplies. Each number by the factor.";
    const EXAMPLE: &'static str = "";
    type Params = ScaleParams;
    type Inputs = X;
    type Output = Numbers;
    fn run(p: &ScaleParams, i: X, _: Context) -> Result<Numbers, NodeError> {
        Ok(numbers(i.x.values.iter().map(|x| x * p.factor).collect()))
    }
}

/// The same numbers in another byte layout.
pub struct Rows(pub Numbers);
impl Artefact for Rows {
    const TYPE: &'static str = "numbers";
    const FORMAT: u32 = 2;
    const DOC: &'static str = "A list of numbers, in another layout.";
    fn encode(&self, out: &mut Encoder) {
        out.f64("rows", &self.0.values, &[self.0.values.len(), 1]);
    }
    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        Ok(Self(numbers(from.f64("rows")?.0)))
    }
    fn json(&self) -> Value {
        Artefact::json(&self.0)
    }
    fn summary(&self) -> Vec<(&'static str, String)> {
        Artefact::summary(&self.0)
    }
}

/// `scale` when its output had another format.
pub struct ScaleRows;
impl Node for ScaleRows {
    const KIND: &'static str = "scale";
    const VERSION: u32 = 1;
    const DOC: &'static str = "Multiplies. Each number by the factor.";
    const EXAMPLE: &'static str = "";
    type Params = ScaleParams;
    type Inputs = X;
    type Output = Rows;
    fn run(p: &ScaleParams, i: X, cx: Context) -> Result<Rows, NodeError> {
        Scale::<1>::run(p, i, cx).map(Rows)
    }
}

node!(Sign, "sign", "The sign of each number.", None, X, |_, i, _| {
    Ok(numbers(i.x.values.iter().map(|x| x.signum()).collect()))
});

pub struct Terms {
    terms: Vec<(String, Arc<Numbers>)>,
}
impl Inputs for Terms {
    const PORTS: &'static [Port] = &[Port::many::<Numbers>("terms", "what to add")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { terms: from.many("terms")? })
    }
}

node!(Sum, "sum", "Adds everything up.", None, Terms, |_, i, _| {
    Ok(numbers(vec![i.terms.iter().flat_map(|(_, x)| &x.values).sum()]))
});

pub struct Survivors {
    terms: Vec<(String, Arc<Numbers>)>,
    missing: Vec<String>,
}
impl Inputs for Survivors {
    const PORTS: &'static [Port] = &[Port::surviving::<Numbers>("terms", "what to add")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { missing: from.missing("terms"), terms: from.many("terms")? })
    }
}

node!(Rest, "rest", "The sum of what did not fail, and how many did.", None, Survivors, |_, i, _| {
    Ok(numbers(vec![i.terms.iter().flat_map(|(_, x)| &x.values).sum(), i.missing.len() as f64]))
});

pub struct Two {
    left: Arc<Numbers>,
    right: Arc<Numbers>,
}
impl Inputs for Two {
    const PORTS: &'static [Port] = &[Port::one::<Numbers>("left", "numbers"), Port::one::<Numbers>("right", "numbers")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { left: from.one("left")?, right: from.one("right")? })
    }
}

node!(Product, "product", "Multiplies two sums.", None, Two, |_, i, _| {
    let sum = |of: &Numbers| of.values.iter().sum::<f64>();
    Ok(numbers(vec![sum(&i.left), sum(&i.right), sum(&i.left) * sum(&i.right)]))
});

node!(Fail, "fail", "Fails.", None, X, |_, _, _| { Err(NodeError::new("it is the wrong number").help("use another")) });

node!(Panics, "panics", "Panics.", None, X, |_, i, _| panic!("index {} is bad", i.x.values.len()));

/// Params of `slow`.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SlowParams {
    /// How long, in milliseconds.
    millis: u64,
    /// Makes calls differ.
    #[serde(default)]
    tag: u32,
    /// How much memory it fills meanwhile, in MiB.
    #[serde(default)]
    memory: usize,
}

node!(Slow, "slow", "Takes its time.", SlowParams, X, |p, i, cx| {
    let (start, all) = (Instant::now(), Duration::from_millis(p.millis));
    let filled = vec![1_u8; p.memory << 20];
    while start.elapsed() < all {
        cx.check()?;
        cx.progress(start.elapsed().as_secs_f64() / all.as_secs_f64());
        std::thread::sleep(Duration::from_millis(2));
    }
    std::hint::black_box(&filled);
    Ok(numbers(i.x.values.iter().map(|x| x + f64::from(p.tag)).collect()))
});

/// Params of `bad`.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BadParams {
    /// Writes a NaN.
    #[serde(default)]
    nan: bool,
}

node!(Bad, "bad", "Makes -0.0 or NaN.", BadParams, (), |p, (), _| {
    Ok(numbers(vec![if p.nan { f64::NAN } else { -0.0 }]))
});

node!(Wide, "wide", "Squares on all workers.", None, X, |_, i, cx| {
    let square = |_, x: &f64| {
        std::thread::sleep(Duration::from_micros(100));
        Ok(x * x / 3.0)
    };
    Ok(numbers(cx.map(&i.x.values, square)?))
});

/// Whether `moody` fails: an impurity, for the tests of what the engine makes of it.
pub static MOODY: std::sync::atomic::AtomicBool = std::sync::atomic::AtomicBool::new(false);

node!(Moody, "moody", "Adds one, or fails.", None, X, |_, i, _| {
    if MOODY.load(std::sync::atomic::Ordering::SeqCst) {
        return Err(NodeError::new("not today"));
    }
    Ok(numbers(i.x.values.iter().map(|x| x + 1.0).collect()))
});

/// Params of `roots`.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RootsParams {
    /// Which root is taken.
    #[serde(default = "two")]
    degree: f64,
    /// What is added to each root, which no root depends on.
    #[serde(default)]
    plus: f64,
}

/// `x ^ (1 / degree) + plus` of each number, remembering roots; in any version. Zero has no root worth keeping, 13 is an error.
pub struct Roots<const VERSION: u32>;
impl<const V: u32> Node for Roots<V> {
    const KIND: &'static str = "roots";
    const VERSION: u32 = V;
    const DOC: &'static str = "Roots. Of each number.";
    const EXAMPLE: &'static str = "";
    type Params = RootsParams;
    type Inputs = X;
    type Output = Numbers;
    fn run(p: &RootsParams, i: X, cx: Context) -> Result<Numbers, NodeError> {
        let roots = cx.map_memo(&RootsMemo(p.degree), &i.x.values)?;
        Ok(numbers(roots.into_iter().map(|root| root + p.plus).collect()))
    }
}

struct RootsMemo(f64);
impl Memo for RootsMemo {
    type Item = f64;
    type Value = f64;
    fn name(&self) -> &'static str {
        "roots"
    }
    fn scope(&self) -> Value {
        json!({ "degree": self.0 })
    }
    fn content(&self, item: &f64, hash: &mut ItemHasher) {
        hash.f64s(&[*item]);
    }
    fn compute(&self, item: &f64, _: Context) -> Result<f64, NodeError> {
        if *item == 13.0 {
            return Err(NodeError::new("13 is unlucky"));
        }
        Ok(item.powf(1.0 / self.0))
    }
    fn encode(&self, value: &f64) -> Option<Vec<u8>> {
        (*value != 0.0).then(|| value.to_le_bytes().to_vec())
    }
    fn decode(&self, bytes: &[u8]) -> Option<f64> {
        Some(f64::from_le_bytes(bytes.try_into().ok()?))
    }
}

/// One triangle.
pub struct Triangle;
impl Node for Triangle {
    const KIND: &'static str = "triangle";
    const VERSION: u32 = 1;
    const DOC: &'static str = "One triangle.";
    const EXAMPLE: &'static str = "";
    type Params = None;
    type Inputs = ();
    type Output = Mesh;
    fn run(_: &None, (): (), _: Context) -> Result<Mesh, NodeError> {
        Ok(Mesh {
            vertices: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.1, 1.0 / 3.0]],
            faces: vec![[0, 1, 2]],
            ..Mesh::default()
        })
    }
}
