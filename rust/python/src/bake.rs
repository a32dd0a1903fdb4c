use numpy::{
    IntoPyArray, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArray3, PyUntypedArrayMethods,
};
use phaseatlas_core::bake as core;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;

use crate::mesh::rows;
use crate::pool::detached;
use crate::raster::corners;
use crate::to_python;

/// An image of bytes, or of floating-point numbers in [0, 1].
#[derive(FromPyObject)]
pub enum Image<'py> {
    Bytes(PyReadonlyArray3<'py, u8>),
    Floats(PyReadonlyArray3<'py, f64>),
}

impl Image<'_> {
    fn core(&self) -> PyResult<core::Image<'_>> {
        let shape = |shape: &[usize]| [shape[0], shape[1], shape[2]];
        match self {
            Self::Bytes(array) => core::Image::from_bytes(array.as_slice()?, shape(array.shape())),
            Self::Floats(array) => {
                core::Image::from_floats(array.as_slice()?, shape(array.shape()))
            }
        }
        .map_err(to_python)
    }
}

/// The values (k, c) of an image at places (k, 2) of the plane.
#[pyfunction]
pub fn sample<'py>(
    py: Python<'py>,
    image: Image<'py>,
    places: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let image = image.core()?;
    let places = rows::<2, f64>("uv", &places)?;
    let channels = image.channels();
    let values = detached(py, || {
        let mut values = vec![0.0; places.len() * channels];
        for (place, values) in places.iter().zip(values.chunks_exact_mut(channels)) {
            image.sample(*place, values);
        }
        values
    })?;
    values.into_pyarray(py).reshape([places.len(), channels])
}

/// An image while textures are baked into it.
#[pyclass(module = "phaseatlas._core")]
pub struct Bake {
    /// [`None`] once the image is taken.
    core: Option<core::Bake>,
    resolution: usize,
}

#[pymethods]
impl Bake {
    #[new]
    #[expect(
        clippy::too_many_arguments,
        reason = "they are arrays of what the core has types for"
    )]
    fn new(
        py: Python<'_>,
        uv: PyReadonlyArray3<'_, f64>,
        faces: PyReadonlyArray1<'_, i64>,
        triangles: PyReadonlyArray2<'_, i64>,
        places: PyReadonlyArray2<'_, f64>,
        weights: Option<PyReadonlyArray1<'_, f64>>,
        scale: f64,
        resolution: usize,
        background: [u8; 3],
    ) -> PyResult<Self> {
        let corners = corners(&uv)?.to_vec();
        let faces = faces.as_slice()?;
        let triangles = rows::<3, i64>("triangles", &triangles)?;
        let points = rows::<2, f64>("places", &places)?;
        let weights = weights.map(|w| Ok::<_, PyErr>(w.as_slice()?.to_vec()));
        let weights = weights.transpose()?;
        let core = detached(py, || {
            let n_faces = corners.len() / 3;
            core::Charts::new(n_faces, faces, &triangles, points, weights)
                .and_then(|charts| core::Bake::new(corners, charts, scale, resolution, background))
        })?
        .map_err(to_python)?;
        Ok(Self {
            core: Some(core),
            resolution,
        })
    }

    #[getter]
    fn n_tiles(&self) -> PyResult<usize> {
        Ok(self.unfinished()?.n_tiles())
    }

    /// Where a tile asks for the texture, (k, 2).
    fn places<'py>(&self, py: Python<'py>, tile: usize) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let core = self.unfinished()?;
        let places = detached(py, || core.places(tile))?.map_err(to_python)?;
        let count = places.len();
        places.into_flattened().into_pyarray(py).reshape([count, 2])
    }

    /// Paints a tile with values (k, 3) at its places.
    fn paint_values(
        &mut self,
        py: Python<'_>,
        tile: usize,
        values: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<()> {
        if values.shape()[1] != 3 {
            return Err(PyValueError::new_err(format!(
                "values: shape {:?} must be (k, 3)",
                values.shape()
            )));
        }
        let (values, _) = values.as_slice()?.as_chunks();
        let core = self.unfinished_mut()?;
        detached(py, || core.paint_values(tile, values))?.map_err(to_python)
    }

    /// Paints a tile from an image of one channel or three.
    fn paint_image(&mut self, py: Python<'_>, tile: usize, image: Image<'_>) -> PyResult<()> {
        let image = image.core()?;
        let core = self.unfinished_mut()?;
        detached(py, || core.paint_image(tile, &image))?.map_err(to_python)
    }

    /// Fills the gutters and takes the image: nothing is left to paint on.
    #[pyo3(signature = (padding=None))]
    fn finish<'py>(
        &mut self,
        py: Python<'py>,
        padding: Option<usize>,
    ) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let core = self.unfinished_mut()?;
        if padding != Some(0) {
            detached(py, || core.prepare_gutters())?;
            for tile in 0..core.n_tiles() {
                py.check_signals()?;
                detached(py, || core.fill_gutters(tile, padding))?;
            }
        }
        let image = self.core.take().map(core::Bake::into_image);
        let shape = [self.resolution, self.resolution, 3];
        image.unwrap_or_default().into_pyarray(py).reshape(shape)
    }
}

impl Bake {
    fn unfinished(&self) -> PyResult<&core::Bake> {
        self.core.as_ref().ok_or_else(finished)
    }

    fn unfinished_mut(&mut self) -> PyResult<&mut core::Bake> {
        self.core.as_mut().ok_or_else(finished)
    }
}

fn finished() -> PyErr {
    PyRuntimeError::new_err("the image has been taken")
}
