//! A graph with its files, as data: what it says as RON, what it computes, and what each call is made of.
//!
//! This knows the toy nodes and what a key is meant to hold, and nothing of the engine.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

/// splitmix64: the same numbers on every machine.
#[derive(Clone)]
pub struct Dice(pub u64);

impl Dice {
    pub fn roll(&mut self, below: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % below.max(1) as u64) as usize
    }

    pub fn pick<'a, T>(&mut self, items: &'a [T]) -> &'a T {
        &items[self.roll(items.len())]
    }

    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            items.swap(i, self.roll(i + 1));
        }
    }
}

/// A node; wires are indices of earlier nodes.
#[derive(Clone, Debug)]
pub enum Kind {
    Read(usize),
    /// One for each shape.
    Each,
    Scale(usize, i8),
    Sign(usize),
    Wide(usize),
    Sum(Vec<usize>),
    /// The sum over all instances.
    All(usize),
    /// The subgraph: the sum of its input and of its input scaled.
    Sub(usize),
}

impl Kind {
    fn wires(&mut self) -> Vec<&mut usize> {
        match self {
            Self::Read(_) | Self::Each => vec![],
            Self::Scale(x, _) | Self::Sign(x) | Self::Wide(x) | Self::All(x) | Self::Sub(x) => vec![x],
            Self::Sum(terms) => terms.iter_mut().collect(),
        }
    }
}

pub const FILES: [&str; 3] = ["f0.txt", "f1.txt", "f2.dat"];
const SHAPES: [&str; 4] = ["s0", "s1", "s2", "s3"];

/// What an output holds: numbers by their bits, and places of defects.
pub type Output = (Vec<u64>, Vec<u32>);

/// One call, by what its key is meant to hold.
#[derive(Clone, Debug, PartialEq)]
pub struct Call {
    /// Everything that its output depends on; `None` if an input has none.
    pub identity: Option<String>,
    /// `None` if it fails, or is not tried.
    pub output: Option<Output>,
    /// Addresses of its producers.
    pub inputs: Vec<String>,
}

#[derive(Clone, Debug)]
pub struct Model {
    nodes: Vec<(String, Kind)>,
    show: Vec<usize>,
    files: [String; 3],
    /// Content by stem; never empty.
    shapes: BTreeMap<&'static str, String>,
    sub_factor: i8,
    /// Version of the node `scale`.
    pub version: u32,
    /// `--set` of the factor of all nodes at the top.
    set: Option<i8>,
    /// Changes of the text without meaning.
    style: u64,
    names: usize,
}

fn content(dice: &mut Dice) -> String {
    let lines = ["1", "-2", "0", "2.5", "7", "7", "?", "include f1.txt", "maybe f2.dat", "maybe none", "oops"];
    let usual = lines.len() - usize::from(dice.roll(4) > 0);
    let lines: Vec<_> = (0..=dice.roll(4)).map(|_| *dice.pick(&lines[..usual])).collect();
    lines.join("\n") + "\n"
}

fn plain(dice: &mut Dice) -> String {
    format!("{}\n", dice.roll(4))
}

impl Model {
    pub fn new(dice: &mut Dice) -> Self {
        let mut model = Self {
            nodes: vec![("n0".into(), Kind::Read(0)), ("n1".into(), Kind::Each)],
            show: vec![0],
            files: [(); 3].map(|()| content(dice)),
            shapes: SHAPES[..2].iter().map(|stem| (*stem, plain(dice))).collect(),
            sub_factor: 2,
            version: 1,
            set: None,
            style: 0,
            names: 2,
        };
        for _ in 0..3 + dice.roll(8) {
            model.add(dice);
        }
        model.show = vec![model.nodes.len() - 1, dice.roll(model.nodes.len())];
        model.repair();
        model
    }

    fn add(&mut self, dice: &mut Dice) {
        let kind = kind(dice, self.nodes.len());
        self.nodes.push((format!("n{}", self.names), kind));
        self.names += 1;
    }

