//! `volume_signature`, `view_signature` and `panorama_signature`: what a shape looks like in space. They know nothing of bending, so they tell rigid objects apart that
//! intrinsic signatures confuse, and confuse poses that intrinsic ones do not.

use std::sync::Arc;

use salient_kernels::signature::harmonics::harmonics_until;
use salient_kernels::signature::panorama::panorama;
use salient_kernels::signature::views::{self, views};
use salient_sdk::{Context, Inputs, Mesh, Node, NodeError, Port, PortValues};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::signature::Signature;

/// A mesh.
pub struct In {
    mesh: Arc<Mesh>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[Port::one::<Mesh>("mesh", "the surface")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        let mesh: Arc<Mesh> = from.one("mesh")?;
        if mesh.area() > 0.0 { Ok(Self { mesh }) } else { Err(NodeError::new("the mesh has no area")) }
    }
}

/// Params of [`VolumeSignature`]: none.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct VolumeParams {}

/// The node of spherical harmonics.
pub struct VolumeSignature;

impl Node for VolumeSignature {
    const KIND: &'static str = "volume_signature";
    const VERSION: u32 = 1;
    const DOC: &'static str = "Where a surface is about its centre: norms of spherical harmonics on concentric shells, which do not change when it is turned \
        or mirrored (Kazhdan, Funkhouser & Rusinkiewicz 2003).";
    const EXAMPLE: &'static str = r#"
        "mesh":      synthesize(),
        "signature": volume_signature(mesh: "mesh"),
    "#;
    type Params = VolumeParams;
    type Inputs = In;
    type Output = Signature;

    fn run(_: &VolumeParams, In { mesh }: In, cx: Context) -> Result<Signature, NodeError> {
        cx.check()?;
        let values = harmonics_until(&mesh.vertices, &mesh.faces, &|| cx.cancelled());
        cx.check()?;
        Ok(Signature { kind: "spherical harmonics".into(), values })
    }
}

/// What the axes of a view are the principal ones of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Align {
    /// Where the area is.
    Area,
    /// Where the surface faces.
    Normals,
}

impl Align {
    /// For the kernels, and for the kind of the signature.
    fn named(self) -> (views::Align, &'static str) {
        match self {
            Self::Area => (views::Align::Area, "area"),
            Self::Normals => (views::Align::Normals, "normals"),
        }
    }
}

/// Params of [`ViewSignature`] and [`PanoramaSignature`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ViewParams {
    /// The principal axes that the surface is seen along: of its `Area` (default) or of its `Normals`.
    pub align: Align,
}

impl Default for ViewParams {
    fn default() -> Self {
        Self { align: Align::Area }
    }
}

/// The node of depth images.
pub struct ViewSignature;

impl Node for ViewSignature {
    const KIND: &'static str = "view_signature";
    const VERSION: u32 = 1;
    const DOC: &'static str = "What a surface looks like along its principal axes: low frequencies of depth images and outlines (after Vranic 2004 and \
        Papadakis et al. 2008).";
    const EXAMPLE: &'static str = r#"
        "mesh":      synthesize(),
        "signature": view_signature(mesh: "mesh", align: Area),
    "#;
    type Params = ViewParams;
    type Inputs = In;
    type Output = Signature;

    fn run(params: &ViewParams, In { mesh }: In, cx: Context) -> Result<Signature, NodeError> {
        cx.check()?;
        let (align, by) = params.align.named();
        Ok(Signature { kind: format!("views by {by}"), values: views(&mesh.vertices, &mesh.faces, align) })
    }
}

/// The node of panoramic views.
pub struct PanoramaSignature;

impl Node for PanoramaSignature {
    const KIND: &'static str = "panorama_signature";
    const VERSION: u32 = 1;
    const DOC: &'static str = "What a surface looks like from its principal axes, all around: low frequencies of its distance and facing on cylinders \
        (after Papadakis et al. 2010).";
    const EXAMPLE: &'static str = r#"
        "mesh":      synthesize(),
        "signature": panorama_signature(mesh: "mesh", align: Area),
    "#;
    type Params = ViewParams;
    type Inputs = In;
    type Output = Signature;

    fn run(params: &ViewParams, In { mesh }: In, cx: Context) -> Result<Signature, NodeError> {
        cx.check()?;
        let (align, by) = params.align.named();
        Ok(Signature { kind: format!("panorama by {by}"), values: panorama(&mesh.vertices, &mesh.faces, align) })
    }
}
