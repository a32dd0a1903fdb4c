//! Modica-Mortola perimeter, equations (1), (5) and, weighted, (7), (9).

use std::sync::Arc;

use rayon::prelude::*;

use super::functional::Functional;
use crate::error::{
    Result, check_factors, check_length, check_non_negative, check_positive, check_vector,
    check_weight,
};
use crate::operators::Stiffness;
use crate::parallel::{CHUNK, ordered_sum};
use crate::potentials::{psi, psi_prime, psi_second};
use crate::surface::Surface;

/// P\[u\] = eps/2 u^T S u + 1/eps m^T Psi(u), equation (5), and within a parent's indicator w
/// P\[u\] = eps/2 u^T S^w u + 1/eps m^T ((w + eta) . Psi(u)) + 1/sigma m^T ((1 - w) . u^2),
/// equations (7), (9).
///
/// The sharp limit is sqrt(2) times the length of the interface. With a factor g on the length of
/// seams every integrand is multiplied by g, and the limit is the integral of g along the interface.
///
/// # Examples
/// ```
/// use std::sync::Arc;
///
/// use phaseatlas_core::functionals::{Functional, Perimeter};
/// use phaseatlas_core::{Surface, TriangleMesh};
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// let square = TriangleMesh::new(corners, &[[0, 1, 2], [0, 2, 3]])?;
/// let perimeter = Perimeter::new(Arc::new(Surface::new(square)), 0.1)?;
/// let mut gradient = [0.0; 4];
/// // A pure phase has no interface; of a mixed one all costs the double well, 9 / 16 at u = 0.
/// assert_eq!(perimeter.value_and_gradient(&[1.0; 4], &mut gradient)?, 0.0);
/// let mixed = perimeter.value_and_gradient(&[0.0; 4], &mut gradient)?;
/// assert!((mixed - 9.0 / 16.0 / 0.1).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Perimeter {
    surface: Arc<Surface>,
    epsilon: f64,
    stiffness: Stiffness,
    /// m g (w + eta) / eps
    well: Vec<f64>,
    /// m g (1 - w) / sigma; empty without a parent
    confinement: Vec<f64>,
}

/// What [`Perimeter::costed`] is confined to: see [`Perimeter::weighted`].
#[derive(Debug, Clone, Copy)]
pub struct Parent<'a> {
    /// Indicator of the parent at the vertices.
    pub weight: &'a [f64],
    /// Added to the indicator.
    pub eta: f64,
    /// Of the penalty outside the parent.
    pub sigma: f64,
}

impl Perimeter {
    /// The perimeter on the whole surface, equation (5).
    ///
    /// # Errors
    /// `epsilon` that is not positive.
    pub fn new(surface: Arc<Surface>, epsilon: f64) -> Result<Self> {
        check_positive("epsilon", epsilon)?;
        let mesh = surface.mesh();
        Ok(Self {
            epsilon,
            stiffness: Stiffness::new(mesh),
            well: mesh.mass().iter().map(|m| m / epsilon).collect(),
            confinement: Vec::new(),
            surface,
        })
    }

    /// The perimeter within the parent's indicator `weight`, equation (9).
    ///
    /// # Errors
    /// `epsilon` or `sigma` that is not positive, `eta` that is negative, `weight` of another
    /// length or outside [0, 1].
    pub fn weighted(
        surface: Arc<Surface>,
        epsilon: f64,
        weight: &[f64],
        eta: f64,
        sigma: f64,
    ) -> Result<Self> {
        check_positive("epsilon", epsilon)?;
        check_positive("sigma", sigma)?;
        check_non_negative("eta", eta)?;
        let mesh = surface.mesh();
        check_weight("weight", weight, mesh.n_vertices())?;
        let mass = mesh.mass().iter().zip(weight);
        Ok(Self {
            epsilon,
            stiffness: Stiffness::weighted(mesh, weight, eta),
            well: mass.clone().map(|(m, w)| m * (w + eta) / epsilon).collect(),
            confinement: mass.map(|(m, w)| m * (1.0 - w) / sigma).collect(),
            surface,
        })
    }

