//! Geodesics in heat: Crane, Weischedel & Wardetzky (2013).
//!
//! A short flow of heat from the sources, (S + t M) u = delta, gives directions; the distance is the function whose gradient comes nearest to
//! X = -grad u / |grad u|: M phi = integrated divergence of X. Both matrices have the same entries, so one symbolic factorisation serves
//! for all, and the factors for all sources.
//!
//! All is done on the intrinsic Delaunay triangulation, where both matrices are M-matrices: no sum in the solves cancels, so that u is
//! right to its last digits however small it is, which far from the source is very small. Meshes that are not orientable manifolds have no such
//! triangulation and are taken as they are.

use super::dijkstra::{Ball, Dijkstra};
use super::graph::Graph;
use crate::adjacency::{self, MeshError};
use crate::laplacian::{LaplacianError, Triangle, flip_to_delaunay};
use crate::sparse::SymmetricCsr;
use crate::stop::{NEVER, Stop};
use crate::vec3::distance;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LdltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{Conj, Mat, Par, Side, Spec};
use std::fmt;

/// The flow's time in units of the squared mean edge length.
const TIME: f64 = 1.0;
/// Heat put into a source, and how many e-foldings it may fall over the mesh: near the ends of what a double can hold.
const HEAT: f64 = 1e280;
const FOLDINGS: f64 = 1200.0;
/// Sources that are solved for together.
const TOGETHER: usize = 8;

/// Why the heat method cannot be set up.
#[derive(Debug, Clone, PartialEq)]
pub enum HeatError {
    /// The arrays are not a triangle mesh.
    Mesh(MeshError),
    /// A face has no area, so that there is no gradient on it.
    ZeroAreaFace {
        /// Position of the face in the face array.
        face: usize,
    },
    /// A matrix could not be factorised: areas or cotangents out of all proportion.
    Factorisation,
    /// The caller said to stop.
    Cancelled,
}

impl fmt::Display for HeatError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mesh(error) => error.fmt(f),
            Self::ZeroAreaFace { face } => write!(f, "face {face} has no area, so that heat has no direction on it"),
            Self::Factorisation => write!(f, "the heat method's matrices could not be factorised"),
            Self::Cancelled => write!(f, "cancelled"),
        }
    }
}

impl std::error::Error for HeatError {}

/// A face laid flat: corners (0, 0), (base, 0) and (x, y).
#[derive(Debug, Clone, Copy)]
struct Flat {
    corners: [u32; 3],
    base: f64,
    x: f64,
    y: f64,
}

/// The factors of a mesh: made once, used for any number of sources.
pub struct HeatMethod {
    faces: Vec<Flat>,
    symbolic: SymbolicCholesky<usize>,
    /// Of S + t M, with free and, if there is a boundary, with cold boundary; and of M, one vertex of each component held.
    free: Vec<f64>,
    cold: Option<Vec<f64>>,
    poisson: Vec<f64>,
    boundary: Vec<bool>,
    component: Vec<u32>,
    components: usize,
    held: Vec<u32>,
    /// Length of the unit of calculation, the mean edge length.
    unit: f64,
    graph: Graph,
}

impl fmt::Debug for HeatMethod {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("HeatMethod").field("vertices", &self.len()).finish_non_exhaustive()
    }
}

/// Corners and edge lengths of triangles, in units of the mean length, and that unit.
type Triangulation = (Vec<[u32; 3]>, Vec<[f64; 3]>, f64);

fn triangulate(vertices: &[[f64; 3]], faces: &[[u32; 3]], stop: Stop) -> Result<Triangulation, HeatError> {
    adjacency::check_mesh(vertices, faces).map_err(HeatError::Mesh)?;
    let between = |a: u32, b: u32| distance(vertices[a as usize], vertices[b as usize]);
    let lengths: Vec<[f64; 3]> = faces.iter().map(|&[a, b, c]| [between(b, c), between(c, a), between(a, b)]).collect();
    if let Some(face) = lengths.iter().position(|&l| Triangle::from_lengths(l).is_none()) {
        return Err(HeatError::ZeroAreaFace { face });
    }
    let (faces, lengths) = match flip_to_delaunay(faces, &lengths, stop) {
        Ok(delaunay) => delaunay,
        Err(LaplacianError::Cancelled) => return Err(HeatError::Cancelled),
        Err(
            LaplacianError::NonManifoldEdge { .. }
            | LaplacianError::NotOrientable { .. }
            | LaplacianError::DelaunayStalled { .. },
        ) => (faces.to_vec(), lengths),
        Err(_) => return Err(HeatError::Factorisation),
    };
    let unit = lengths.iter().flatten().sum::<f64>() / (3 * lengths.len().max(1)) as f64;
    let unit = if unit > 0.0 { unit } else { 1.0 };
    Ok((faces, lengths.iter().map(|l| l.map(|x| x / unit)).collect(), unit))
}

