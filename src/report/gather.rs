//! From recorded runs to a scene: what every node's output shows, on which surface.
//!
//! No stage is known by name. An artefact says what can be seen of it ([`salient_sdk::View`]); the surface is that of the
//! nearest mesh upward. What was gathered for one scene is kept for the next, so that a watch repeats only what changed.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use salient_sdk::Mesh;
use salient_sdk::view::{Chart, Links, Verdicts};

use super::blobs::Blobs;
use super::scene::{
    ChartScene, FieldScene, LinkPair, LinkScene, LinkSetScene, NodeScene, PointScene, RegionScene, Scene, SideScene,
    Surface,
};
use super::surface::Displayed;
use crate::compare::{Library, Side};
use crate::engine::{CacheError, Digest};

/// How many nodes of a side are shown; of larger graphs the results and what is nearest upward of them.
const MOST_NODES: usize = 1500;
/// How many bytes of functions a scene holds; further ones are left out.
const MOST_BYTES: usize = 192 << 20;

/// Gathers scenes.
pub struct Gatherer {
    /// How many vertices of a surface are displayed.
    detail: usize,
    surfaces: BTreeMap<Digest, Arc<(Displayed, Blobs)>>,
    parts: BTreeMap<(Digest, Option<Digest>), Arc<Part>>,
}

/// What one output shows.
#[derive(Default)]
struct Part {
    summary: Vec<(&'static str, String)>,
    fields: Vec<FieldScene>,
    points: Option<PointScene>,
    links: Option<Links>,
    verdicts: Option<Verdicts>,
    charts: Vec<Chart>,
    blobs: Blobs,
    /// Functions were left out.
    cut: bool,
}

/// A scene in the making.
#[derive(Default)]
struct Making {
    surfaces: Vec<Surface>,
    places: Vec<Arc<(Displayed, Blobs)>>,
    index: BTreeMap<Digest, usize>,
    blobs: Blobs,
    used: BTreeSet<(Digest, Option<Digest>)>,
    lost: usize,
    cut: usize,
}

impl Gatherer {
    /// Displays at most so many vertices of a surface.
    #[must_use]
    pub fn new(detail: usize) -> Self {
        Self { detail, surfaces: BTreeMap::new(), parts: BTreeMap::new() }
    }

    /// What the sides show; `head` has all that does not come from artefacts, and gets the rest.
    pub fn gather(&mut self, sides: &[Side], library: &Library, mut head: Scene) -> Result<(Scene, Blobs), CacheError> {
        let mut making = Making::default();
        for side in sides {
            head.sides.push(self.side(side, library, &mut making)?);
        }
        self.surfaces.retain(|digest, _| making.index.contains_key(digest));
        self.parts.retain(|key, _| making.used.contains(key));
        let simplified = making.surfaces.iter().filter(|it| it.source.is_some()).count();
        if simplified > 0 {
            let of = making.surfaces.len();
            let most = self.detail;
            head.notes.push(format!(
                "{simplified} of {of} surfaces are shown simplified to about {most} vertices; functions are taken at the nearest vertex"
            ));
        }
        if making.cut > 0 {
            head.notes.push(format!("functions of {} outputs are left out: the page would be too large", making.cut));
        }
        if making.lost > 0 {
            head.notes.push(format!("{} outputs are not in the cache any more", making.lost));
        }
        for (side, scene) in sides.iter().zip(&head.sides) {
            if scene.nodes.len() < side.calls.len() {
                let (shown, all) = (scene.nodes.len(), side.calls.len());
                head.notes
                    .push(format!("{shown} of {all} nodes of {} are shown, those nearest to the results", side.name));
            }
        }
        head.surfaces = making.surfaces;
        Ok((head, making.blobs))
    }