    /// The perimeter with a factor on the length of the interface at every vertex, on the whole
    /// surface or within a parent.
    ///
    /// The penalty outside the parent takes the factor as well: a field then fades where it does
    /// without, and a constant factor is one of the whole functional.
    ///
    /// # Errors
    /// As [`Self::new`] and [`Self::weighted`]; `seam_cost` of another length or not positive.
    pub fn costed(
        surface: Arc<Surface>,
        epsilon: f64,
        parent: Option<Parent<'_>>,
        seam_cost: &[f64],
    ) -> Result<Self> {
        let mut perimeter = match parent {
            None => Self::new(surface, epsilon)?,
            Some(Parent { weight, eta, sigma }) => {
                Self::weighted(surface, epsilon, weight, eta, sigma)?
            }
        };
        let mesh = perimeter.surface.mesh();
        check_factors("seam_cost", seam_cost, mesh.n_vertices())?;
        let factor: Vec<f64> = match parent {
            None => seam_cost.to_vec(),
            Some(Parent { weight, eta, .. }) => seam_cost
                .iter()
                .zip(weight)
                .map(|(g, w)| g * (w + eta))
                .collect(),
        };
        perimeter.stiffness.refill(mesh, &factor, 0.0);
        for values in [&mut perimeter.well, &mut perimeter.confinement] {
            for (value, g) in values.iter_mut().zip(seam_cost) {
                *value *= g;
            }
        }
        Ok(perimeter)
    }

    /// The Hessian eps S^w + diag(1/eps m (w + eta) . Psi''(u) + 2/sigma m (1 - w)) at `u`: its
    /// off-diagonal entries, one an edge of the mesh, and its diagonal.
    ///
    /// # Errors
    /// `u` of another length or not finite.
    pub fn hessian(&self, u: &[f64]) -> Result<(Vec<f64>, Vec<f64>)> {
        let mesh = self.surface.mesh();
        check_vector("u", u, mesh.n_vertices())?;
        let edge_values = self.stiffness.edge_values();
        let edges = edge_values.iter().map(|s| self.epsilon * s).collect();
        let diagonal = u
            .par_iter()
            .with_min_len(CHUNK)
            .enumerate()
            .map(|(i, &ui)| {
                let diagonal = self.stiffness.diagonal(mesh.adjacency(), i);
                let confinement = self.confinement.get(i).unwrap_or(&0.0);
                self.well[i] * psi_second(ui) + self.epsilon * diagonal + 2.0 * confinement
            })
            .collect();
        Ok((edges, diagonal))
    }
}

impl Functional for Perimeter {
    fn value_and_gradient(&self, u: &[f64], gradient: &mut [f64]) -> Result<f64> {
        let mesh = self.surface.mesh();
        check_vector("u", u, mesh.n_vertices())?;
        check_length("gradient", gradient.len(), u.len())?;
        let parts = gradient
            .par_chunks_mut(CHUNK)
            .enumerate()
            .map(|(chunk, gradient)| {
                let first = chunk * CHUNK;
                let mut sum = 0.0;
                for (offset, g) in gradient.iter_mut().enumerate() {
                    let i = first + offset;
                    let ui = u[i];
                    let flux = self.epsilon * self.stiffness.apply_row(mesh.adjacency(), u, i);
                    sum += 0.5 * ui * flux + self.well[i] * psi(ui);
                    *g = flux + self.well[i] * psi_prime(ui);
                }
                if !self.confinement.is_empty() {
                    for (offset, g) in gradient.iter_mut().enumerate() {
                        let force = self.confinement[first + offset] * u[first + offset];
                        sum += force * u[first + offset];
                        *g += 2.0 * force;
                    }
                }
                sum
            });
        Ok(ordered_sum(parts))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{check_gradient, grid, noise};

    #[test]
    fn straight_interface_has_sqrt_two_times_its_length() {
        let surface = Arc::new(Surface::new(grid(200, 20, |_, _| 0.0)));
        let mesh = surface.mesh();
        let epsilon = 0.04;
        let perimeter = Perimeter::new(surface.clone(), epsilon).unwrap();
        let u: Vec<f64> = mesh
            .vertices()
            .iter()
            .map(|p| (3.0 * (p[0] - 0.5) / (2.0 * 2_f64.sqrt() * epsilon)).tanh())
            .collect();
        let mut gradient = vec![0.0; u.len()];
        let value = perimeter.value_and_gradient(&u, &mut gradient).unwrap();
        assert!((value - 2_f64.sqrt()).abs() < 5e-3, "{value}");
    }

    #[test]
    fn gradients() {
        let surface = Arc::new(Surface::new(grid(30, 20, |x, y| 0.2 * (5.0 * x).sin() * y)));
        let mesh = surface.mesh();
        let u = noise(mesh.n_vertices());
        check_gradient(&Perimeter::new(surface.clone(), 0.1).unwrap(), &u, 1e-7);
        let weight: Vec<f64> = mesh.vertices().iter().map(|p| p[0].min(1.0)).collect();
        let weighted = Perimeter::weighted(surface, 0.1, &weight, 1e-3, 0.5).unwrap();
        check_gradient(&weighted, &u, 1e-7);
    }

    #[test]
    fn a_straight_interface_costs_the_factor_where_it_runs() {
        let surface = Arc::new(Surface::new(grid(200, 20, |_, _| 0.0)));
        let vertices = surface.mesh().vertices();
        let epsilon = 0.02;
        // The factor is linear and the profile is even: its first moment vanishes.
        let cost: Vec<f64> = vertices.iter().map(|p| 1.0 + 3.0 * p[0]).collect();
        let perimeter = Perimeter::costed(surface.clone(), epsilon, None, &cost).unwrap();
        for x in [0.3, 0.5, 0.7] {
            let profile = |p: &[f64; 3]| (3.0 * (p[0] - x) / (2.0 * 2_f64.sqrt() * epsilon)).tanh();
            let u: Vec<f64> = vertices.iter().map(profile).collect();
            let mut gradient = vec![0.0; u.len()];
            let value = perimeter.value_and_gradient(&u, &mut gradient).unwrap();
            let expected = 2_f64.sqrt() * (1.0 + 3.0 * x);
            assert!((value / expected - 1.0).abs() < 1e-2, "{value} {expected}");
        }
    }

    #[test]
    fn a_constant_factor_is_one_of_the_functional() {
        let surface = Arc::new(Surface::new(grid(30, 20, |x, y| 0.2 * (5.0 * x).sin() * y)));
        let n = surface.mesh().n_vertices();
        let u = noise(n);
        let weight: Vec<f64> = surface
            .mesh()
            .vertices()
            .iter()
            .map(|p| p[0].min(1.0))
            .collect();
        let parent = Parent {
            weight: &weight,
            eta: 1e-3,
            sigma: 0.5,
        };
        let (mut one, mut three) = (vec![0.0; n], vec![0.0; n]);
        let plain = Perimeter::weighted(surface.clone(), 0.1, &weight, 1e-3, 0.5).unwrap();
        let costed = Perimeter::costed(surface.clone(), 0.1, Some(parent), &vec![3.0; n]).unwrap();
        let before = plain.value_and_gradient(&u, &mut one).unwrap();
        let after = costed.value_and_gradient(&u, &mut three).unwrap();
        assert!((after / before - 3.0).abs() < 1e-13);
        for (a, b) in one.iter().zip(&three) {
            assert!((3.0 * a - b).abs() < 1e-10);
        }
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let mut cost = vec![1.0; n];
            cost[7] = bad;
            let error = Perimeter::costed(surface.clone(), 0.1, None, &cost).unwrap_err();
            assert!(error.to_string().starts_with("seam_cost[7]: "), "{error}");
        }
        assert!(Perimeter::costed(surface, 0.1, None, &vec![1.0; n - 1]).is_err());
    }

