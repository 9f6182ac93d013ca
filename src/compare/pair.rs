//! Two sides: the first node at which they part, and the differences that follow.

use std::collections::{BTreeMap, BTreeSet};

use salient_sdk::Difference;
use serde::Serialize;

use super::library::Library;
use super::side::Side;
use crate::engine::CacheError;
use crate::engine::history::RunOutcome;
use crate::engine::why::{Cause, own_changes};

/// Where two sides differ.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Name of the first side.
    pub left: String,
    /// Name of the second side.
    pub right: String,
    /// Nodes at which they part: all that they are given is equal, but they are not. The one nearest to the first
    /// inputs comes first; those whose outputs are equal all the same come last.
    pub diverging: Vec<Divergence>,
    /// How many nodes have equal outputs.
    pub equal: usize,
    /// How many failed or were skipped on both sides.
    pub absent: usize,
    /// Nodes whose outputs differ, producers before consumers.
    pub nodes: Vec<NodeDifference>,
    /// Addresses that only the first side has.
    pub only_left: Vec<String>,
    /// Addresses that only the second side has.
    pub only_right: Vec<String>,
}

/// A node at which two sides part.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Divergence {
    /// Its address.
    pub node: String,
    /// Its kind.
    pub kind: String,
    /// What differs, `before` on the first side and `now` on the second; empty if nothing that is known.
    pub causes: Vec<Cause>,
    /// Whether its output differs: a param may be without effect.
    pub effect: bool,
}

/// A node whose outputs differ.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NodeDifference {
    /// Its address.
    pub node: String,
    /// Its kind.
    pub kind: String,
    /// Type of its output.
    #[serde(rename = "type")]
    pub output: String,
    /// How they differ, as the type has it; `None` if that was not looked at, or an output is not there.
    pub differences: Option<Vec<Difference>>,
    /// Why there are no differences to show.
    pub note: Option<String>,
}

/// How many differing nodes are looked into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Depth {
    /// All.
    All,
    /// So many of each kind, and all results.
    PerKind(usize),
}

/// Compares two sides.
pub fn compare(left: &Side, right: &Side, depth: Depth, library: &Library) -> Result<Comparison, CacheError> {
    let pairs = paired(left, right);
    let mut it = Comparison {
        left: left.name.clone(),
        right: right.name.clone(),
        diverging: Vec::new(),
        equal: 0,
        absent: 0,
        nodes: Vec::new(),
        only_left: only(left, right),
        only_right: only(right, left),
    };
    let mut roots = Vec::new();
    let mut looked: BTreeMap<&str, usize> = BTreeMap::new();
    let results: BTreeSet<usize> = left.shown.iter().map(|(_, call)| *call).collect();
    for (address, l, r) in &pairs {
        let (a, b) = (left.call(*l), right.call(*r));
        let differs = a.digest != b.digest || (a.digest.is_none() && a.outcome != b.outcome);
        if let Some(divergence) = divergence([left, right], [*l, *r], address, differs, library)? {
            // What has no effect is not where they part.
            roots.push((!divergence.effect, left.depth(*l), *l, divergence));
        }
        if !differs {
            *if a.digest.is_some() { &mut it.equal } else { &mut it.absent } += 1;
            continue;
        }
        let kind = left.kind(*l);
        let seen = looked.entry(kind.name.as_str()).or_default();
        *seen += 1;
        let wanted = match depth {
            Depth::All => true,
            Depth::PerKind(most) => *seen <= most || results.contains(l),
        };
        let (differences, note) = if wanted { look([left, right], [*l, *r], library)? } else { (None, None) };
        it.nodes.push(NodeDifference {
            node: (*address).to_owned(),
            kind: kind.name.clone(),
            output: kind.output.clone(),
            differences,
            note,
        });
    }
    roots.sort_by_key(|(idle, depth, call, _)| (*idle, *depth, *call));
    it.diverging = roots.into_iter().map(|(_, _, _, divergence)| divergence).collect();
    Ok(it)
}

/// Calls of one address: the address, and both calls, each pair once.
fn paired<'a>(left: &Side<'a>, right: &Side<'a>) -> Vec<(&'a str, usize, usize)> {
    let (mut pairs, mut seen) = (Vec::new(), BTreeSet::new());
    for (call, _) in &left.calls {
        for address in left.addresses_of(*call) {
            if let Some(other) = right.addresses.get(address)
                && seen.insert((*call, *other))
            {
                pairs.push((address, *call, *other));
            }
        }
    }
    pairs
}

/// First addresses of calls of which the other side has no address.
fn only(side: &Side, other: &Side) -> Vec<String> {
    let mut shared = BTreeSet::new();
    for (address, call) in &side.addresses {
        if other.addresses.contains_key(address) {
            shared.insert(*call);
        }
    }
    side.calls.iter().filter(|(call, _)| !shared.contains(call)).map(|(_, address)| (*address).to_owned()).collect()
}