    /// One random edit; says which, for messages.
    pub fn edit(&mut self, dice: &mut Dice) -> String {
        let i = dice.roll(self.nodes.len());
        let what = match dice.roll(14) {
            0 | 1 => {
                let file = dice.roll(3);
                self.files[file] = content(dice);
                format!("content of {}: {:?}", FILES[file], self.files[file])
            }
            2 => {
                let (from, to) = (dice.roll(3), dice.roll(3));
                let text = self.files[from].clone();
                self.files[to] = text;
                format!("{} becomes a copy of {}", FILES[to], FILES[from])
            }
            3 => {
                let stem = *dice.pick(&SHAPES);
                let text = plain(dice);
                self.shapes.insert(stem, text.clone());
                format!("shape {stem}: {text:?}")
            }
            4 if self.shapes.len() > 1 => {
                let stem = *dice.pick(&self.shapes.keys().copied().collect::<Vec<_>>());
                let text = self.shapes.remove(stem).unwrap();
                if dice.roll(2) == 0 {
                    self.shapes.insert(*dice.pick(&SHAPES[..]), text);
                }
                format!("shape {stem} is gone or renamed")
            }
            5 => {
                self.sub_factor = dice.roll(5) as i8 - 2;
                format!("factor in the subgraph: {}", self.sub_factor)
            }
            6 => {
                self.set = if dice.roll(2) == 0 { None } else { Some(dice.roll(4) as i8) };
                format!("--set: {:?}", self.set)
            }
            7 => {
                self.nodes[i].0 = format!("n{}", self.names);
                self.names += 1;
                format!("node {i} renamed")
            }
            8 if i > 0 => {
                self.nodes[i].1 = kind(dice, i);
                format!("node {i} is now {:?}", self.nodes[i].1)
            }
            9 if i > 0 => {
                for wire in self.nodes[i].1.wires() {
                    *wire = dice.roll(i);
                }
                format!("node {i} rewired: {:?}", self.nodes[i].1)
            }
            10 => {
                self.add(dice);
                "a new node".into()
            }
            11 => {
                self.show = (0..=dice.roll(2)).map(|_| dice.roll(self.nodes.len())).collect();
                format!("shows {:?}", self.show)
            }
            12 => {
                self.version = 1 + dice.roll(2) as u32;
                format!("scale has version {}", self.version)
            }
            _ => {
                self.style = dice.roll(1000) as u64;
                "style".into()
            }
        };
        self.repair();
        what
    }

    /// Makes wires fit again after an edit.
    fn repair(&mut self) {
        for i in 0..self.nodes.len() {
            let along: Vec<bool> = (0..i).map(|j| self.along(j)).collect();
            let kind = &mut self.nodes[i].1;
            match kind {
                Kind::Sum(terms) => terms.iter_mut().filter(|x| along[**x]).for_each(|x| *x = 0),
                Kind::Sub(x) if along[*x] => *x = 0,
                Kind::All(x) if !along[*x] => *kind = Kind::Scale(*x, 2),
                _ => {}
            }
        }
        self.show.sort_unstable();
        self.show.dedup();
    }

    /// Whether a node is repeated along the axis of shapes.
    fn along(&self, i: usize) -> bool {
        match self.nodes[i].1 {
            Kind::Each => true,
            Kind::Scale(x, _) | Kind::Sign(x) | Kind::Wide(x) => self.along(x),
            _ => false,
        }
    }

    /// All files, by name.
    pub fn files(&self) -> BTreeMap<String, String> {
        let mut all: BTreeMap<_, _> =
            FILES.iter().zip(&self.files).map(|(name, text)| ((*name).to_owned(), text.clone())).collect();
        all.extend(self.shapes.iter().map(|(stem, text)| (format!("in/{stem}.txt"), text.clone())));
        all.insert("g.ron".into(), self.ron());
        all.insert(
            "sub.ron".into(),
            format!(
                "(format: 1, inputs: {{\"x\": \"numbers\"}}, nodes: {{\"s\": scale(x: \"x\", factor: {}.0),\n\
                 \"t\": sum(terms: [\"s\", \"x\"])}}, output: \"t\")",
                self.sub_factor
            ),
        );
        all
    }

