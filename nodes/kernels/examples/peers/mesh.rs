//! Meshes to measure on: read from OBJ or OFF, or synthesised; refined and shaken, the same in every run.

use salient_kernels::creature::{self, CreatureParams};
use salient_kernels::laplacian::is_zero_area;
use salient_kernels::random::Random;
use salient_kernels::topology;
use std::collections::BTreeMap;
use std::error::Error;
use std::fs;

/// Positions and triangles.
#[derive(Clone)]
pub struct Mesh {
    pub vertices: Vec<[f64; 3]>,
    pub faces: Vec<[u32; 3]>,
}

/// Positions move by up to this part of the shortest edge at them, per axis.
const SHAKE: f64 = 0.15;

impl Mesh {
    /// `creature:N` is a synthesised creature of about N vertices; anything else an OBJ or OFF file.
    pub fn from_source(source: &str) -> Result<Self, Box<dyn Error>> {
        let mesh = match source.strip_prefix("creature:") {
            Some(count) => {
                let params = CreatureParams { vertices: count.parse()?, ..CreatureParams::default() };
                let made = creature::generate(&params)?;
                Self { vertices: made.vertices, faces: made.faces }
            }
            None => Self::read(&fs::read_to_string(source)?)?,
        };
        mesh.cleaned()
    }

    fn read(text: &str) -> Result<Self, Box<dyn Error>> {
        if text.trim_start().starts_with("OFF") { Self::read_off(text) } else { Self::read_obj(text) }
    }

    fn read_obj(text: &str) -> Result<Self, Box<dyn Error>> {
        let (mut vertices, mut faces) = (Vec::new(), Vec::new());
        for line in text.lines() {
            let mut words = line.split_whitespace();
            match words.next() {
                Some("v") => {
                    let x: Vec<f64> = words.take(3).map(str::parse).collect::<Result<_, _>>()?;
                    vertices.push(<[f64; 3]>::try_from(x).map_err(|_| "a vertex without three coordinates")?);
                }
                Some("f") => {
                    let first = |w: &str| w.split('/').next().unwrap_or("").parse::<i64>();
                    let ids: Vec<i64> = words.map(first).collect::<Result<_, _>>()?;
                    let count = vertices.len() as i64;
                    let ids: Vec<u32> = ids.iter().map(|&i| if i > 0 { i - 1 } else { count + i } as u32).collect();
                    faces.extend((2..ids.len()).map(|i| [ids[0], ids[i - 1], ids[i]]));
                }
                _ => {}
            }
        }
        Ok(Self { vertices, faces })
    }

    fn read_off(text: &str) -> Result<Self, Box<dyn Error>> {
        let lines = text.lines().map(|l| l.split('#').next().unwrap_or(""));
        let mut words = lines.flat_map(str::split_whitespace).skip(1);
        let mut next = || words.next().ok_or("the OFF file ends early");
        let (vertex_count, face_count): (usize, usize) = (next()?.parse()?, next()?.parse()?);
        next()?;
        let (mut vertices, mut faces) = (Vec::new(), Vec::new());
        for _ in 0..vertex_count {
            vertices.push([next()?.parse()?, next()?.parse()?, next()?.parse()?]);
        }
        for _ in 0..face_count {
            let corners: usize = next()?.parse()?;
            let ids: Vec<u32> = (0..corners).map(|_| Ok(next()?.parse()?)).collect::<Result<_, Box<dyn Error>>>()?;
            faces.extend((2..corners).map(|i| [ids[0], ids[i - 1], ids[i]]));
        }
        Ok(Self { vertices, faces })
    }

    /// Without zero-area faces and the vertices that nothing refers to.
    fn cleaned(self) -> Result<Self, Box<dyn Error>> {
        let Self { vertices, mut faces } = self;
        if faces.iter().flatten().any(|&v| v as usize >= vertices.len()) {
            return Err("a face names a vertex that there is not".into());
        }
        faces.retain(|f| !is_zero_area(f.map(|v| vertices[v as usize])));
        let used = topology::drop_unreferenced(&vertices, &faces)?;
        Ok(Self { vertices: used.vertices, faces: used.faces })
    }

    /// Every triangle cut into four, `levels` times; then, if at all, all positions shaken, so that no symmetry of the subdivision is left.
    pub fn refined(mut self, levels: usize) -> Self {
        for _ in 0..levels {
            self = self.subdivided();
        }
        if levels > 0 {
            self.shake();
        }
        self
    }

    fn subdivided(mut self) -> Self {
        let mut middles = BTreeMap::new();
        let mut faces = Vec::with_capacity(4 * self.faces.len());
        for &[a, b, c] in &self.faces {
            let mut middle = |a: u32, b: u32| {
                *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    let (p, q) = (self.vertices[a as usize], self.vertices[b as usize]);
                    self.vertices.push([0, 1, 2].map(|i| 0.5 * (p[i] + q[i])));
                    self.vertices.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            faces.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        Self { faces, ..self }
    }

    fn shake(&mut self) {
        let mut reach = vec![f64::INFINITY; self.vertices.len()];
        for &[a, b, c] in &self.faces {
            for (p, q) in [(a, b), (b, c), (c, a)] {
                let (p, q) = (p as usize, q as usize);
                let length = (0..3).map(|i| (self.vertices[p][i] - self.vertices[q][i]).powi(2)).sum::<f64>().sqrt();
                reach[p] = reach[p].min(length);
                reach[q] = reach[q].min(length);
            }
        }
        let mut random = Random::from_state(1);
        for (point, reach) in self.vertices.iter_mut().zip(reach) {
            *point = point.map(|x| x + SHAKE * reach * random.signed());
        }
    }
}