impl HeatMethod {
    /// Factorises a mesh. Vertices without a face are at an infinite distance from all others.
    pub fn new(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Result<Self, HeatError> {
        Self::new_until(vertices, faces, NEVER)
    }

    /// The same, until `stop`, which is asked between factorisations.
    pub fn new_until(vertices: &[[f64; 3]], faces: &[[u32; 3]], stop: Stop) -> Result<Self, HeatError> {
        let go_on = || if stop() { Err(HeatError::Cancelled) } else { Ok(()) };
        let n = vertices.len();
        let graph = Graph::edges(vertices, faces).map_err(HeatError::Mesh)?;
        let boundary = boundary(n, faces)?;
        go_on()?;
        let (faces, lengths, unit) = triangulate(vertices, faces, stop)?;
        go_on()?;
        let mut weights = Vec::with_capacity(3 * faces.len());
        let mut mass = vec![0.0; n];
        let mut flat = Vec::with_capacity(faces.len());
        for (face, (&corners, &sides)) in faces.iter().zip(&lengths).enumerate() {
            let triangle = Triangle::from_lengths(sides).ok_or(HeatError::ZeroAreaFace { face })?;
            for i in 0..3 {
                weights.push(0.5 * triangle.cotangents[i]);
                mass[corners[i] as usize] += triangle.area / 3.0;
            }
            let y = 2.0 * triangle.area / sides[2];
            flat.push(Flat { corners, base: sides[2], x: y * triangle.cotangents[0], y });
        }
        let stiffness = SymmetricCsr::graph_laplacian(n, adjacency::opposite_sides(&faces), &weights);
        let (components, component) = stiffness.components();
        let mut held = vec![u32::MAX; components];
        (0..n as u32).rev().for_each(|v| held[component[v as usize] as usize] = v);
        go_on()?;
        let time = TIME.max((1.1 * extent(&graph, &held) / (unit * FOLDINGS)).powi(2));
        go_on()?;
        let pattern = Pattern::new(&stiffness)?;
        go_on()?;
        let flow = values(&stiffness, |v| mass[v] + f64::from(u8::from(mass[v] == 0.0)), time);
        let free = pattern.factor(&flow)?;
        go_on()?;
        let cold = if boundary.contains(&true) {
            Some(pattern.factor(&fixed(&stiffness, flow, |v| boundary[v]))?)
        } else {
            None
        };
        go_on()?;
        let plain = values(&stiffness, |_| 0.0, 1.0);
        let poisson = pattern.factor(&fixed(&stiffness, plain, |v| held[component[v] as usize] as usize == v))?;
        Ok(Self {
            faces: flat,
            symbolic: pattern.symbolic,
            free,
            cold,
            poisson,
            boundary,
            component,
            components,
            held,
            unit,
            graph,
        })
    }

    /// Number of vertices.
    #[must_use]
    pub fn len(&self) -> usize {
        self.component.len()
    }

    /// Whether there are no vertices.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.component.is_empty()
    }

    /// Integrated divergence of the unit field against the gradient of `u`, added to `out`.
    fn divergence(&self, u: &[f64], out: &mut [f64]) {
        for &Flat { corners: [a, b, c], base, x, y } in &self.faces {
            let [ua, ub, uc] = [a, b, c].map(|v| u[v as usize]);
            let gx = (ub - ua) / base;
            let gy = (uc - ua - gx * x) / y;
            // Squares of very small or large numbers would leave the range of doubles.
            let largest = gx.abs().max(gy.abs());
            if !(largest > 0.0 && largest.is_finite()) {
                continue;
            }
            let (gx, gy) = (gx / largest, gy / largest);
            let norm = -(gx * gx + gy * gy).sqrt();
            let (fx, fy) = (gx / norm, gy / norm);
            let (at_b, at_c) = (0.5 * (y * fx - x * fy), 0.5 * base * fy);
            out[b as usize] += at_b;
            out[c as usize] += at_c;
            out[a as usize] -= at_b + at_c;
        }
    }

