//! Area of the positive phase, equations (2) and (10).

use rayon::prelude::*;

use super::functional::Functional;
use crate::error::{Result, check_delta, check_length, check_vector, check_weight};
use crate::mesh::TriangleMesh;
use crate::parallel::{CHUNK, ordered_sum};
use crate::potentials::{chi, chi_prime, chi_second};

/// A_alpha\[u\] = m^T (w . chi(u)), equations (2) and (10): the area of the positive phase, within
/// the parent's indicator w (w = 1 on the first level).
///
/// # Examples
/// ```
/// use phaseatlas_core::TriangleMesh;
/// use phaseatlas_core::functionals::{Area, Functional};
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// let square = TriangleMesh::new(corners, &[[0, 1, 2], [0, 2, 3]])?;
/// let area = Area::new(&square, 0.01, None)?;
/// let value = area.value_and_gradient(&[1.0, 0.0, -1.0, 0.0], &mut [0.0; 4])?;
/// assert_eq!(value, 0.5 * area.total());
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Area {
    delta: f64,
    measure: Vec<f64>,
}

impl Area {
    /// Measures the mass of the vertices within the parent.
    ///
    /// # Errors
    /// `delta` outside [0, 1), `weight` of another length or outside [0, 1].
    pub fn new(mesh: &TriangleMesh, delta: f64, weight: Option<&[f64]>) -> Result<Self> {
        check_delta(delta)?;
        let mut measure = mesh.mass().to_vec();
        if let Some(weight) = weight {
            check_weight("weight", weight, mesh.n_vertices())?;
            measure.iter_mut().zip(weight).for_each(|(m, w)| *m *= w);
        }
        Ok(Self { delta, measure })
    }

    /// The area of both phases together, m^T w.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.measure.iter().sum()
    }

    /// The diagonal m w . chi''(u) of the Hessian at `u`, which has no other entries. It jumps
    /// where |u| passes 1 - delta.
    ///
    /// # Errors
    /// `u` of another length or not finite.
    pub fn hessian(&self, u: &[f64]) -> Result<Vec<f64>> {
        check_vector("u", u, self.measure.len())?;
        let measure = u.iter().zip(&self.measure);
        Ok(measure
            .map(|(&u, m)| m * chi_second(u, self.delta))
            .collect())
    }
}

impl Functional for Area {
    fn value_and_gradient(&self, u: &[f64], gradient: &mut [f64]) -> Result<f64> {
        check_vector("u", u, self.measure.len())?;
        check_length("gradient", gradient.len(), u.len())?;
        let delta = self.delta;
        let parts = gradient
            .par_chunks_mut(CHUNK)
            .zip(u.par_chunks(CHUNK))
            .zip(self.measure.par_chunks(CHUNK))
            .map(|((gradient, u), measure)| {
                let mut sum = 0.0;
                for ((g, &u), &m) in gradient.iter_mut().zip(u).zip(measure) {
                    *g = m * chi_prime(u, delta);
                    sum += m * chi(u, delta);
                }
                sum
            });
        Ok(ordered_sum(parts))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;
    use crate::testing::{check_gradient, grid, noise};

    #[test]
    fn phases_share_the_surface() {
        let mesh = grid(20, 20, |x, y| x * y);
        let area = Area::new(&mesh, 0.01, None).unwrap();
        let u = noise(mesh.n_vertices());
        let minus: Vec<f64> = u.iter().map(|x| -x).collect();
        let mut gradient = vec![0.0; u.len()];
        let positive = area.value_and_gradient(&u, &mut gradient).unwrap();
        let negative = area.value_and_gradient(&minus, &mut gradient).unwrap();
        assert!((positive + negative - mesh.area()).abs() < 1e-13);
        check_gradient(&area, &u, 1e-7);
    }

    #[test]
    fn hessian_is_the_derivative_of_the_gradient() {
        let mesh = grid(20, 20, |x, y| x * y);
        let area = Area::new(&mesh, 0.02, None).unwrap();
        let u = noise(mesh.n_vertices());
        let diagonal = area.hessian(&u).unwrap();
        let step = 1e-6;
        let at = |t: f64| {
            let moved: Vec<f64> = u.iter().map(|u| u + t).collect();
            let mut gradient = vec![0.0; u.len()];
            area.value_and_gradient(&moved, &mut gradient).unwrap();
            gradient
        };
        let (plus, minus) = (at(step), at(-step));
        for i in 0..u.len() {
            let difference = (plus[i] - minus[i]) / (2.0 * step);
            assert!((difference - diagonal[i]).abs() < 1e-8, "vertex {i}");
        }
    }

    #[test]
    fn bad_input_is_named() {
        let mesh = grid(2, 2, |_, _| 0.0);
        assert!(Area::new(&mesh, 1.0, None).is_err());
        assert!(Area::new(&mesh, 0.0, Some(&[2.0; 9])).is_err());
        let area = Area::new(&mesh, 0.0, None).unwrap();
        let error = area.value_and_gradient(&[0.0; 3], &mut [0.0; 3]);
        assert!(matches!(error, Err(Error::Length { argument: "u", .. })));
    }
}
