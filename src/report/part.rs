//! What one output shows, ready for a scene but for its place in it.

use salient_sdk::AnyArtefact;
use salient_sdk::view::{Chart, Classes, Links, Rankings, Verdicts};

use super::blobs::Blobs;
use super::scene::{FieldScene, PointScene, RegionScene};
use super::surface::Displayed;

/// What one output shows.
#[derive(Default)]
pub struct Part {
    pub summary: Vec<(&'static str, String)>,
    pub fields: Vec<FieldScene>,
    pub points: Option<PointScene>,
    pub links: Option<Links>,
    pub verdicts: Option<Verdicts>,
    pub rankings: Option<Rankings>,
    pub classes: Option<Classes>,
    pub charts: Vec<Chart>,
    pub blobs: Blobs,
    /// Functions were left out.
    pub cut: bool,
}

impl Part {
    /// Functions and regions only as far as there is room.
    pub fn new(artefact: &dyn AnyArtefact, on: Option<&Displayed>, room: usize) -> Self {
        let view = artefact.view();
        let mut part = Self { summary: artefact.summary(), charts: view.charts, ..Self::default() };
        (part.links, part.verdicts) = (view.links, view.verdicts);
        (part.rankings, part.classes) = (view.rankings, view.classes);
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
            let regions = (room > 0 && !points.regions.is_empty()).then(|| RegionScene {
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
}