/// Whether two sides part at this node, and at what.
fn divergence(
    sides: [&Side; 2],
    calls: [usize; 2],
    address: &str,
    differs: bool,
    library: &Library,
) -> Result<Option<Divergence>, CacheError> {
    let [then, now] = [0, 1].map(|i| sides[i].call(calls[i]));
    let [kind, other] = [0, 1].map(|i| sides[i].kind(calls[i]));
    // Equal without looking further: nearly all nodes of two variants.
    if !differs && then.key.is_some() && then.key == now.key {
        return Ok(None);
    }
    let mut causes = if (kind, &then.files) == (other, &now.files)
        && sides[0].body.params[then.params] == sides[1].body.params[now.params]
    {
        Vec::new()
    } else {
        own_changes(&sides[0].ingredients(calls[0]), &sides[1].ingredients(calls[1]))
    };
    causes.extend(rewired(sides, calls));
    if causes.is_empty() {
        let input =
            |side: usize| sides[side].call(calls[side]).inputs.iter().map(move |(_, _, from)| sides[side].call(*from));
        let upstream = input(0).zip(input(1)).any(|(a, b)| a.digest.is_none() || a.digest != b.digest);
        if !differs || upstream {
            return Ok(None);
        }
        if let (Some(key), true) = (then.key, then.key == now.key) {
            causes.extend(reads(library, &key, [then.digest, now.digest])?);
        }
    }
    Ok(Some(Divergence { node: address.to_owned(), kind: kind.name.clone(), causes, effect: differs }))
}

/// Files discovered by equal calls that differ.
fn reads(
    library: &Library,
    key: &crate::engine::Digest,
    digests: [Option<crate::engine::Digest>; 2],
) -> Result<Vec<Cause>, CacheError> {
    let records = library.cache().records(key)?.0;
    let of = |digest: Option<crate::engine::Digest>| records.iter().find(|r| Some(r.digest) == digest);
    let [Some(then), Some(now)] = digests.map(of) else { return Ok(Vec::new()) };
    let changed = now.reads.iter().filter(|read| !then.reads.contains(read));
    Ok(changed.map(|read| Cause::Read { param: read.param.clone(), beside: read.beside.clone() }).collect())
}

/// Ports that are fed by other nodes.
fn rewired(sides: [&Side; 2], calls: [usize; 2]) -> Vec<Cause> {
    let [one, other] = [0, 1].map(|i| &sides[i].call(calls[i]).inputs);
    let ports: BTreeSet<&str> = one.iter().chain(other).map(|(port, _, _)| port.as_str()).collect();
    let mut causes = Vec::new();
    for port in ports {
        let [before, now] = [one, other].map(|inputs| inputs.iter().filter(|(p, _, _)| p == port).collect::<Vec<_>>());
        let labels = before.iter().map(|(_, label, _)| label).eq(now.iter().map(|(_, label, _)| label));
        let same = |(a, b): (&&(String, String, usize), &&(String, String, usize))| {
            let (x, y) = (sides[0].call(a.2), sides[1].call(b.2));
            (x.digest.is_some() && x.digest == y.digest) || counterparts(sides, a.2, b.2)
        };
        if !labels || !before.iter().zip(&now).all(same) {
            let names = |side: usize, of: &[&(String, String, usize)]| -> Vec<String> {
                of.iter().map(|(_, _, from)| sides[side].name_of(*from).to_owned()).collect()
            };
            causes.push(Cause::Rewired { port: port.to_owned(), before: names(0, &before), now: names(1, &now) });
        }
    }
    causes
}

/// Whether two calls have an address in common.
fn counterparts(sides: [&Side; 2], one: usize, other: usize) -> bool {
    sides[0].addresses_of(one).any(|address| sides[1].addresses.get(address) == Some(&other))
}

/// How two outputs differ, or why that cannot be told.
fn look(
    sides: [&Side; 2],
    calls: [usize; 2],
    library: &Library,
) -> Result<(Option<Vec<Difference>>, Option<String>), CacheError> {
    for (side, call) in sides.iter().zip(calls) {
        let it = side.call(call);
        if it.digest.is_none() {
            let message = it.message.as_ref().map(|message| format!(": {message}")).unwrap_or_default();
            let what = match it.outcome {
                RunOutcome::Skipped => "was skipped because of",
                outcome => outcome.name(),
            };
            return Ok((None, Some(format!("{what}{message} ({})", side.name))));
        }
    }
    let [one, other] = [library.artefact(sides[0], calls[0])?, library.artefact(sides[1], calls[1])?];
    let (Some(one), Some(other)) = (one, other) else {
        return Ok((None, Some("an output is not in the cache any more".into())));
    };
    let surfaces = library.surfaces(sides, calls)?;
    Ok(match one.differences(other.as_ref(), &surfaces) {
        Some(differences) if differences.is_empty() => {
            (Some(differences), Some("other bytes, but no difference in figures".into()))
        }
        Some(differences) => (Some(differences), None),
        None => (None, Some(format!("a `{}` and a `{}`", one.type_name(), other.type_name()))),
    })
}
