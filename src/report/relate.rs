//! What lies between outputs: correspondences and who judges them, rankings, and points with their patches and descriptors.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use salient_sdk::view::{Links, Verdicts};

use super::blobs::Blobs;
use super::part::Part;
use super::scene::{LinkPair, LinkScene, LinkSetScene, ListScene, Ranked, RankingScene, SideScene};
use super::surface::Displayed;
use crate::compare::Side;
use crate::engine::CacheError;

/// The call that is wired to a port; the first of several.
fn input(side: &Side, call: usize, port: &str) -> Option<usize> {
    side.call(call).inputs.iter().find(|(name, ..)| name == port).map(|(_, _, from)| *from)
}

/// Gives every set of points the regions and descriptors of equal points upward of it.
pub fn inherit(side: &Side, calls: &[usize], scene: &mut SideScene) {
    let by_call: BTreeMap<usize, usize> = scene.points.iter().enumerate().map(|(i, it)| (calls[it.node], i)).collect();
    for i in 0..scene.points.len() {
        let (mut left, mut seen) = (VecDeque::from([calls[scene.points[i].node]]), BTreeSet::new());
        while let Some(call) = left.pop_front() {
            if !seen.insert(call) {
                continue;
            }
            left.extend(side.call(call).inputs.iter().map(|(_, _, from)| *from));
            let Some(from) = by_call.get(&call).map(|at| scene.points[*at].clone()) else { continue };
            let own = &mut scene.points[i];
            if from.points != own.points {
                continue;
            }
            if own.regions.is_none() {
                own.regions = from.regions;
            }
            if own.profiles.is_empty() {
                (own.profiles, own.lacking) = (from.profiles, from.lacking);
            }
        }
    }
}

/// A node's index on its side, and what its output shows.
type Shown = (usize, Arc<Part>);
/// The surface that a call makes or rests on, in the list of the scene.
type Place<'a> = dyn FnMut(usize) -> Result<Option<usize>, CacheError> + 'a;

/// For each correspondence the calls at its ports and their surfaces; none if they are not there.
pub fn ends(
    side: &Side,
    calls: &[usize],
    parts: &[Shown],
    place: &mut Place,
) -> Result<BTreeMap<usize, [(usize, usize); 2]>, CacheError> {
    let mut found = BTreeMap::new();
    for (i, part) in parts {
        let Some(links) = &part.links else { continue };
        let [Some(left), Some(right)] = links.ports.map(|port| input(side, calls[*i], port)) else { continue };
        if let (Some(one), Some(other)) = (place(left)?, place(right)?) {
            found.insert(*i, [(left, one), (right, other)]);
        }
    }
    Ok(found)
}

/// The correspondences.
pub fn links(
    calls: &[usize],
    parts: &[Shown],
    side: &Side,
    ends: &BTreeMap<usize, [(usize, usize); 2]>,
    places: &[Arc<(Displayed, Blobs)>],
) -> Vec<LinkScene> {
    let index: BTreeMap<usize, usize> = calls.iter().enumerate().map(|(i, call)| (*call, i)).collect();
    let verdicts: Vec<(usize, &Verdicts)> =
        parts.iter().filter_map(|(i, part)| Some((*i, part.verdicts.as_ref()?))).collect();
    let one = |(i, part): &Shown| {
        let (links, ends) = (part.links.as_ref()?, ends.get(i)?);
        let judges = |(node, it): &&(usize, &Verdicts)| input(side, calls[*node], it.port) == Some(calls[*i]);
        let judge = verdicts.iter().find(judges).or_else(|| about(&verdicts, links));
        let points = ends.map(|(call, _)| index.get(&call).copied());
        Some(linked(*i, links, ends.map(|(_, surface)| surface), points, judge, places))
    };
    parts.iter().filter_map(one).collect()
}

