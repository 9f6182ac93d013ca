//! Surfaces and functions on them, as displayed: large ones simplified, values in 16 bits.

use salient_kernels::nearest::NearestVertex;
use salient_kernels::simplify::simplify;
use salient_sdk::Mesh;
use salient_sdk::view::Fields;

use super::blobs::Blobs;
use super::scene::{Coefficients, FieldScene, Surface};

/// A surface as displayed, and where the mesh's vertices are on it.
pub struct Displayed {
    /// For the page.
    pub surface: Surface,
    /// The mesh's vertex of each displayed one; none if they are the same.
    source: Option<Vec<u32>>,
    /// Finds displayed vertices; none if they are the mesh's.
    places: Option<NearestVertex>,
    /// Positions of the mesh.
    positions: Vec<[f64; 3]>,
}

impl Displayed {
    /// A mesh as it is, or with about `most` vertices if it has more. Displayed vertices are vertices of the mesh, so
    /// that functions need no interpolation. The name is left to the caller.
    pub fn new(mesh: &Mesh, most: usize, blobs: &mut Blobs) -> Self {
        let size = [mesh.vertices.len(), mesh.faces.len()];
        let small = (size[0] > most).then(|| simplify(&mesh.vertices, &mesh.faces, most).ok()).flatten();
        let small = small.map(|it| {
            let points: Vec<[f64; 3]> = it.source.iter().map(|v| mesh.vertices[*v as usize]).collect();
            (points, it.faces, it.source)
        });
        let (positions, triangles, source) = match &small {
            Some((points, faces, source)) => (points, faces, Some(source)),
            None => (&mesh.vertices, &mesh.faces, None),
        };
        let surface = Surface {
            name: String::new(),
            vertices: positions.len(),
            faces: triangles.len(),
            mesh: size,
            positions: blobs.floats(positions.as_flattened()),
            triangles: blobs.integers(triangles.as_flattened()),
            source: source.map(|source| blobs.integers(source)),
        };
        let places = small.as_ref().map(|(points, ..)| NearestVertex::new(points));
        Self { surface, places, source: small.map(|it| it.2), positions: mesh.vertices.clone() }
    }

    /// The displayed vertex nearest to a vertex of the mesh; none if the mesh has no such vertex.
    pub fn place(&self, vertex: u32) -> Option<u32> {
        let position = *self.positions.get(vertex as usize)?;
        self.places.as_ref().map_or(Some(vertex), |places| places.nearest(position).map(|(at, _)| at))
    }

    /// Functions on the mesh, at the displayed vertices; none if they are of another mesh. Of which node and surface, the
    /// caller says.
    pub fn fields(&self, of: &Fields, blobs: &mut Blobs) -> Option<FieldScene> {
        let n = self.positions.len();
        if of.vertices != n || of.values.len() != n * of.levels.len() {
            return None;
        }
        let (mut ranges, mut values) = (Vec::new(), Vec::new());
        for row in 0..of.levels.len() {
            let row = of.row(row);
            let mut quantise = |shown: &mut dyn Iterator<Item = f64>| {
                let shown: Vec<f64> = shown.collect();
                let low = shown.iter().copied().fold(f64::INFINITY, f64::min);
                let high = shown.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let scale = if high > low { f64::from(u16::MAX) / (high - low) } else { 0.0 };
                ranges.push(if low <= high { [low, high] } else { [0.0; 2] });
                values.extend(shown.iter().flat_map(|x| (((x - low) * scale).round() as u16).to_le_bytes()));
            };
            match &self.source {
                Some(source) => quantise(&mut source.iter().map(|v| row[*v as usize])),
                None => quantise(&mut row.iter().copied()),
            }
        }
        Some(FieldScene {
            node: 0,
            surface: 0,
            name: of.name,
            unit: of.unit,
            signed: of.signed,
            levels: of.levels.clone(),
            ranges,
            values: blobs.add(values),
            coefficients: of.mass.map(|mass| self.coefficients(of, mass)),
        })
    }

    /// C = P' S V (eq. 15), relative to the centre of mass and without the zero eigenvalues.
    fn coefficients(&self, of: &Fields, mass: &[f64]) -> Coefficients {
        let total: f64 = mass.iter().sum();
        let mean = |axis: usize| self.positions.iter().zip(mass).map(|(p, m)| p[axis] * m).sum::<f64>() / total;
        let centre: [f64; 3] = std::array::from_fn(mean);
        let coefficient = |(row, level): (usize, &salient_sdk::view::Level)| {
            let mut c = [0.0; 3];
            if level.lambda.is_some_and(|lambda| lambda > 0.0) {
                for ((p, m), v) in self.positions.iter().zip(mass).zip(of.row(row)) {
                    for axis in 0..3 {
                        c[axis] += (p[axis] - centre[axis]) * m * v;
                    }
                }
            }
            c
        };
        Coefficients { centre, of: of.levels.iter().enumerate().map(coefficient).collect() }
    }
}