    /// Turns a potential into distances: zero at the sources, right on average over the edges that leave them.
    fn calibrate(&self, sources: &[u32], phi: &[f64]) -> Vec<f64> {
        let mut shift = vec![(0.0, 0usize); self.components];
        for &s in sources {
            let entry = &mut shift[self.component[s as usize] as usize];
            for (v, length) in self.graph.neighbours(s) {
                entry.0 += phi[v as usize] - length / self.unit;
                entry.1 += 1;
            }
        }
        let mut distances: Vec<f64> = (0..self.len())
            .map(|v| match shift[self.component[v] as usize] {
                (_, 0) => f64::INFINITY,
                (sum, count) => ((phi[v] - sum / count as f64) * self.unit).max(0.0),
            })
            .collect();
        for &s in sources {
            distances[s as usize] = 0.0;
        }
        distances
    }
}

/// Which vertices lie on an edge with one face.
fn boundary(n: usize, faces: &[[u32; 3]]) -> Result<Vec<bool>, HeatError> {
    let edges = adjacency::edges(n, faces).map_err(HeatError::Mesh)?;
    let mut boundary = vec![false; n];
    for (e, ends) in edges.ends.iter().enumerate() {
        if edges.faces.row(e).len() == 1 {
            for v in ends {
                boundary[*v as usize] = true;
            }
        }
    }
    Ok(boundary)
}

/// The greatest extent of a component, about: the farthest from the vertex that is farthest from a first one.
fn extent(graph: &Graph, first: &[u32]) -> f64 {
    let mut work = Dijkstra::new();
    let mut farthest = |from: u32| {
        let all = work.within(graph, &[from], f64::INFINITY).iter().copied();
        all.max_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)))
    };
    let across = |&v: &u32| farthest(v).and_then(|(far, _)| farthest(far)).map_or(0.0, |(_, d)| d);
    first.iter().map(across).fold(0.0, f64::max)
}

/// What the matrices have in common.
struct Pattern {
    pattern: SymbolicSparseColMat<usize>,
    symbolic: SymbolicCholesky<usize>,
}

impl Pattern {
    fn new(matrix: &SymmetricCsr) -> Result<Self, HeatError> {
        let n = matrix.n();
        let rows: Vec<usize> = matrix.columns().iter().map(|&c| c as usize).collect();
        // By symmetry the compressed rows are compressed columns.
        let pattern = SymbolicSparseColMat::new_checked(n, n, matrix.offsets().to_vec(), None, rows);
        let params = CholeskySymbolicParams::default();
        let symbolic = factorize_symbolic_cholesky(pattern.as_ref(), Side::Lower, SymmetricOrdering::Amd, params)
            .map_err(|_| HeatError::Factorisation)?;
        Ok(Self { pattern, symbolic })
    }

    fn factor(&self, entries: &[f64]) -> Result<Vec<f64>, HeatError> {
        let failed = HeatError::Factorisation;
        let matrix = SparseColMatRef::new(self.pattern.as_ref(), entries);
        let mut values = vec![0.0; self.symbolic.len_val()];
        let scratch = self.symbolic.factorize_numeric_ldlt_scratch::<f64>(Par::Seq, Spec::default());
        let mut memory = MemBuffer::try_new(scratch).map_err(|_| failed.clone())?;
        let (stack, plain) = (MemStack::new(&mut memory), LdltRegularization::default());
        self.symbolic
            .factorize_numeric_ldlt(&mut values, matrix, Side::Lower, plain, Par::Seq, stack, Spec::default())
            .map_err(|_| failed.clone())?;
        if values.iter().all(|v| v.is_finite()) { Ok(values) } else { Err(failed) }
    }
}

/// The entries of `diag(diagonal) + factor * matrix`.
fn values(matrix: &SymmetricCsr, diagonal: impl Fn(usize) -> f64, factor: f64) -> Vec<f64> {
    let row = |i: usize| {
        let added = diagonal(i);
        matrix.row(i).map(move |(j, v)| factor * v + if i == j { added } else { 0.0 })
    };
    (0..matrix.n()).flat_map(row).collect()
}

/// Entries with the rows and columns of some vertices replaced by those of the identity.
fn fixed(matrix: &SymmetricCsr, mut values: Vec<f64>, fixed: impl Fn(usize) -> bool) -> Vec<f64> {
    for i in 0..matrix.n() {
        let range = matrix.offsets()[i]..matrix.offsets()[i + 1];
        for (value, &j) in values[range.clone()].iter_mut().zip(&matrix.columns()[range]) {
            if fixed(i) || fixed(j as usize) {
                *value = f64::from(u8::from(i == j as usize));
            }
        }
    }
    values
}

/// Workspace of the heat method.
#[derive(Default)]
pub struct HeatSearch {
    memory: Option<MemBuffer>,
    found: Vec<(u32, f64)>,
    rim: Vec<(u32, f64)>,
}

impl fmt::Debug for HeatSearch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("HeatSearch").finish_non_exhaustive()
    }
}