    /// `--set`, as on the command line.
    pub fn sets(&self) -> Vec<String> {
        let tops = self.nodes.iter().filter(|(_, kind)| matches!(kind, Kind::Scale(..)));
        tops.filter_map(|(name, _)| Some(format!("{name}.factor={}", self.set?))).collect()
    }

    /// Without `--set`.
    pub fn forget_sets(&mut self) {
        self.set = None;
    }

    fn ron(&self) -> String {
        let mut dice = Dice(self.style);
        let mut lines: Vec<String> = self.nodes.iter().map(|(name, kind)| self.line(name, kind, &mut dice)).collect();
        dice.shuffle(&mut lines);
        let show: Vec<_> = self.show.iter().map(|i| format!("{:?}", self.nodes[*i].0)).collect();
        let noise = format!("/* {} */", dice.roll(100));
        format!(
            "(format: 1, {noise} over: {{\"shape\": files(\"in/*.txt\")}}, nodes: {{\n{}}}, show: [{}])\n",
            lines.concat(),
            show.join(", ")
        )
    }

    fn line(&self, name: &str, kind: &Kind, dice: &mut Dice) -> String {
        let at = |x: &usize| format!("{:?}", self.nodes[*x].0);
        let call = match kind {
            Kind::Read(file) => format!("read(path: \"{}{}\")", ["", "./"][dice.roll(2)], FILES[*file]),
            Kind::Each => "read(path: each(\"shape\"))".into(),
            // Left out, it is 2.
            Kind::Scale(x, 2) if dice.roll(2) == 0 => format!("scale(x: {})", at(x)),
            Kind::Scale(x, factor) => format!("scale(factor: {factor}{}, x: {})", ["", ".0"][dice.roll(2)], at(x)),
            Kind::Sign(x) => format!("sign(x: {})", at(x)),
            Kind::Wide(x) => format!("wide( x: {} )", at(x)),
            Kind::Sum(terms) => format!("sum(terms: [{}])", terms.iter().map(at).collect::<Vec<_>>().join(", ")),
            Kind::All(x) => format!("sum(terms: all({}))", at(x)),
            Kind::Sub(x) => format!("graph(file: \"sub.ron\", x: {})", at(x)),
        };
        format!("    \"{name}\": {call},\n")
    }

    /// Addresses of the shown results.
    pub fn shown(&self) -> Vec<String> {
        let mut all = Vec::new();
        for i in &self.show {
            let name = &self.nodes[*i].0;
            if self.along(*i) {
                all.extend(self.shapes.keys().map(|stem| format!("{name}[{stem}]")));
            } else {
                all.push(name.clone());
            }
        }
        all
    }

    /// Every call by its addresses.
    pub fn evaluate(&self) -> BTreeMap<String, Call> {
        let mut calls = BTreeMap::new();
        for (i, (name, kind)) in self.nodes.iter().enumerate() {
            if self.along(i) {
                for stem in self.shapes.keys() {
                    self.one(&format!("{name}[{stem}]"), kind, Some(stem), &mut calls);
                }
            } else {
                self.one(name, kind, None, &mut calls);
            }
        }
        calls
    }

    fn one(&self, address: &str, kind: &Kind, stem: Option<&str>, calls: &mut BTreeMap<String, Call>) {
        let at = |x: usize| match stem {
            Some(stem) if self.along(x) => format!("{}[{stem}]", self.nodes[x].0),
            _ => self.nodes[x].0.clone(),
        };
        let scale = |factor: i8| (format!("scale v{} {factor}", self.version), f64::from(factor));
        let call = match kind {
            Kind::Read(file) => self.read(FILES[*file], &self.files[*file]),
            Kind::Each => {
                let stem = stem.unwrap_or_default();
                self.read(&format!("{stem}.txt"), &self.shapes[stem])
            }
            Kind::Scale(x, factor) => {
                let (name, factor) = scale(self.set.unwrap_or(*factor));
                computed(&name, &[("", at(*x))], calls, |v| v[0].iter().map(|x| x * factor).collect())
            }
            Kind::Sign(x) => computed("sign", &[("", at(*x))], calls, |v| v[0].iter().map(|x| x.signum()).collect()),
            Kind::Wide(x) => computed("wide", &[("", at(*x))], calls, |v| v[0].iter().map(|x| x * x / 3.0).collect()),
            Kind::Sum(terms) => {
                let labels: Vec<_> = (0..terms.len()).map(|i| i.to_string()).collect();
                let wires: Vec<_> = labels.iter().map(String::as_str).zip(terms.iter().map(|x| at(*x))).collect();
                computed("sum", &wires, calls, sum)
            }
            Kind::All(x) => {
                let name = &self.nodes[*x].0;
                let wires: Vec<_> = self.shapes.keys().map(|stem| (*stem, format!("{name}[{stem}]"))).collect();
                computed("sum", &wires, calls, sum)
            }
            Kind::Sub(x) => {
                let (name, factor) = scale(self.sub_factor);
                let s = computed(&name, &[("", at(*x))], calls, |v| v[0].iter().map(|x| x * factor).collect());
                let inside = format!("{address}/s");
                calls.insert(inside.clone(), s);
                let t = computed("sum", &[("0", inside), ("1", at(*x))], calls, sum);
                calls.insert(format!("{address}/t"), t.clone());
                t
            }
        };
        calls.insert(address.to_owned(), call);
    }

