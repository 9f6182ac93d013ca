//! Loading a mesh from a file: OBJ, OFF, PLY, STL, glTF and GLB.
//!
//! A sound file comes out as it is, vertex for vertex. What is doubtful is reported with the mesh as typed defects, and
//! mended only where a param says so; what cannot be a mesh (coordinates that are not finite, indices out of range, no
//! vertices, no faces, files cut short, counts that lie) is refused with its place.

use salient_sdk::{Context, FileParam, Mesh, Node, NodeError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

mod gltf;
mod obj;
mod off;
mod ply;
mod raw;
mod repair;
mod stl;

/// Params of [`Load`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Params {
    /// The file, by extension: obj, off, ply, stl, gltf or glb. Required.
    pub path: FileParam,
    /// glTF only: the clip that poses the mesh, by name (`Anim_0`, `Anim_1`, ... for clips without a name). Default:
    /// none, the mesh as its nodes stand in the file. Source: glTF 2.0, section 3.11.
    #[serde(default)]
    pub animation: Option<String>,
    /// glTF only: time in the clip, in seconds, from 0 to the clip's last key. Default 0.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub time: f64,
    /// Whether vertices at exactly equal positions become one. Default `Auto`.
    #[serde(default)]
    pub weld: Weld,
    /// Removes faces of zero area: twice the area at most 1e-12 of the longest edge squared. Default false.
    #[serde(default)]
    pub drop_degenerate: bool,
    /// Removes vertices of no face; the others are renumbered. Default false.
    #[serde(default)]
    pub drop_unreferenced: bool,
    /// Keeps only the connected component with the most faces. Default false.
    #[serde(default)]
    pub largest_component: bool,
}

/// Whether vertices at exactly equal positions become one: the first of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Weld {
    /// In STL, and in glTF within each mesh instance in the bind pose: these formats split vertices at facets and seams.
    #[default]
    Auto,
    /// In every format, and in glTF across mesh instances too.
    Always,
    /// Nowhere.
    Never,
}

/// The node: see [`Node::DOC`].
pub struct Load;

impl Node for Load {
    const KIND: &'static str = "load";
    const VERSION: u32 = 1;
    const DOC: &'static str = "Loads a triangle mesh from an OBJ, OFF, PLY, STL, glTF or GLB file. \
        Vertices keep the numbering of the file (for OBJ, of its v lines), in its units. Polygons are split into \
        triangles: quads along the shorter inner diagonal, convex polygons as a fan, others by cutting ears. \
        Lines, points, normals, colours and materials are not read. A skinned glTF is posed by a clip and a time. \
        Non-manifold edges and vertices, inconsistent orientation, zero-area faces, duplicate and unreferenced \
        vertices, boundaries and further components are reported with the mesh, and mended only by params; after \
        welding or dropping, `source` holds each vertex's index in the file (STL: three for each facet; glTF: \
        primitives one after the other, in order of the scene). Places of repaired defects are numbered as in the file, \
        others as in the mesh.";
    const EXAMPLE: &'static str = "\"mesh\": load(path: \"mesh.obj\")";

    type Params = Params;
    type Inputs = ();
    type Output = Mesh;

    fn check(params: &Params) -> Vec<(&'static str, String)> {
        let mut errors = Vec::new();
        let format = Format::of(&params.path);
        if let Err(error) = &format {
            errors.push(("path", error.message.clone()));
        }
        if params.animation.is_some() && format.is_ok_and(|f| f != Format::Gltf) {
            errors.push(("animation", "only glTF files have animations".into()));
        }
        if params.animation.is_none() && params.time != 0.0 {
            errors.push(("time", "a time needs an animation".into()));
        }
        errors
    }

    fn run(params: &Params, (): (), cx: Context) -> Result<Mesh, NodeError> {
        if let Some((param, message)) = Self::check(params).into_iter().next() {
            return Err(NodeError::new(format!("{param}: {message}")));
        }
        let format = Format::of(&params.path)?;
        let bytes = cx.read("path")?;
        let raw = match format {
            Format::Obj => obj::read(&bytes),
            Format::Off => off::read(&bytes),
            Format::Ply => ply::read(&bytes),
            Format::Stl => stl::read(&bytes),
            Format::Gltf => {
                let clip = params.animation.as_deref().map(|name| (name, params.time));
                gltf::read(&bytes, clip, cx)
            }
        }?;
        cx.check()?;
        repair::mesh(raw, format, params, cx)
    }
}

/// Formats that are read.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Format {
    Obj,
    Off,
    Ply,
    Stl,
    Gltf,
}

impl Format {
    fn of(path: &FileParam) -> Result<Self, NodeError> {
        match path.extension().as_str() {
            "obj" => Ok(Self::Obj),
            "off" => Ok(Self::Off),
            "ply" => Ok(Self::Ply),
            "stl" => Ok(Self::Stl),
            "gltf" | "glb" => Ok(Self::Gltf),
            "" => {
                Err(NodeError::new("a file without extension, which says the format: obj, off, ply, stl, gltf or glb"))
            }
            other => Err(NodeError::new(format!("`.{other}` is none of obj, off, ply, stl, gltf, glb"))),
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Obj => "OBJ",
            Self::Off => "OFF",
            Self::Ply => "PLY",
            Self::Stl => "STL",
            Self::Gltf => "glTF",
        }
    }
}
