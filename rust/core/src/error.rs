//! Everything a caller can do wrong, named by argument, index and value.

use thiserror::Error;

/// An input that cannot be used. The message names the argument, the index and the value.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Error {
    /// A mesh without vertices or without faces.
    #[error("{argument}: must not be empty; a surface has at least one vertex and one face")]
    Empty {
        /// Name of the argument.
        argument: &'static str,
    },
    /// A mesh of more than 2^32 half-edges.
    #[error("faces: {n_vertices} vertices and {n_faces} faces must be fewer; indices have 32 bits")]
    TooLarge {
        /// Number of vertices.
        n_vertices: usize,
        /// Number of faces.
        n_faces: usize,
    },
    /// A coordinate that is NaN or infinite.
    #[error("vertices[{vertex}]: coordinate {axis} is {value}, must be a finite number")]
    NonFiniteVertex {
        /// Index of the vertex.
        vertex: usize,
        /// 0, 1 or 2 for x, y or z.
        axis: usize,
        /// The coordinate.
        value: f64,
    },
    /// A face that names no vertex of the mesh.
    #[error("faces[{face}]: vertex index {index} must be in 0..{n_vertices}")]
    IndexOutOfRange {
        /// Index of the face.
        face: usize,
        /// What stands for a vertex.
        index: i64,
        /// Number of vertices.
        n_vertices: usize,
    },
    /// A face that names a vertex twice.
    #[error("faces[{face}]: degenerate face {vertices:?} names a vertex twice")]
    RepeatedVertex {
        /// Index of the face.
        face: usize,
        /// Its vertices.
        vertices: [u32; 3],
    },
    /// A face whose area is none beside its longest edge, or no number.
    #[error(
        "faces[{face}]: degenerate face {vertices:?} has area {area:e} and longest edge {diameter:e}"
    )]
    DegenerateFace {
        /// Index of the face.
        face: usize,
        /// Its vertices.
        vertices: [u32; 3],
        /// Its area.
        area: f64,
        /// Its longest edge.
        diameter: f64,
    },
    /// A vertex that no face uses.
    #[error("vertices[{vertex}]: unreferenced vertex, no face uses it")]
    UnreferencedVertex {
        /// Index of the vertex.
        vertex: usize,
    },
    /// An edge of three or more faces.
    #[error("faces: non-manifold edge ({0}, {1}) belongs to {count} faces, first to faces {faces:?}", edge[0], edge[1])]
    NonManifoldEdge {
        /// Ends of the edge.
        edge: [u32; 2],
        /// Number of its faces.
        count: usize,
        /// The first of them.
        faces: [usize; 3],
    },
    /// Two neighbours that face different ways.
    #[error("faces: inconsistent orientation, faces {} and {} run along edge ({}, {}) in the same direction", faces[0], faces[1], edge[0], edge[1])]
    InconsistentOrientation {
        /// Ends of the common edge.
        edge: [u32; 2],
        /// The two faces.
        faces: [usize; 2],
    },
    /// A vertex where faces touch that do not hang together across its edges.
    #[error("vertices[{vertex}]: non-manifold vertex, its {incident} faces do not form one fan")]
    NonManifoldVertex {
        /// Index of the vertex.
        vertex: usize,
        /// Number of its faces.
        incident: usize,
    },
    /// A mesh of several components.
    #[error(
        "faces: disconnected surface of {count} components; faces 0 and {face} lie in different ones"
    )]
    Disconnected {
        /// Number of components.
        count: usize,
        /// First face that is not in the component of the first.
        face: usize,
    },
    /// A line of a file that does not say what it should.
    #[error("line {line}: {reason}")]
    Syntax {
        /// Number of the line, from 1.
        line: usize,
        /// What is wrong.
        reason: String,
    },
    /// An array of another length than it has to have.
    #[error("{argument}: length {actual} must be {expected}")]
    Length {
        /// Name of the argument.
        argument: &'static str,
        /// Its length.
        actual: usize,
        /// What it has to be.
        expected: usize,
    },
    /// An entry that is NaN or infinite.
    #[error("{argument}[{index}]: {value} must be a finite number")]
    NonFinite {
        /// Name of the argument.
        argument: &'static str,
        /// Index of the entry.
        index: usize,
        /// The entry.
        value: f64,
    },
    /// An entry outside an interval.
    #[error("{argument}[{index}]: {value} must be in [{low}, {high}]")]
    OutsideRange {
        /// Name of the argument.
        argument: &'static str,
        /// Index of the entry.
        index: usize,
        /// The entry.
        value: f64,
        /// Least value.
        low: f64,
        /// Largest value.
        high: f64,
    },
    /// An entry that is no index of anything.
    #[error("{argument}[{position}]: {index} must be in 0..{count}")]
    Index {
        /// Name of the argument.
        argument: &'static str,
        /// Position of the entry.
        position: usize,
        /// The entry.
        index: i64,
        /// Number of what is indexed.
        count: usize,
    },
    /// An image whose values do not fill its shape.
    #[error("image: {length} values must fill the shape {shape:?}")]
    Image {
        /// Number of values.
        length: usize,
        /// Height, width, channels.
        shape: [usize; 3],
    },
    /// A face of a layout that no chart covers.
    #[error("charts: face {face} is in no chart with a positive weight")]
    Uncharted {
        /// Index of the face.
        face: usize,
    },
    /// A value that must be above 0.
    #[error("{argument}[{index}]: {value} must be a positive number")]
    NotPositive {
        /// Name of the argument.
        argument: &'static str,
        /// Where.
        index: usize,
        /// What is there.
        value: f64,
    },
    /// A parameter out of range.
    #[error("{argument}: {value} must be {expected}")]
    Parameter {
        /// Name of the argument.
        argument: &'static str,
        /// Its value.
        value: f64,
        /// What it has to be.
        expected: &'static str,
    },
    /// A matrix that has no Cholesky factor.
    #[error("{argument}: matrix of {size} rows is not positive definite at vertex {vertex}")]
    NotPositiveDefinite {
        /// Name of the argument.
        argument: &'static str,
        /// Number of rows.
        size: usize,
        /// The vertex whose pivot is not a positive number.
        vertex: usize,
    },
    /// A set of faces that cannot be mapped to the plane.
    #[error("{argument}: {reason}")]
    Topology {
        /// Name of the argument.
        argument: &'static str,
        /// What is wrong.
        reason: String,
    },
    /// Too little memory.
    #[error("{argument}: out of memory for {size} {unit}")]
    OutOfMemory {
        /// Name of the argument.
        argument: &'static str,
        /// Number of what takes the memory.
        size: usize,
        /// What takes the memory.
        unit: &'static str,
    },
}