    fn read(&self, name: &str, content: &str) -> Call {
        let (mut values, mut defects, mut reads, mut fails) = (Vec::new(), Vec::new(), BTreeSet::new(), false);
        let beside = |name: &str| FILES.iter().position(|file| *file == name).map(|i| self.files[i].clone());
        for line in content.lines() {
            if fails {
                break;
            }
            if let Some(other) = line.strip_prefix("include ").or_else(|| line.strip_prefix("maybe ")) {
                let found = beside(other);
                reads.insert(format!("{other}: {found:?}"));
                if line.starts_with("maybe") {
                    values.push(f64::from(u8::from(found.is_some())));
                } else {
                    let found = found.unwrap_or_default();
                    values.extend(found.lines().filter_map(|x| x.parse::<f64>().ok()));
                }
            } else if line == "?" {
                defects.push(values.len() as u32);
            } else {
                line.parse().map_or_else(|_| fails = true, |x| values.push(x));
            }
        }
        let mut identity = format!("read {:?} {content:?}", name.rsplit('.').next());
        let _ = write!(identity, " {reads:?}");
        let output = (!fails).then(|| (bits(&values), defects));
        Call { identity: Some(identity), output, inputs: vec![] }
    }
}

fn kind(dice: &mut Dice, below: usize) -> Kind {
    let x = dice.roll(below);
    match dice.roll(12) {
        0 | 1 => Kind::Read(dice.roll(3)),
        2 => Kind::Each,
        3..=5 => Kind::Scale(x, dice.roll(5) as i8 - 2),
        6 => Kind::Sign(x),
        7 => Kind::Wide(x),
        8 => Kind::Sub(x),
        9 => Kind::All(x),
        _ => Kind::Sum((0..=dice.roll(3)).map(|_| dice.roll(below)).collect()),
    }
}

/// -0.0 is written as 0.0.
fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|x| (x + 0.0).to_bits()).collect()
}

fn sum(values: &[Vec<f64>]) -> Vec<f64> {
    vec![values.iter().flatten().sum()]
}

fn computed(
    name: &str,
    wires: &[(&str, String)],
    calls: &BTreeMap<String, Call>,
    compute: impl Fn(&[Vec<f64>]) -> Vec<f64>,
) -> Call {
    let inputs: Vec<_> = wires.iter().map(|(_, from)| from.clone()).collect();
    let given: Option<Vec<&Output>> = inputs.iter().map(|from| calls[from].output.as_ref()).collect();
    let Some(given) = given else { return Call { identity: None, output: None, inputs } };
    let labelled: Vec<_> = wires.iter().map(|(label, _)| label).zip(&given).collect();
    let identity = format!("{name} of {labelled:?}");
    let values: Vec<Vec<f64>> = given.iter().map(|(x, _)| x.iter().map(|x| f64::from_bits(*x)).collect()).collect();
    let values = compute(&values);
    // What cannot be written is a failure.
    let output = values.iter().all(|x| x.is_finite()).then(|| (bits(&values), vec![]));
    Call { identity: Some(identity), output, inputs }
}
