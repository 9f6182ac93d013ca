//! glTF 2.0 and GLB: the triangles of the default scene, skinned and posed.
//!
//! The `gltf` crate parses and validates the document; accessors are read here, because the crate's own readers panic
//! on accessors of an unexpected type. Source: Khronos Group, glTF 2.0 specification, sections 3.6-3.7 (buffers,
//! geometry, skins) and 3.11 with appendix C (animations).

use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::scene::Node;
use gltf::json::validation::Checked;
use gltf::json::{Index, Root};
use salient_sdk::{Context, NodeError};

use self::accessor::Buffers;
use self::pose::{Matrix, Scene};
use super::raw::{Raw, bad};

mod accessor;
mod animation;
mod pose;

const FORMAT: &str = "glTF";

/// Extensions that a file may require although they are not known: they do not change the surface, or (quantisation)
/// only the component types of accessors, all of which are read.
const HARMLESS: [&str; 5] =
    ["KHR_materials_", "KHR_texture_", "KHR_lights_punctual", "KHR_mesh_quantization", "EXT_texture_"];

/// Reads a glTF or GLB file, posed by a clip's name and a time in seconds.
pub fn read(bytes: &[u8], clip: Option<(&str, f64)>, cx: Context) -> Result<Raw, NodeError> {
    let (root, blob) = parse(bytes)?;
    let buffers = Buffers::resolve(&root, blob, cx)?;
    let mut scene = Scene::new(&root)?;
    // Which side of a mirrored node is out is a matter of its rest pose, so that poses have equal faces.
    let mut rest = Scene::new(&root)?;
    rest.place(&root)?;
    if let Some((name, time)) = clip {
        animation::apply(&mut scene, &root, &buffers, name, time)?;
    }
    scene.place(&root)?;
    let mut raw = Raw { bind: Some(Vec::new()), ..Raw::default() };
    for node in Scene::drawn(&root)? {
        cx.check()?;
        let instance = Instance::new(&root, &buffers, &scene, &rest, node)?;
        instance.add(&mut raw)?;
        raw.parts.push((raw.vertices.len(), raw.faces.len()));
    }
    Ok(raw)
}

fn parse(bytes: &[u8]) -> Result<(Root, Option<Vec<u8>>), NodeError> {
    if bytes.starts_with(b"glTF") {
        let length = bytes.get(8..12).map_or(0, |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        if (length as usize) < 20 || length as usize != bytes.len() {
            let n = bytes.len();
            return Err(bad(FORMAT, "byte 8", format_args!("the header says {length} bytes, the file has {n}")));
        }
    }
    let file = gltf::Gltf::from_slice_without_validation(bytes)
        .map_err(|e| bad(FORMAT, "document", format_args!("cannot be parsed: {e}")))?;
    let mut root = file.document.into_json();
    root.extensions_required.retain(|name| !HARMLESS.iter().any(|known| name.starts_with(known)));
    // The crate's own validation panics on these.
    for (m, mesh) in root.meshes.iter().enumerate() {
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            let missing = primitive.attributes.values().find(|a| a.value() >= root.accessors.len());
            if let Some(index) = missing {
                let place = format!("mesh {m}, primitive {p}");
                return Err(bad(FORMAT, place, format_args!("names accessor {}, which is not there", index.value())));
            }
        }
    }
    let document = gltf::Document::from_json(root).map_err(|e| match e {
        gltf::Error::Validation(errors) => {
            let list: Vec<_> = errors.iter().take(3).map(|(path, e)| format!("{path}: {e}")).collect();
            bad(FORMAT, "document", list.join("; "))
        }
        other => bad(FORMAT, "document", other),
    })?;
    Ok((document.into_json(), file.blob))
}

/// A mesh as a node draws it.
struct Instance<'a> {
    root: &'a Root,
    buffers: &'a Buffers,
    mesh: &'a gltf::json::Mesh,
    mesh_index: usize,
    /// Weights of the morph targets.
    morph: Vec<f64>,
    transform: Matrix,
    rest: Matrix,
    /// For each joint its matrix, if the mesh is skinned.
    joints: Option<Vec<Matrix>>,
}