    fn side(&mut self, side: &Side, library: &Library, making: &mut Making) -> Result<SideScene, CacheError> {
        let calls = chosen(side);
        let index: BTreeMap<usize, usize> = calls.iter().enumerate().map(|(i, call)| (*call, i)).collect();
        let mut scene = SideScene { name: side.name.clone(), ..SideScene::default() };
        let mut links: Vec<(usize, Links)> = Vec::new();
        let mut verdicts: Vec<(usize, Verdicts)> = Vec::new();
        for (i, call) in calls.iter().enumerate() {
            let surface = self.surface(side, *call, library, making)?;
            let part = self.part(side, *call, surface, library, making)?;
            scene.nodes.push(node(side, *call, &index, part.as_deref(), surface.map(|(at, _)| at)));
            let (Some(part), at) = (part, surface.map_or(0, |(at, _)| at)) else { continue };
            making.cut += usize::from(part.cut);
            scene.fields.extend(part.fields.iter().map(|it| FieldScene { node: i, surface: at, ..it.clone() }));
            scene.points.extend(part.points.iter().map(|it| PointScene { node: i, surface: at, ..it.clone() }));
            scene.charts.extend(part.charts.iter().map(|chart| ChartScene { node: i, chart: chart.clone() }));
            links.extend(part.links.iter().map(|it| (i, it.clone())));
            verdicts.extend(part.verdicts.iter().map(|it| (i, it.clone())));
        }
        inherit(side, &calls, &mut scene);
        for (i, it) in links {
            let wired = it.ports.map(|port| input(side, calls[i], port));
            let [Some(left), Some(right)] = wired else { continue };
            let mut end = |from| Ok::<_, CacheError>(self.surface(side, from, library, making)?.map(|(at, _)| at));
            let (Some(one), Some(other)) = (end(left)?, end(right)?) else { continue };
            let ends = [one, other];
            let points = [left, right].map(|from| index.get(&from).copied());
            let judge = verdicts.iter().find(|(node, it)| input(side, calls[*node], it.port) == Some(calls[i]));
            scene.links.push(linked(i, &it, ends, points, judge.or_else(|| about(&verdicts, &it)), &making.places));
        }
        let shown = side.shown.iter().filter_map(|(address, call)| Some(((*address).to_owned(), *index.get(call)?)));
        scene.shown = shown.collect();
        Ok(scene)
    }

    /// The surface that a call makes or rests on, in the list of the scene, and its digest.
    fn surface(
        &mut self,
        side: &Side,
        call: usize,
        library: &Library,
        making: &mut Making,
    ) -> Result<Option<(usize, Digest)>, CacheError> {
        let Some(made) = side.surface(call) else { return Ok(None) };
        let Some(digest) = side.call(made).digest else { return Ok(None) };
        if let Some(at) = making.index.get(&digest) {
            return Ok(Some((*at, digest)));
        }
        let known = self.surfaces.get(&digest).cloned();
        let displayed = match known {
            Some(known) => known,
            None => {
                let artefact = library.artefact(side, made)?;
                let Some(mesh) = artefact.and_then(|it| it.into_any().downcast::<Mesh>().ok()) else {
                    return Ok(None);
                };
                let mut blobs = Blobs::default();
                let displayed = Displayed::new(&mesh, self.detail, &mut blobs);
                let displayed = Arc::new((displayed, blobs));
                self.surfaces.insert(digest, displayed.clone());
                displayed
            }
        };
        let at = making.surfaces.len();
        making.index.insert(digest, at);
        making.surfaces.push(Surface { name: side.name_of(made).to_owned(), ..displayed.0.surface.clone() });
        making.blobs.join(&displayed.1);
        making.places.push(displayed);
        Ok(Some((at, digest)))
    }

