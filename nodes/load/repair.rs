//! From the content of a file to a mesh: the repairs that were asked for, and the census of what is left.

use salient_kernels::adjacency::{self, MeshError};
use salient_kernels::topology::{self, Repaired};
use salient_sdk::{Context, Defect, DefectKind, Mesh, NodeError};

use super::raw::Raw;
use super::{Format, Params, Weld};

/// Applies the params' repairs in the order weld, drop degenerate, largest component, drop unreferenced.
pub fn mesh(raw: Raw, format: Format, params: &Params, cx: Context) -> Result<Mesh, NodeError> {
    let name = format.name();
    if raw.vertices.is_empty() || raw.faces.is_empty() {
        let what = if raw.vertices.is_empty() { "vertices" } else { "faces" };
        return Err(NodeError::new(format!("{name}: the file has no {what}")));
    }
    if raw.vertices.len() >= u32::MAX as usize {
        return Err(NodeError::new(format!("{name}: too many vertices for 32-bit indices")));
    }
    let mut work = Work { mesh: Mesh::default() };
    work.mesh.defects.extend(raw.polygons.clone());
    let welds = match params.weld {
        Weld::Auto => matches!(format, Format::Stl | Format::Gltf),
        Weld::Always => true,
        Weld::Never => false,
    };
    let before = raw.vertices.len();
    if welds {
        work.weld(raw, params.weld == Weld::Always, cx)?;
    } else {
        (work.mesh.vertices, work.mesh.faces) = (raw.vertices, raw.faces);
    }
    cx.record("vertices_in_file", before);
    cx.record("welded_vertices", before - work.mesh.vertices.len());
    if params.drop_degenerate {
        work.apply(topology::drop_degenerate, DefectKind::ZeroAreaFace, |c| c.zero_area_faces.clone())?;
    }
    if params.largest_component {
        work.apply(topology::largest_component, DefectKind::SeveralComponents, further_components)?;
    }
    if params.drop_unreferenced {
        work.apply(topology::drop_unreferenced, DefectKind::UnreferencedVertex, |c| c.unreferenced_vertices.clone())?;
    }
    let mut mesh = work.mesh;
    if mesh.faces.is_empty() {
        return Err(NodeError::new(format!("{name}: no face is left after the repairs")));
    }
    cx.check()?;
    mesh.defects.extend(census(&mesh)?);
    mesh.defects.sort_by_key(|d| (d.kind, !d.repaired));
    Ok(mesh)
}

type Repair = fn(&[[f64; 3]], &[[u32; 3]]) -> Result<Repaired, MeshError>;

struct Work {
    mesh: Mesh,
}

impl Work {
    /// Welds by the positions before posing, part by part or across all. Only the latter is reported as a repair:
    /// the former undoes what the format does to every mesh.
    fn weld(&mut self, raw: Raw, across: bool, cx: Context) -> Result<(), NodeError> {
        let whole = [(raw.vertices.len(), raw.faces.len())];
        let parts = if across || raw.parts.is_empty() { &whole[..] } else { &raw.parts };
        let positions = raw.bind.as_ref().unwrap_or(&raw.vertices);
        let (mut faces, mut source) = (Vec::with_capacity(raw.faces.len()), Vec::new());
        let (mut v0, mut f0) = (0, 0);
        for &(v1, f1) in parts {
            let base = v0 as u32;
            let local: Vec<_> = raw.faces[f0..f1].iter().map(|f| f.map(|v| v - base)).collect();
            let welded = topology::weld(&positions[v0..v1], &local).map_err(failed)?;
            let offset = source.len() as u32;
            faces.extend(welded.faces.iter().map(|f| f.map(|v| v + offset)));
            source.extend(welded.source.iter().map(|&v| v + base));
            (v0, f0) = (v1, f1);
        }
        if raw.bind.is_some() {
            cx.record("weld_gap", gap(&raw, &faces, &source));
        }
        let merged = raw.vertices.len() - source.len();
        if merged == 0 {
            (self.mesh.vertices, self.mesh.faces) = (raw.vertices, raw.faces);
            return Ok(());
        }
        if across {
            let kept: std::collections::BTreeSet<u32> = source.iter().copied().collect();
            let gone = (0..raw.vertices.len() as u32).filter(|v| !kept.contains(v));
            let first = gone.take(8).collect();
            let kind = DefectKind::DuplicateVertex;
            self.mesh.defects.push(Defect { kind, count: merged, first, repaired: true });
        }
        self.mesh.vertices = source.iter().map(|&v| raw.vertices[v as usize]).collect();
        self.mesh.faces = faces;
        self.mesh.source = Some(source);
        Ok(())
    }