/// The result of everything that checks its input.
pub type Result<T> = std::result::Result<T, Error>;

/// Checks that an array has the length that it has to have.
pub(crate) fn check_length(argument: &'static str, actual: usize, expected: usize) -> Result<()> {
    if actual == expected {
        return Ok(());
    }
    Err(Error::Length {
        argument,
        actual,
        expected,
    })
}

/// Checks length and finiteness of a vector with one value a vertex (or a face).
pub(crate) fn check_vector(argument: &'static str, values: &[f64], expected: usize) -> Result<()> {
    check_length(argument, values.len(), expected)?;
    let Some(index) = values.iter().position(|value| !value.is_finite()) else {
        return Ok(());
    };
    Err(Error::NonFinite {
        argument,
        index,
        value: values[index],
    })
}

/// Checks an indicator: one value in [0, 1] a vertex.
pub(crate) fn check_weight(argument: &'static str, values: &[f64], expected: usize) -> Result<()> {
    check_vector(argument, values, expected)?;
    let (low, high) = (0.0, 1.0);
    let Some(index) = values
        .iter()
        .position(|value| !(low..=high).contains(value))
    else {
        return Ok(());
    };
    Err(Error::OutsideRange {
        argument,
        index,
        value: values[index],
        low,
        high,
    })
}

/// Checks factors on the length of seams: one positive number a vertex.
pub(crate) fn check_factors(argument: &'static str, values: &[f64], expected: usize) -> Result<()> {
    check_vector(argument, values, expected)?;
    let Some(index) = values.iter().position(|&value| value <= 0.0) else {
        return Ok(());
    };
    Err(Error::NotPositive {
        argument,
        index,
        value: values[index],
    })
}

/// Checks a parameter that is `legal` or must be what `expected` says.
pub(crate) fn check_parameter(
    argument: &'static str,
    value: f64,
    legal: bool,
    expected: &'static str,
) -> Result<()> {
    if legal {
        return Ok(());
    }
    Err(Error::Parameter {
        argument,
        value,
        expected,
    })
}

/// Checks a number above 0.
pub(crate) fn check_positive(argument: &'static str, value: f64) -> Result<()> {
    let legal = value.is_finite() && value > 0.0;
    check_parameter(argument, value, legal, "a positive number")
}

/// Checks a number of at least 0.
pub(crate) fn check_non_negative(argument: &'static str, value: f64) -> Result<()> {
    let legal = value.is_finite() && value >= 0.0;
    check_parameter(argument, value, legal, "a non-negative number")
}

/// Checks the margin of the indicator chi.
pub(crate) fn check_delta(value: f64) -> Result<()> {
    check_parameter("delta", value, (0.0..1.0).contains(&value), "in [0, 1)")
}

/// `n` copies of a value, one a texel, or an error where there is no memory for them.
pub(crate) fn try_filled<T: Copy>(argument: &'static str, n: usize, value: T) -> Result<Vec<T>> {
    let mut values = Vec::new();
    values
        .try_reserve_exact(n)
        .map_err(|_| Error::OutOfMemory {
            argument,
            size: n,
            unit: "texels",
        })?;
    values.resize(n, value);
    Ok(values)
}
