//! From recorded runs to a scene: what every node's output shows, on which surface.
//!
//! No stage is known by name. An artefact says what can be seen of it ([`salient_sdk::View`]); the surface is that of the
//! nearest mesh upward. What was gathered for one scene is kept for the next, so that a watch repeats only what changed.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use salient_sdk::Mesh;

use super::blobs::Blobs;
use super::part::Part;
use super::relate::{ends, inherit, links, rankings};
use super::scene::{ChartScene, FieldScene, NodeScene, PointScene, Scene, SideScene, Surface};
use super::surface::Displayed;
use crate::compare::{Library, Side};
use crate::engine::{CacheError, Digest};

/// How many nodes of a side are shown; of larger graphs the results and what is nearest upward of them.
const MOST_NODES: usize = 1500;
/// How many bytes of functions a scene holds; further ones are left out.
const MOST_BYTES: usize = 192 << 20;
/// Surfaces of a scene that are shown with all that is known of them. Where there are more they share the vertices that
/// so many may have, and are shown without functions and patches.
const MANY_SURFACES: usize = 24;
/// So many vertices a surface has in any case.
const LEAST_DETAIL: usize = 1000;
/// Where there are many surfaces, larger outputs than this are not looked into unless they are results.
const LARGE: u64 = 2 << 20;

/// Gathers scenes.
pub struct Gatherer {
    /// How many vertices of a surface are displayed.
    detail: usize,
    surfaces: BTreeMap<Digest, Arc<(Displayed, Blobs)>>,
    parts: BTreeMap<(Digest, Option<Digest>), Arc<Part>>,
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
    /// There are more surfaces than are shown in full.
    many: bool,
    detail: usize,
}

impl Gatherer {
    /// Displays at most so many vertices of a surface.
    #[must_use]
    pub fn new(detail: usize) -> Self {
        Self { detail, surfaces: BTreeMap::new(), parts: BTreeMap::new() }
    }

    /// What the sides show; `head` has all that does not come from artefacts, and gets the rest.
    pub fn gather(&mut self, sides: &[Side], library: &Library, mut head: Scene) -> Result<(Scene, Blobs), CacheError> {
        let meshes = count_meshes(sides);
        let many = meshes > MANY_SURFACES;
        let share = (self.detail * MANY_SURFACES / meshes.max(1)).max(LEAST_DETAIL);
        let detail = if many { self.detail.min(share) } else { self.detail };
        let mut making = Making { many, detail, ..Making::default() };
        for side in sides {
            head.sides.push(self.side(side, library, &mut making)?);
        }
        self.surfaces.retain(|digest, _| making.index.contains_key(digest));
        self.parts.retain(|key, _| making.used.contains(key));
        let simplified = making.surfaces.iter().filter(|it| it.source.is_some()).count();
        if simplified > 0 {
            let of = making.surfaces.len();
            let most = detail;
            head.notes.push(format!(
                "{simplified} of {of} surfaces are shown simplified to about {most} vertices; functions are taken at the nearest vertex"
            ));
        }
        if many {
            head.notes.push(format!("functions and patches are left out, as there are {meshes} meshes"));
        } else if making.cut > 0 {
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
        let mut parts = Vec::new();
        for (i, call) in calls.iter().enumerate() {
            let surface = self.surface(side, *call, library, making)?;
            let part = self.part(side, *call, surface, library, making)?;
            scene.nodes.push(node(side, *call, &index, part.as_deref(), surface.map(|(at, _)| at)));
            let (Some(part), at) = (part, surface.map_or(0, |(at, _)| at)) else { continue };
            making.cut += usize::from(part.cut);
            scene.fields.extend(part.fields.iter().map(|it| FieldScene { node: i, surface: at, ..it.clone() }));
            scene.points.extend(part.points.iter().map(|it| PointScene { node: i, surface: at, ..it.clone() }));
            scene.charts.extend(part.charts.iter().map(|chart| ChartScene { node: i, chart: chart.clone() }));
            parts.push((i, part));
        }
        inherit(side, &calls, &mut scene);
        let mut place = |call: usize| Ok(self.surface(side, call, library, making)?.map(|(at, _)| at));
        let ends = ends(side, &calls, &parts, &mut place)?;
        scene.rankings = rankings(side, &calls, &parts, &mut place)?;
        scene.links = links(&calls, &parts, side, &ends, &making.places);
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
        let displayed = if let Some(known) = known {
            known
        } else {
            let artefact = library.artefact(side, made)?;
            let Some(mesh) = artefact.and_then(|it| it.into_any().downcast::<Mesh>().ok()) else {
                return Ok(None);
            };
            let mut blobs = Blobs::default();
            let displayed = Displayed::new(&mesh, making.detail, &mut blobs);
            let displayed = Arc::new((displayed, blobs));
            self.surfaces.insert(digest, displayed.clone());
            displayed
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
        let is_large = side.call(call).bytes.is_some_and(|bytes| bytes > LARGE);
        if making.many && is_large && !side.shown.iter().any(|(_, shown)| *shown == call) {
            return Ok(None);
        }
        let key = (digest, surface.map(|(_, digest)| digest));
        let known = self.parts.get(&key).cloned();
        let part = if let Some(known) = known {
            known
        } else {
            let Some(artefact) = library.artefact(side, call)? else {
                making.lost += 1;
                return Ok(None);
            };
            let on = surface.map(|(at, _)| &making.places[at].0);
            let room = if making.many { 0 } else { MOST_BYTES.saturating_sub(making.blobs.bytes()) };
            Arc::new(Part::new(artefact.as_ref(), on, room))
        };
        making.used.insert(key);
        making.blobs.join(&part.blobs);
        self.parts.insert(key, part.clone());
        Ok(Some(part))
    }
}

/// How many different meshes there are.
fn count_meshes(sides: &[Side]) -> usize {
    let digests = |side: &Side| -> Vec<Digest> {
        let meshes = side.calls.iter().filter(|(call, _)| side.surface(*call) == Some(*call));
        meshes.filter_map(|(call, _)| side.call(*call).digest).collect()
    };
    sides.iter().flat_map(digests).collect::<BTreeSet<_>>().len()
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