    /// Applies a repair if the census finds something to repair; its places are given as numbered in the file.
    fn apply(
        &mut self,
        repair: Repair,
        kind: DefectKind,
        found: fn(&topology::Census) -> Vec<u32>,
    ) -> Result<(), NodeError> {
        let mesh = &self.mesh;
        let wrong = found(&topology::census(&mesh.vertices, &mesh.faces).map_err(failed)?);
        if wrong.is_empty() {
            return Ok(());
        }
        let done = repair(&mesh.vertices, &mesh.faces).map_err(failed)?;
        let count = wrong.len();
        // Faces are still numbered as in the file, vertices maybe not.
        let source = mesh.source.as_ref().filter(|_| kind != DefectKind::ZeroAreaFace);
        let in_file = |i: u32| source.map_or(i, |s| s[i as usize]);
        let first = wrong.into_iter().take(8).map(in_file).collect();
        let mut next = if done.source.len() == mesh.vertices.len() {
            Mesh { faces: done.faces, ..std::mem::take(&mut self.mesh) }
        } else {
            mesh.renumbered(done.vertices, done.faces, &done.source)
        };
        next.defects.push(Defect { kind, count, first, repaired: true });
        self.mesh = next;
        Ok(())
    }
}

/// The largest distance between posed positions of vertices that were welded: zero unless their weights differ.
fn gap(raw: &Raw, faces: &[[u32; 3]], source: &[u32]) -> f64 {
    let mut largest: f64 = 0.0;
    for (old, new) in raw.faces.iter().flatten().zip(faces.iter().flatten()) {
        let (p, q) = (raw.vertices[*old as usize], raw.vertices[source[*new as usize] as usize]);
        let d2: f64 = (0..3).map(|k| (p[k] - q[k]) * (p[k] - q[k])).sum();
        largest = largest.max(d2);
    }
    largest.sqrt()
}

/// The lowest vertex of each component with faces, but the first of them.
fn further_components(census: &topology::Census) -> Vec<u32> {
    let mut seen = vec![false; census.components.faces.len()];
    let mut lowest = Vec::new();
    for (v, &label) in census.components.label.iter().enumerate() {
        let label = label as usize;
        if census.components.faces[label] > 0 && !std::mem::replace(&mut seen[label], true) {
            lowest.push(v as u32);
        }
    }
    lowest.drain(..lowest.len().min(1));
    lowest
}

/// What is doubtful about a mesh, in order of kind.
fn census(mesh: &Mesh) -> Result<Vec<Defect>, NodeError> {
    let found = topology::census(&mesh.vertices, &mesh.faces).map_err(failed)?;
    let edges = |list: &[[u32; 2]]| (list.len(), list.iter().take(4).flatten().copied().collect());
    let single = |list: Vec<u32>| (list.len(), list.into_iter().take(8).collect());
    let duplicates = found.duplicate_vertices.iter().map(|[vertex, _]| *vertex).collect();
    let boundary = if found.boundary_edges == 0 {
        Vec::new()
    } else {
        let all = adjacency::edges(mesh.vertices.len(), &mesh.faces).map_err(failed)?;
        let open = (0..all.ends.len()).filter(|&e| all.faces.row(e).len() == 1);
        open.take(4).flat_map(|e| all.ends[e]).collect()
    };
    let kinds: [(DefectKind, (usize, Vec<u32>)); 8] = [
        (DefectKind::NonManifoldEdge, edges(&found.non_manifold_edges)),
        (DefectKind::NonManifoldVertex, single(found.non_manifold_vertices.clone())),
        (DefectKind::InconsistentOrientation, edges(&found.inconsistent_edges)),
        (DefectKind::ZeroAreaFace, single(found.zero_area_faces.clone())),
        (DefectKind::DuplicateVertex, single(duplicates)),
        (DefectKind::UnreferencedVertex, single(found.unreferenced_vertices.clone())),
        (DefectKind::BoundaryEdge, (found.boundary_edges, boundary)),
        (DefectKind::SeveralComponents, single(further_components(&found))),
    ];
    let defects = kinds.into_iter().filter(|(_, (count, _))| *count > 0);
    Ok(defects.map(|(kind, (count, first))| Defect { kind, count, first, repaired: false }).collect())
}

fn failed(error: MeshError) -> NodeError {
    NodeError::new(error.to_string())
}