    /// What a call's output shows.
    fn part(
        &mut self,
        side: &Side,
        call: usize,
        surface: Option<(usize, Digest)>,
        library: &Library,
        making: &mut Making,
    ) -> Result<Option<Arc<Part>>, CacheError> {
        let Some(digest) = side.call(call).digest else { return Ok(None) };
        let key = (digest, surface.map(|(_, digest)| digest));
        let known = self.parts.get(&key).cloned();
        let part = match known {
            Some(known) => known,
            None => {
                let Some(artefact) = library.artefact(side, call)? else {
                    making.lost += 1;
                    return Ok(None);
                };
                let on = surface.map(|(at, _)| &making.places[at].0);
                let room = MOST_BYTES.saturating_sub(making.blobs.bytes());
                Arc::new(part(artefact.as_ref(), on, room))
            }
        };
        making.used.insert(key);
        making.blobs.join(&part.blobs);
        self.parts.insert(key, part.clone());
        Ok(Some(part))
    }
}

/// The calls of a side that are shown, producers before consumers.
fn chosen(side: &Side) -> Vec<usize> {
    if side.calls.len() <= MOST_NODES {
        return side.calls.iter().map(|(call, _)| *call).collect();
    }
    let mut left: VecDeque<usize> = side.shown.iter().map(|(_, call)| *call).collect();
    let mut seen = BTreeSet::new();
    while let Some(call) = left.pop_front() {
        if seen.len() < MOST_NODES && seen.insert(call) {
            left.extend(side.call(call).inputs.iter().map(|(_, _, from)| *from));
        }
    }
    // Calls are numbered producers first.
    seen.into_iter().collect()
}

/// The call that is wired to a port; the first of several.
fn input(side: &Side, call: usize, port: &str) -> Option<usize> {
    side.call(call).inputs.iter().find(|(name, ..)| name == port).map(|(_, _, from)| *from)
}

fn node(
    side: &Side,
    call: usize,
    index: &BTreeMap<usize, usize>,
    part: Option<&Part>,
    surface: Option<usize>,
) -> NodeScene {
    let (it, kind) = (side.call(call), side.kind(call));
    let inputs = it.inputs.iter().map(|(port, label, from)| (port.clone(), label.clone(), index.get(from).copied()));
    NodeScene {
        address: side.name_of(call).to_owned(),
        kind: kind.name.clone(),
        output: kind.output.clone(),
        outcome: it.outcome.name(),
        seconds: it.seconds,
        bytes: it.bytes,
        key: it.key.map(|key| key.short()),
        digest: it.digest.map(|digest| digest.to_string()),
        params: side.body.params[it.params].clone(),
        files: it.files.iter().map(|(param, file)| (param.clone(), file.path.clone())).collect(),
        inputs: inputs.collect(),
        defects: it.defects.iter().map(ToString::to_string).collect(),
        message: it.message.clone(),
        why: side.body.why(call).iter().map(ToString::to_string).collect(),
        summary: part.map(|part| part.summary.clone()).unwrap_or_default(),
        surface,
    }
}

/// What an output shows, functions only as far as there is room.
fn part(artefact: &dyn salient_sdk::AnyArtefact, on: Option<&Displayed>, room: usize) -> Part {
    let view = artefact.view();
    let mut part = Part { summary: artefact.summary(), charts: view.charts, ..Part::default() };
    (part.links, part.verdicts) = (view.links, view.verdicts);
    let Some(on) = on else { return part };
    for fields in &view.fields {
        if part.blobs.bytes() + 2 * fields.levels.len() * on.surface.vertices > room {
            part.cut = true;
            continue;
        }
        part.fields.extend(on.fields(fields, &mut part.blobs));
    }
    part.points = view.points.map(|points| {
        let places = points.points.iter().map(|p| on.place(p.vertex).unwrap_or_default());
        let sizes = points.regions.iter().map(|r| [r.vertices.len(), r.faces.len()]).collect();
        let regions = (!points.regions.is_empty()).then(|| RegionScene {
            kinds: points.regions.iter().map(|r| r.kind).collect(),
            sizes,
            positions: part.blobs.floats(points.regions.iter().flat_map(|r| r.vertices.as_flattened())),
            triangles: part.blobs.integers(points.regions.iter().flat_map(|r| r.faces.as_flattened())),
        });
        PointScene {
            node: 0,
            surface: 0,
            at: places.collect(),
            profiles: points.profiles.iter().map(|p| p.ok().map(<[f64]>::to_vec)).collect(),
            lacking: points.profiles.iter().map(|p| p.err().map(str::to_owned)).collect(),
            regions,
            points: points.points,
        }
    });
    part
}

/// Gives every set of points the regions and descriptors of equal points upward of it.
fn inherit(side: &Side, calls: &[usize], scene: &mut SideScene) {
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

/// Verdicts on the pairs of these links, though of another node's output: a match that was exchanged with its twin.
fn about<'a>(verdicts: &'a [(usize, Verdicts)], links: &Links) -> Option<&'a (usize, Verdicts)> {
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
    judge: Option<&(usize, Verdicts)>,
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
