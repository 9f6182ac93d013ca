//! From artefacts to scenes.

use std::sync::Arc;

use salient_sdk::view::{Fields, Link, Links, Points, Region};
use salient_sdk::{AnyArtefact, FormatError, Mesh};

use super::colour::{self, Colour, ColourMap, PLAIN};
use super::scene::Scene;

/// What is to be drawn of an artefact, and how.
#[derive(Clone, Debug, Default)]
pub struct Drawing {
    /// Which of several: the number k of a function, a point's patch, or a correspondence (0 the match, 1 its twin). By default the first function
    /// that is not constant, all points, and the match.
    pub index: Option<usize>,
    /// How values become colours.
    pub colours: ColourMap,
    /// Points and lines without the surfaces that they lie on.
    pub bare: bool,
}

/// Draws an artefact on the meshes that it is on: none for one that carries its own surface, two for one that links two.
pub fn draw(artefact: &dyn AnyArtefact, on: &[Arc<Mesh>], how: &Drawing) -> Result<Scene, FormatError> {
    if let Some(mesh) = artefact.surface() {
        return Ok(surface(&mesh.vertices, &mesh.faces));
    }
    let view = artefact.view();
    match (on, view) {
        ([mesh], view) if !view.fields.is_empty() => field(mesh, &view.fields[0], how),
        ([mesh], salient_sdk::View { points: Some(points), .. }) => features(mesh, &points, how),
        ([left, right], salient_sdk::View { links: Some(of), .. }) => links([left, right], &of, how),
        _ => Err(FormatError(format!("there is nothing to draw of this `{}`", artefact.type_name()))),
    }
}