/// The rankings, each name with its surface: that of the call which is wired under this label, anywhere upward.
pub fn rankings(
    side: &Side,
    calls: &[usize],
    parts: &[Shown],
    place: &mut Place,
) -> Result<Vec<RankingScene>, CacheError> {
    let mut all = Vec::new();
    for (i, part) in parts {
        let Some(rankings) = &part.rankings else { continue };
        let classes = parts.iter().filter_map(|(node, part)| Some((*node, part.classes.as_ref()?)));
        let mut mine = classes.filter(|(node, it)| input(side, calls[*node], it.port) == Some(calls[*i]));
        let classes: BTreeMap<&str, &String> =
            mine.next().into_iter().flat_map(|(_, it)| &it.of).map(|(name, class)| (name.as_str(), class)).collect();
        let labels = labels(side, calls[*i]);
        let mut ranked = |name: &str, score: Option<f64>| -> Result<Ranked, CacheError> {
            // Queries come before targets among the ports, where the two are different shapes of one name.
            let call = labels.get(name).map(|(first, last)| if score.is_none() { *first } else { *last });
            let surface = call.map(&mut *place).transpose()?.flatten();
            Ok(Ranked { name: name.to_owned(), score, class: classes.get(name).map(|c| (*c).clone()), surface })
        };
        let mut lists = Vec::new();
        for it in &rankings.queries {
            let found = it.found.iter().map(|(name, score)| ranked(name, Some(*score))).collect::<Result<_, _>>()?;
            lists.push(ListScene { query: ranked(&it.query, None)?, found });
        }
        all.push(RankingScene { node: *i, measure: rankings.measure.clone(), lists });
    }
    Ok(all)
}

/// Labels of wires upward of a call, with the first and the last producer of each that is nearest.
fn labels<'a>(side: &Side<'a>, call: usize) -> BTreeMap<&'a str, (usize, usize)> {
    let (mut labels, mut left, mut seen) = (BTreeMap::new(), VecDeque::from([call]), BTreeSet::from([call]));
    while let Some(call) = left.pop_front() {
        let mut own: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
        for (_, label, from) in &side.call(call).inputs {
            if !label.is_empty() {
                own.entry(label).and_modify(|(_, last)| *last = *from).or_insert((*from, *from));
            }
            if seen.insert(*from) {
                left.push_back(*from);
            }
        }
        for (label, calls) in own {
            labels.entry(label).or_insert(calls);
        }
    }
    labels
}

/// Verdicts on the pairs of these links, though of another node's output: a match that was exchanged with its twin.
fn about<'a, 'b>(verdicts: &'b [(usize, &'a Verdicts)], links: &Links) -> Option<&'b (usize, &'a Verdicts)> {
    let known = |of: &Verdicts| {
        let judged: BTreeSet<[u32; 2]> = of.pairs.iter().map(|it| it.vertices).collect();
        links.sets.iter().any(|set| !set.pairs.is_empty() && set.pairs.iter().all(|p| judged.contains(&p.vertices)))
    };
    verdicts.iter().find(|(_, it)| known(it))
}

fn linked(
    node: usize,
    links: &Links,
    surfaces: [usize; 2],
    points: [Option<usize>; 2],
    judge: Option<&(usize, &Verdicts)>,
    places: &[Arc<(Displayed, Blobs)>],
) -> LinkScene {
    let judged = judge.iter().flat_map(|(_, it)| &it.pairs);
    let errors: BTreeMap<[u32; 2], [Option<f64>; 2]> =
        judged.map(|it| (it.vertices, [it.error, it.symmetric])).collect();
    let pair = |it: &salient_sdk::view::Link| {
        let at = |side: usize| places[surfaces[side]].0.place(it.vertices[side]).unwrap_or_default();
        LinkPair {
            points: it.points,
            vertices: it.vertices,
            at: [at(0), at(1)],
            distance: it.distance,
            error: errors.get(&it.vertices).copied(),
        }
    };
    let set = |it: &salient_sdk::view::LinkSet| LinkSetScene {
        name: it.name.clone(),
        objective: it.objective,
        pairs: it.pairs.iter().map(pair).collect(),
    };
    LinkScene {
        node,
        surfaces,
        points,
        sets: links.sets.iter().map(set).collect(),
        certificate: links.certificate,
        judge: judge.map(|(node, _)| *node),
    }
}
