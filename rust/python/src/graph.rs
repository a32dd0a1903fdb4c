use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use phaseatlas_core::{Error, graph};
use pyo3::prelude::*;

use crate::mesh::{TriangleMesh, rows};
use crate::pool::detached;
use crate::to_python;

/// Component of every face; two neighbours connect where their labels agree.
#[pyfunction]
pub fn label_components<'py>(
    py: Python<'py>,
    mesh: &TriangleMesh,
    labels: PyReadonlyArray1<'_, i64>,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let labels = labels.as_slice()?;
    if labels.len() != mesh.core().n_faces() {
        return Err(to_python(Error::Length {
            argument: "labels",
            actual: labels.len(),
            expected: mesh.core().n_faces(),
        }));
    }
    let components = detached(py, || graph::label_components(mesh.core(), labels))?;
    let labels: Vec<i64> = components.labels.into_iter().map(i64::from).collect();
    Ok(PyArray1::from_vec(py, labels))
}

/// Number of components of triangles over common edges, and the component of each triangle.
#[pyfunction]
pub fn edge_components<'py>(
    py: Python<'py>,
    triangles: PyReadonlyArray2<'_, i64>,
) -> PyResult<(usize, Bound<'py, PyArray1<i64>>)> {
    let triangles = rows::<3, i64>("triangles", &triangles)?;
    let (labels, count) = detached(py, || graph::edge_components(&triangles))?;
    Ok((
        count,
        PyArray1::from_iter(py, labels.into_iter().map(i64::from)),
    ))
}

/// Leaf of every unit, where whole units are shared out among the leaves of a tree.
///
/// Units and what covers them come as compressed rows; `splits` has a row a split node: first
/// leaf, first leaf of the second child, one past the last leaf.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "two matrices in compressed rows")]
pub fn share_out<'py>(
    py: Python<'py>,
    starts: PyReadonlyArray1<'_, i64>,
    neighbours: PyReadonlyArray1<'_, i64>,
    costs: PyReadonlyArray1<'_, f64>,
    areas: PyReadonlyArray1<'_, f64>,
    cover_starts: PyReadonlyArray1<'_, i64>,
    cover_leaves: PyReadonlyArray1<'_, i64>,
    cover_areas: PyReadonlyArray1<'_, f64>,
    shares: PyReadonlyArray1<'_, f64>,
    splits: PyReadonlyArray2<'_, i64>,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let units = graph::Units {
        starts: starts.as_slice()?,
        neighbours: neighbours.as_slice()?,
        costs: costs.as_slice()?,
        areas: areas.as_slice()?,
    };
    let coverage = graph::Coverage {
        starts: cover_starts.as_slice()?,
        leaves: cover_leaves.as_slice()?,
        areas: cover_areas.as_slice()?,
    };
    let n = units.areas.len();
    for (argument, actual, expected) in [
        ("starts", units.starts.len(), n + 1),
        ("costs", units.costs.len(), units.neighbours.len()),
        ("cover_starts", coverage.starts.len(), n + 1),
        ("cover_areas", coverage.areas.len(), coverage.leaves.len()),
        (
            "splits",
            splits.as_slice()?.len(),
            3 * (shares.len()?.saturating_sub(1)),
        ),
    ] {
        if actual != expected {
            return Err(to_python(Error::Length {
                argument,
                actual,
                expected,
            }));
        }
    }
    let shares = shares.as_slice()?;
    let splits: Vec<[usize; 3]> = splits
        .as_slice()?
        .chunks_exact(3)
        .map(|row| [row[0] as usize, row[1] as usize, row[2] as usize])
        .collect();
    let leaves = detached(py, || graph::share_out(&units, &coverage, shares, &splits))?;
    Ok(PyArray1::from_vec(
        py,
        leaves.into_iter().map(i64::from).collect(),
    ))
}