impl<'a> Instance<'a> {
    fn new(root: &'a Root, buffers: &'a Buffers, scene: &Scene, rest: &Scene, node: usize) -> Result<Self, NodeError> {
        let json: &Node = &root.nodes[node];
        let of = |what| bad(FORMAT, format_args!("node {node}"), what);
        let index = json.mesh.ok_or_else(|| of("has no mesh"))?;
        let mesh = root.get(index).ok_or_else(|| of("names a mesh that is not there"))?;
        let joints = json.skin.map(|skin| scene.joints(root, buffers, skin.value())).transpose()?;
        let given = json.weights.as_ref().or(mesh.weights.as_ref());
        let default = given.map_or(Vec::new(), |w| w.iter().map(|x| f64::from(*x)).collect());
        Ok(Self {
            root,
            buffers,
            mesh,
            mesh_index: index.value(),
            morph: scene.morph(node).map_or(default, <[f64]>::to_vec),
            transform: scene.global(node),
            rest: rest.global(node),
            joints,
        })
    }

    fn add(&self, raw: &mut Raw) -> Result<(), NodeError> {
        for (i, primitive) in self.mesh.primitives.iter().enumerate() {
            let place = format!("mesh {}, primitive {i}", self.mesh_index);
            self.primitive(primitive, &place, raw)?;
        }
        Ok(())
    }