fn surface(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Scene {
    Scene { vertices: vertices.to_vec(), faces: faces.to_vec(), ..Scene::default() }
}

/// A function as vertex colours, and its values as the property `value`.
fn field(mesh: &Mesh, of: &Fields, how: &Drawing) -> Result<Scene, FormatError> {
    if of.vertices != mesh.vertices.len() {
        return Err(FormatError(format!(
            "the {} has {} values, but its mesh {} vertices",
            of.name,
            of.vertices,
            mesh.vertices.len()
        )));
    }
    let row = match how.index {
        // An eigenfunction of a zero eigenvalue is constant.
        None => of.levels.iter().position(|level| level.lambda.is_none_or(|lambda| lambda > 0.0)),
        Some(k) => of.levels.iter().position(|level| level.k as usize == k),
    };
    let Some(row) = row else {
        let all: Vec<String> = of.levels.iter().map(|level| level.k.to_string()).collect();
        let wanted = how.index.map_or("none that is not constant".into(), |k| format!("none of number {k}"));
        let ends = [all.first(), all.last()].map(|k| k.cloned().unwrap_or_default());
        return Err(FormatError(format!(
            "there is {wanted} among the {} of {}s {} to {}",
            all.len(),
            of.name,
            ends[0],
            ends[1]
        )));
    };
    let values = of.row(row).to_vec();
    let colours = how.colours.colours(&values, of.signed);
    Ok(Scene { colours, properties: vec![("value", values)], ..surface(&mesh.vertices, &mesh.faces) })
}

/// Features as marks on their mesh, coloured by frequency and sized by scale; bare, as points with their numbers; or the patch of one.
fn features(mesh: &Mesh, of: &Points, how: &Drawing) -> Result<Scene, FormatError> {
    if let Some(index) = how.index {
        let missing = || FormatError(format!("there is no patch {index} among the {}", of.regions.len()));
        let Region { vertices, faces, .. } = *of.regions.get(index).ok_or_else(missing)?;
        return Ok(surface(vertices, faces));
    }
    let places = of.points.iter().map(|p| at(mesh, p.vertex)).collect::<Result<Vec<_>, _>>()?;
    let colours = colour::of_frequencies(&of.points.iter().map(|p| p.lambda).collect::<Vec<_>>());
    if how.bare {
        let column = |of_point: fn(&salient_sdk::view::Point) -> f64| of.points.iter().map(of_point).collect();
        let properties = vec![
            ("vertex", column(|p| f64::from(p.vertex))),
            ("k", column(|p| f64::from(p.k))),
            ("lambda", column(|p| p.lambda)),
            ("scale", column(|p| p.scale)),
            ("energy", column(|p| p.energy)),
        ];
        let points = (0..places.len() as u32).collect();
        return Ok(Scene { vertices: places, colours, points, properties, ..Scene::default() });
    }
    let mut scene = plain(mesh, [0.0; 3]);
    let extent = extent(mesh);
    for ((place, colour), point) in places.iter().zip(&colours).zip(&of.points) {
        mark(&mut scene, *place, (0.1 * point.scale).clamp(0.004 * extent, 0.015 * extent), *colour);
    }
    Ok(scene)
}

/// Two meshes side by side with lines between matched points; each pair has the colour of its left point's place.
fn links([left, right]: [&Arc<Mesh>; 2], of: &Links, how: &Drawing) -> Result<Scene, FormatError> {
    let index = how.index.unwrap_or(0);
    let names = || of.sets.iter().enumerate().map(|(i, s)| format!("{i} ({})", s.name)).collect::<Vec<_>>().join(", ");
    let set = of
        .sets
        .get(index)
        .ok_or_else(|| FormatError(format!("there is no correspondence {index}: there are {}", names())))?;
    let [box_left, box_right] = [left, right].map(|mesh| Scene::bounds(&mesh.vertices));
    let width = (box_left[1][0] - box_left[0][0]).max(box_right[1][0] - box_right[0][0]);
    let shift = [box_left[1][0] - box_right[0][0] + 0.25 * width, 0.0, 0.0];
    let mut scene = if how.bare { Scene::default() } else { plain(left, [0.0; 3]) };
    if !how.bare {
        join(&mut scene, plain(right, shift));
    }
    let size = 0.006 * extent(left).max(extent(right));
    for Link { vertices: [from, to], .. } in &set.pairs {
        let ends = [at(left, *from)?, moved(at(right, *to)?, shift)];
        let colour = colour::of_place(ends[0], box_left);
        let first = scene.vertices.len() as u32;
        scene.vertices.extend(ends);
        scene.colours.extend([colour; 2]);
        scene.edges.push([first, first + 1]);
        if !how.bare {
            for end in ends {
                mark(&mut scene, end, size, colour);
            }
        }
    }
    Ok(scene)
}

fn at(mesh: &Mesh, vertex: u32) -> Result<[f64; 3], FormatError> {
    let missing = || FormatError(format!("vertex {vertex} is past the mesh's {} vertices", mesh.vertices.len()));
    mesh.vertices.get(vertex as usize).copied().ok_or_else(missing)
}

fn plain(mesh: &Mesh, shift: [f64; 3]) -> Scene {
    let vertices: Vec<[f64; 3]> = mesh.vertices.iter().map(|p| moved(*p, shift)).collect();
    Scene { colours: vec![PLAIN; vertices.len()], vertices, faces: mesh.faces.clone(), ..Scene::default() }
}

fn moved(p: [f64; 3], by: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| p[k] + by[k])
}

fn extent(mesh: &Mesh) -> f64 {
    let [low, high] = Scene::bounds(&mesh.vertices);
    (0..3).map(|k| (high[k] - low[k]).powi(2)).sum::<f64>().sqrt()
}

fn join(scene: &mut Scene, other: Scene) {
    let first = scene.vertices.len() as u32;
    scene.vertices.extend(other.vertices);
    scene.colours.extend(other.colours);
    scene.faces.extend(other.faces.iter().map(|face| face.map(|v| v + first)));
}

/// An octahedron: every program shows faces, and few show points.
fn mark(scene: &mut Scene, centre: [f64; 3], size: f64, colour: Colour) {
    const FACES: [[u32; 3]; 8] =
        [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    let corner = |i: usize| {
        let mut p = centre;
        p[i / 2] += if i.is_multiple_of(2) { size } else { -size };
        p
    };
    let vertices: Vec<[f64; 3]> = (0..6).map(corner).collect();
    join(scene, Scene { vertices, colours: vec![colour; 6], faces: FACES.to_vec(), ..Scene::default() });
}
