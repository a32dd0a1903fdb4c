//! Everything a caller can do wrong, named by argument, index and value.

use thiserror::Error;

/// An input that cannot be used. The message names the argument, the index and the value.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Error {
    #[error("{argument}: empty; a surface needs at least one vertex and one face")]
    Empty { argument: &'static str },
    #[error(
        "faces: {n_vertices} vertices and {n_faces} faces are more than indices of 32 bits hold"
    )]
    TooLarge { n_vertices: usize, n_faces: usize },
    #[error("vertices[{vertex}]: coordinate {axis} is {value}, not a finite number")]
    NonFiniteVertex {
        vertex: usize,
        axis: usize,
        value: f64,
    },
    #[error("faces[{face}]: vertex index {index} is outside 0..{n_vertices}")]
    IndexOutOfRange {
        face: usize,
        index: i64,
        n_vertices: usize,
    },
    #[error("faces[{face}]: degenerate face {vertices:?} names a vertex twice")]
    RepeatedVertex { face: usize, vertices: [u32; 3] },
    #[error(
        "faces[{face}]: degenerate face {vertices:?} has area {area:e} and longest edge {diameter:e}"
    )]
    DegenerateFace {
        face: usize,
        vertices: [u32; 3],
        area: f64,
        diameter: f64,
    },
    #[error("vertices[{vertex}]: unreferenced vertex, no face uses it")]
    UnreferencedVertex { vertex: usize },
    #[error("faces: non-manifold edge ({0}, {1}) belongs to {count} faces, first to faces {faces:?}", edge[0], edge[1])]
    NonManifoldEdge {
        edge: [u32; 2],
        count: usize,
        faces: [usize; 3],
    },
    #[error("faces: inconsistent orientation, faces {} and {} run along edge ({}, {}) in the same direction", faces[0], faces[1], edge[0], edge[1])]
    InconsistentOrientation { edge: [u32; 2], faces: [usize; 2] },
    #[error("vertices[{vertex}]: non-manifold vertex, its {incident} faces do not form one fan")]
    NonManifoldVertex { vertex: usize, incident: usize },
    #[error(
        "faces: disconnected surface of {count} components; faces 0 and {face} lie in different ones"
    )]
    Disconnected { count: usize, face: usize },
    #[error("line {line}: {reason}")]
    Syntax { line: usize, reason: String },
    #[error("{argument}: length {actual}, expected {expected}")]
    Length {
        argument: &'static str,
        actual: usize,
        expected: usize,
    },
    #[error("{argument}[{index}]: {value} is not a finite number")]
    NonFinite {
        argument: &'static str,
        index: usize,
        value: f64,
    },
    #[error("{argument}[{index}]: {value} is outside [{low}, {high}]")]
    OutsideRange {
        argument: &'static str,
        index: usize,
        value: f64,
        low: f64,
        high: f64,
    },
    #[error("{argument}[{position}]: {index} is outside 0..{count}")]
    Index {
        argument: &'static str,
        position: usize,
        index: i64,
        count: usize,
    },
    #[error("image: {length} values do not fill the shape {shape:?}")]
    Image { length: usize, shape: [usize; 3] },
    #[error("charts: face {face} is in no chart with a positive weight")]
    Uncharted { face: usize },
    #[error("{argument}: {value} must be {expected}")]
    Parameter {
        argument: &'static str,
        value: f64,
        expected: &'static str,
    },
    #[error("{argument}: matrix of {size} rows is not positive definite at vertex {vertex}")]
    NotPositiveDefinite {
        argument: &'static str,
        size: usize,
        vertex: usize,
    },
    #[error("{argument}: {reason}")]
    Topology {
        argument: &'static str,
        reason: String,
    },
    #[error("{argument}: out of memory for {size} {unit}")]
    OutOfMemory {
        argument: &'static str,
        size: usize,
        unit: &'static str,
    },
}

/// The result of everything that checks its input.
pub type Result<T> = std::result::Result<T, Error>;

pub(crate) fn check_length(argument: &'static str, actual: usize, expected: usize) -> Result<()> {
    if actual == expected {
        Ok(())
    } else {
        Err(Error::Length {
            argument,
            actual,
            expected,
        })
    }
}

/// Checks length and finiteness of a vector with one value a vertex (or a face).
pub(crate) fn check_vector(argument: &'static str, values: &[f64], expected: usize) -> Result<()> {
    check_length(argument, values.len(), expected)?;
    match values.iter().position(|value| !value.is_finite()) {
        None => Ok(()),
        Some(index) => Err(Error::NonFinite {
            argument,
            index,
            value: values[index],
        }),
    }
}

/// Checks an indicator: one value in [0, 1] a vertex.
pub(crate) fn check_weight(argument: &'static str, values: &[f64], expected: usize) -> Result<()> {
    check_vector(argument, values, expected)?;
    match values.iter().position(|value| !(0.0..=1.0).contains(value)) {
        None => Ok(()),
        Some(index) => Err(Error::OutsideRange {
            argument,
            index,
            value: values[index],
            low: 0.0,
            high: 1.0,
        }),
    }
}

pub(crate) fn check_positive(argument: &'static str, value: f64) -> Result<()> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        Err(Error::Parameter {
            argument,
            value,
            expected: "a positive number",
        })
    }
}

pub(crate) fn check_delta(value: f64) -> Result<()> {
    if (0.0..1.0).contains(&value) {
        Ok(())
    } else {
        Err(Error::Parameter {
            argument: "delta",
            value,
            expected: "in [0, 1)",
        })
    }
}

pub(crate) fn check_non_negative(argument: &'static str, value: f64) -> Result<()> {
    if value.is_finite() && value >= 0.0 {
        Ok(())
    } else {
        Err(Error::Parameter {
            argument,
            value,
            expected: "a non-negative number",
        })
    }
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