    #[test]
    fn hessian_is_the_derivative_of_the_gradient() {
        let surface = Arc::new(Surface::new(grid(30, 20, |x, y| 0.2 * (5.0 * x).sin() * y)));
        let mesh = surface.mesh();
        let n = mesh.n_vertices();
        let weight: Vec<f64> = mesh.vertices().iter().map(|p| p[0].min(1.0)).collect();
        let u = noise(n);
        let cost: Vec<f64> = u.iter().map(|u| 1.2 + u).collect();
        let parent = Parent {
            weight: &weight,
            eta: 1e-3,
            sigma: 0.5,
        };
        let direction: Vec<f64> = (0..n).map(|i| (i as f64 * 0.7 + 0.3).sin()).collect();
        for perimeter in [
            Perimeter::new(surface.clone(), 0.1).unwrap(),
            Perimeter::weighted(surface.clone(), 0.1, &weight, 1e-3, 0.5).unwrap(),
            Perimeter::costed(surface.clone(), 0.1, None, &cost).unwrap(),
            Perimeter::costed(surface.clone(), 0.1, Some(parent), &cost).unwrap(),
        ] {
            let (edges, diagonal) = perimeter.hessian(&u).unwrap();
            let mut product: Vec<f64> = diagonal
                .iter()
                .zip(&direction)
                .map(|(h, d)| h * d)
                .collect();
            for (h, &[a, b]) in edges.iter().zip(mesh.edges()) {
                let (a, b) = (a as usize, b as usize);
                product[a] += h * direction[b];
                product[b] += h * direction[a];
            }
            let step = 1e-5;
            let at = |t: f64| {
                let moved: Vec<f64> = u.iter().zip(&direction).map(|(u, d)| u + t * d).collect();
                let mut gradient = vec![0.0; n];
                perimeter.value_and_gradient(&moved, &mut gradient).unwrap();
                gradient
            };
            let (plus, minus) = (at(step), at(-step));
            for i in 0..n {
                let difference = (plus[i] - minus[i]) / (2.0 * step);
                assert!((difference - product[i]).abs() < 1e-8, "row {i}");
            }
        }
        let perimeter = Perimeter::new(surface, 0.1).unwrap();
        assert!(perimeter.hessian(&u[1..]).is_err());
    }
}