impl HeatSearch {
    /// An empty workspace; it grows on first use.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Distances of all vertices from the nearest source; infinite on components without one. Sources out of range are ignored.
    pub fn distances(&mut self, heat: &HeatMethod, sources: &[u32]) -> Vec<f64> {
        self.solve(heat, &[sources], NEVER).pop().unwrap_or_default()
    }

    /// The vertices within `radius` and their neighbours. Every call solves for the whole mesh. What is within need not be connected.
    pub fn ball(&mut self, heat: &HeatMethod, sources: &[u32], radius: f64) -> Ball<'_> {
        let distances = self.distances(heat, sources);
        let within = |d: f64| d <= radius;
        self.found.clear();
        self.rim.clear();
        for (v, &d) in (0u32..).zip(&distances).filter(|e| e.1.is_finite()) {
            if within(d) {
                self.found.push((v, d));
            } else if heat.graph.neighbours(v).any(|(w, _)| within(distances[w as usize])) {
                self.rim.push((v, d));
            }
        }
        Ball { radius, inside: &self.found, rim: &self.rim }
    }

    /// Distances from each source to each target, some sources at a time.
    pub fn between(&mut self, heat: &HeatMethod, sources: &[u32], targets: &[u32]) -> Vec<Vec<f64>> {
        self.between_until(heat, sources, targets, NEVER)
    }

    /// The same, until `stop`: the rest is then infinite.
    pub fn between_until(&mut self, heat: &HeatMethod, sources: &[u32], targets: &[u32], stop: Stop) -> Vec<Vec<f64>> {
        let mut rows = Vec::with_capacity(sources.len());
        for some in sources.chunks(TOGETHER) {
            let sets: Vec<&[u32]> = some.iter().map(std::slice::from_ref).collect();
            for all in self.solve(heat, &sets, stop) {
                let at = |&t: &u32| all.get(t as usize).copied().unwrap_or(f64::INFINITY);
                rows.push(targets.iter().map(at).collect());
            }
        }
        rows
    }

    /// Distances of all vertices from each set of sources.
    fn solve(&mut self, heat: &HeatMethod, sets: &[&[u32]], stop: Stop) -> Vec<Vec<f64>> {
        let n = heat.len();
        let unknown = || vec![vec![f64::INFINITY; n]; sets.len()];
        if stop() {
            return unknown();
        }
        let known = |set: &&[u32]| -> Vec<u32> { set.iter().copied().filter(|&s| (s as usize) < n).collect() };
        let sets: Vec<Vec<u32>> = sets.iter().map(known).collect();
        let mut u = Mat::<f64>::zeros(n, sets.len());
        for (j, set) in sets.iter().enumerate() {
            for &s in set {
                u[(s as usize, j)] = HEAT;
            }
        }
        let cold = heat.cold.as_ref().map(|factor| {
            // Heat in a cold boundary would go nowhere: there only the free boundary counts.
            let mut v = u.clone();
            for (j, set) in sets.iter().enumerate() {
                for &s in set.iter().filter(|&&s| heat.boundary[s as usize]) {
                    v[(s as usize, j)] = 0.0;
                }
            }
            self.apply(heat, factor, &mut v);
            v
        });
        if stop() {
            return unknown();
        }
        self.apply(heat, &heat.free, &mut u);
        if let Some(cold) = cold {
            u += cold;
        }
        let mut phi = Mat::<f64>::zeros(n, sets.len());
        for j in 0..sets.len() {
            let mut out = vec![0.0; n];
            let column: Vec<f64> = u.col(j).iter().copied().collect();
            heat.divergence(&column, &mut out);
            for &v in &heat.held {
                out[v as usize] = 0.0;
            }
            for (i, x) in out.into_iter().enumerate() {
                phi[(i, j)] = x;
            }
        }
        if stop() {
            return unknown();
        }
        self.apply(heat, &heat.poisson, &mut phi);
        let column = |j: usize| phi.col(j).iter().copied().collect::<Vec<f64>>();
        sets.iter().enumerate().map(|(j, set)| heat.calibrate(set, &column(j))).collect()
    }

    fn apply(&mut self, heat: &HeatMethod, factor: &[f64], x: &mut Mat<f64>) {
        let need = heat.symbolic.solve_in_place_scratch::<f64>(TOGETHER.max(x.ncols()), Par::Seq);
        let memory = self.memory.get_or_insert_with(|| MemBuffer::new(need));
        let factor = LdltRef::<usize, f64>::new(&heat.symbolic, factor);
        factor.solve_in_place_with_conj(Conj::No, x.as_mut(), Par::Seq, MemStack::new(memory));
    }
}
