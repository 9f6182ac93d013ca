use std::fmt;

/// Why a mesh has no Laplacian; indices are the caller's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LaplacianError {
    /// There are no faces.
    Empty,
    /// More vertices or half-edges than 32-bit indices can number.
    TooLarge,
    /// Edge lengths are given for a number of faces other than the number of faces.
    LengthCount {
        /// Number of faces.
        faces: usize,
        /// Number of length triples.
        lengths: usize,
    },
    /// A face names a vertex that does not exist.
    IndexOutOfRange {
        /// The offending face.
        face: usize,
        /// The vertex it names.
        vertex: u32,
    },
    /// A face names one vertex twice.
    RepeatedVertex {
        /// The offending face.
        face: usize,
    },
    /// A coordinate is NaN or infinite.
    NonFinite {
        /// The offending vertex.
        vertex: usize,
    },
    /// A face without area (or whose edge lengths violate the triangle inequality): its cotangents are infinite.
    ZeroAreaFace {
        /// The offending face.
        face: usize,
    },
    /// A vertex without a face has no area, and the eigenproblem needs a positive one.
    UnreferencedVertex {
        /// The offending vertex.
        vertex: usize,
    },
    /// A vertex's area under- or overflows 64-bit floats.
    NotPositive {
        /// The offending vertex.
        vertex: usize,
    },
    /// Edge flips need at most two faces at every edge.
    NonManifoldEdge {
        /// The edge's ends, smaller first.
        vertices: [u32; 2],
        /// How many faces it has.
        faces: usize,
    },
    /// Edge flips need an orientable surface; this face closes a Moebius band.
    NotOrientable {
        /// The offending face.
        face: usize,
    },
    /// Edge flips did not end: lengths too extreme for 64-bit floats.
    DelaunayStalled {
        /// Flips done.
        flips: usize,
    },
    /// The caller said to stop.
    Cancelled,
}

impl fmt::Display for LaplacianError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => write!(f, "the mesh has no faces"),
            Self::TooLarge => write!(f, "the mesh has more vertices or half-edges than 32-bit indices can number"),
            Self::LengthCount { faces, lengths } => {
                write!(f, "{lengths} triples of edge lengths for {faces} faces")
            }
            Self::IndexOutOfRange { face, vertex } => {
                write!(f, "face {face} names vertex {vertex}, which does not exist")
            }
            Self::RepeatedVertex { face } => write!(f, "face {face} names one vertex twice"),
            Self::NonFinite { vertex } => {
                write!(f, "vertex {vertex} has a coordinate that is not finite")
            }
            Self::ZeroAreaFace { face } => write!(f, "face {face} has no area"),
            Self::UnreferencedVertex { vertex } => write!(f, "vertex {vertex} belongs to no face"),
            Self::NotPositive { vertex } => write!(f, "the area of vertex {vertex} is not a positive 64-bit float"),
            Self::NonManifoldEdge { vertices: [a, b], faces } => {
                write!(f, "edge {a}-{b} has {faces} faces; the intrinsic Delaunay triangulation allows two")
            }
            Self::NotOrientable { face } => {
                write!(f, "the surface is not orientable (found at face {face})")
            }
            Self::DelaunayStalled { flips } => {
                write!(f, "the intrinsic Delaunay triangulation was not reached in {flips} flips")
            }
            Self::Cancelled => write!(f, "cancelled"),
        }
    }
}

impl std::error::Error for LaplacianError {}