    fn primitive(&self, primitive: &Primitive, place: &str, raw: &mut Raw) -> Result<(), NodeError> {
        let Checked::Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) = primitive.mode else {
            return Ok(());
        };
        let base = raw.vertices.len();
        let raw_positions = self.attribute(primitive, &Semantic::Positions, 3, place)?;
        let positions = raw_positions.ok_or_else(|| bad(FORMAT, place, "has no positions"))?;
        let positions = positions.as_chunks::<3>().0.to_vec();
        let morphed = self.morphed(primitive, &positions, place)?;
        let posed = match &self.joints {
            Some(joints) => self.skinned(primitive, &morphed, joints, place)?,
            None => morphed.iter().map(|p| self.transform.point(*p)).collect(),
        };
        for (v, p) in posed.iter().chain(&positions).enumerate() {
            if p.iter().any(|x| !x.is_finite()) {
                let v = v % posed.len();
                return Err(bad(FORMAT, place, format_args!("vertex {v} has a coordinate that is not finite")));
            }
        }
        if base + posed.len() >= u32::MAX as usize {
            return Err(bad(FORMAT, place, "too many vertices for 32-bit indices"));
        }
        let mirrored = self.joints.is_none() && self.rest.determinant() < 0.0;
        let corners = self.corners(primitive, posed.len(), place)?;
        for [a, b, c] in triangles(mode, &corners) {
            let face = if mirrored { [a, c, b] } else { [a, b, c] };
            raw.faces.push(face.map(|v| v + base as u32));
        }
        if let Some(bind) = &mut raw.bind {
            match self.joints {
                Some(_) => bind.extend(positions),
                None => bind.extend(positions.iter().map(|p| self.rest.point(*p))),
            }
        }
        raw.vertices.extend(posed);
        Ok(())
    }

    /// An attribute's numbers, checked to have `width` to a vertex.
    fn attribute(
        &self,
        primitive: &Primitive,
        semantic: &Semantic,
        width: usize,
        place: &str,
    ) -> Result<Option<Vec<f64>>, NodeError> {
        let index = primitive.attributes.get(&Checked::Valid(semantic.clone()));
        index.map(|i| self.buffers.read(self.root, *i, width, place)).transpose()
    }

    fn corners(&self, primitive: &Primitive, vertices: usize, place: &str) -> Result<Vec<u32>, NodeError> {
        let Some(index) = primitive.indices else { return Ok((0..vertices as u32).collect()) };
        let numbers = self.buffers.read(self.root, index, 1, place)?;
        let corner = |(i, x): (usize, &f64)| {
            if *x >= 0.0 && *x < vertices as f64 && x.fract() == 0.0 {
                return Ok(*x as u32);
            }
            Err(bad(FORMAT, place, format_args!("index {i} is {x}, but there are {vertices} vertices")))
        };
        numbers.iter().enumerate().map(corner).collect()
    }

    fn morphed(&self, primitive: &Primitive, positions: &[[f64; 3]], place: &str) -> Result<Vec<[f64; 3]>, NodeError> {
        let mut out = positions.to_vec();
        for (target, weight) in primitive.targets.iter().flatten().zip(&self.morph) {
            let Some(index) = target.positions.filter(|_| *weight != 0.0) else { continue };
            let moves = self.buffers.read(self.root, index, 3, place)?;
            if moves.len() != 3 * out.len() {
                return Err(bad(FORMAT, place, "a morph target has another number of vertices"));
            }
            for (p, d) in out.iter_mut().zip(moves.as_chunks::<3>().0) {
                (0..3).for_each(|k| p[k] += weight * d[k]);
            }
        }
        Ok(out)
    }

    /// Linear blend skinning, in double precision; weights are divided by their sum, which files round.
    fn skinned(
        &self,
        primitive: &Primitive,
        positions: &[[f64; 3]],
        matrices: &[Matrix],
        place: &str,
    ) -> Result<Vec<[f64; 3]>, NodeError> {
        let mut sets = Vec::new();
        for set in 0.. {
            let joints = self.attribute(primitive, &Semantic::Joints(set), 4, place)?;
            let weights = self.attribute(primitive, &Semantic::Weights(set), 4, place)?;
            let (Some(joints), Some(weights)) = (joints, weights) else { break };
            if joints.len() != 4 * positions.len() || weights.len() != joints.len() {
                return Err(bad(
                    FORMAT,
                    place,
                    format_args!("set {set} of joints and weights does not fit the vertices"),
                ));
            }
            sets.push((joints, weights));
        }
        let pose = |(v, p): (usize, &[f64; 3])| {
            let (mut sum, mut total) = ([0.0; 3], 0.0);
            for (joints, weights) in &sets {
                for k in 4 * v..4 * v + 4 {
                    let (joint, weight) = (joints[k], weights[k]);
                    let of = |what: String| bad(FORMAT, place, format!("vertex {v} {what}"));
                    if weight == 0.0 {
                        continue;
                    }
                    let matrix = matrices
                        .get(joint as usize)
                        .ok_or_else(|| of(format!("names joint {joint}, but the skin has {}", matrices.len())))?;
                    if weight.is_nan() || weight < 0.0 {
                        return Err(of(format!("has the weight {weight}")));
                    }
                    let q = matrix.point(*p);
                    (0..3).for_each(|i| sum[i] += weight * q[i]);
                    total += weight;
                }
            }
            if total > 0.0 {
                Ok(sum.map(|x| x / total))
            } else {
                Err(bad(FORMAT, place, format_args!("vertex {v} is skinned, but no joint has weight on it")))
            }
        };
        positions.iter().enumerate().map(pose).collect()
    }
}

/// The triangles of a list of corners, consistently oriented.
fn triangles(mode: Mode, corners: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => {
            let turned = |(i, w): (usize, &[u32])| {
                if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] }
            };
            corners.windows(3).enumerate().map(turned).collect()
        }
        Mode::TriangleFan => match corners {
            [hub, rim @ ..] => rim.windows(2).map(|w| [*hub, w[0], w[1]]).collect(),
            [] => Vec::new(),
        },
        _ => corners.as_chunks::<3>().0.to_vec(),
    }
}

/// The value at an index of the document, which validation has found to be there.
fn get<'a, T>(root: &'a Root, index: Index<T>, what: &str) -> Result<&'a T, NodeError>
where
    Root: gltf::json::root::Get<T>,
{
    root.get(index).ok_or_else(|| bad(FORMAT, "document", format_args!("{what} {} is not there", index.value())))
}
