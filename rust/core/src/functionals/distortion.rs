//! Conformal distortion of both phases with the diffuse Yamabe equation as constraint,
//! equations (12) and (13).

use std::sync::Arc;

use super::functional::Functional;
use crate::error::{
    Result, check_delta, check_length, check_non_negative, check_positive, check_vector,
    check_weight,
};
use crate::linear::Cholesky;
use crate::operators::Stiffness;
use crate::parallel::Buffers;
use crate::potentials::{chi, chi_prime};
use crate::surface::Surface;

/// Weight of the sharp formulation's penalty relative to 1 / epsilon^2.
const SHARP_PENALTY: f64 = 30.0;
/// By how much the other phase has to prevail, 1 - 2 c, for the sharp formulation to penalise s.
const SHARP_MARGIN: f64 = 0.5;

/// How the indicator c = w chi(u) enters the diffuse Yamabe equation
///
/// integral of a(c) \|grad s\|^2 / 2 - b(c) K s + p(c) s^2 / 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Formulation {
    /// Equation (12): a = c + eta, b = c, p = (1 - c) / epsilon.
    ///
    /// Its limit for epsilon to 0 is a Robin condition on the boundary, not s = 0: the penalty
    /// acts on a layer of width epsilon and stays of order one there. J is several times the
    /// energy of the sharp problem on features that are small beside the unit of length.
    Paper,
    /// a = 1, b = 1 - q, p = (30 q + eta) / epsilon^2 with q = max(0, 1 - 4 c)^2.
    ///
    /// The penalisation of a fictitious domain (Angot, Bruneau, Fabrie 1999): q vanishes where
    /// the phase prevails, up to c = 1/4 or u = -0.35 of the other one, and s decays within
    /// epsilon / sqrt(30) beyond, so that J tends to the energy of the sharp problem with s = 0 on
    /// u = 0, from above and with an error of order epsilon relative to the size of the segment,
    /// in any unit of length. A mixed phase, u = 0, belongs to both segments and is confined by
    /// none: mixing is never rewarded. Penalised from c = 1/2 on, a spot of the other phase on a peak
    /// of s would hold it at 0 while too faint for the sharp segments to show.
    Sharp,
}

/// Source and penalty at one vertex, and their derivatives by c.
struct Coefficients {
    source: f64,
    source_prime: f64,
    penalty: f64,
    penalty_prime: f64,
}

/// J\[u\] = s\[u\]^T M s\[u\] + s\[-u\]^T M s\[-u\] with A\[u\] s\[u\] = b\[u\], equation (13).
///
/// A\[u\] = S\[a\] + diag(m p), b\[u\] = K b(c), K the integrated angle defect; s = 0 on the boundary
/// of the surface, where a chart ends too. The gradient is
/// that of the adjoint, +2 (db - dA s)^T A^-1 M s. Both phases are factored side by side.
///
/// # Examples
/// ```
/// use std::sync::Arc;
///
/// use phaseatlas_core::functionals::{Distortion, Functional, Formulation};
/// use phaseatlas_core::{Surface, TriangleMesh};
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// // A flat roof of four triangles has nothing to distort, one with a peak has.
/// let distortion = |height: f64| -> phaseatlas_core::Result<f64> {
///     let rim = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]];
///     let vertices = [vec![[0.0, 0.0, height]], rim.to_vec()].concat();
///     let roof = TriangleMesh::new(vertices, &[[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]])?;
///     let surface = Arc::new(Surface::new(roof));
///     let functional = Distortion::new(surface, Formulation::Sharp, 0.5, 0.05, 1e-6, None)?;
///     functional.value_and_gradient(&[1.0; 5], &mut [0.0; 5])
/// };
/// assert!(distortion(0.0)? < 1e-20);
/// assert!(distortion(1.0)? > 0.01);
/// # Ok(())
/// # }
/// ```
pub struct Distortion {
    surface: Arc<Surface>,
    formulation: Formulation,
    epsilon: f64,
    delta: f64,
    eta: f64,
    weight: Option<Vec<f64>>,
    systems: Buffers<[System; 2]>,
}

/// The linear system of one phase and its buffers.
struct System {
    cholesky: Cholesky,
    /// a(c); the sharp formulation never refills it
    stiffness: Stiffness,
    values: Vec<f64>,
    indicator: Vec<f64>,
    penalty: Vec<f64>,
    solution: Vec<f64>,
    adjoint: Vec<f64>,
    gradient: Vec<f64>,
}

impl Formulation {
    fn at(self, c: f64, epsilon: f64, eta: f64) -> Coefficients {
        match self {
            Self::Paper => Coefficients {
                source: c,
                source_prime: 1.0,
                penalty: (1.0 - c) / epsilon,
                penalty_prime: -1.0 / epsilon,
            },
            Self::Sharp => {
                let t = ((1.0 - SHARP_MARGIN - 2.0 * c) / (1.0 - SHARP_MARGIN)).max(0.0);
                let (q, q_prime) = (t * t, -4.0 * t / (1.0 - SHARP_MARGIN));
                let scale = SHARP_PENALTY / (epsilon * epsilon);
                Coefficients {
                    source: 1.0 - q,
                    source_prime: -q_prime,
                    penalty: scale * q + eta / (epsilon * epsilon),
                    penalty_prime: scale * q_prime,
                }
            }
        }
    }
}

impl Distortion {
    /// Analyses the linear system of the surface, where no other functional has yet.
    ///
    /// # Errors
    /// `epsilon` that is not positive, `delta` outside [0, 1), `eta` that is negative, `weight`
    /// of another length or outside [0, 1], [`crate::Error::OutOfMemory`].
    pub fn new(
        surface: Arc<Surface>,
        formulation: Formulation,
        epsilon: f64,
        delta: f64,
        eta: f64,
        weight: Option<&[f64]>,
    ) -> Result<Self> {
        check_positive("epsilon", epsilon)?;
        check_non_negative("eta", eta)?;
        check_delta(delta)?;
        if let Some(weight) = weight {
            check_weight("weight", weight, surface.mesh().n_vertices())?;
        }
        surface.dirichlet_system()?;
        Ok(Self {
            surface,
            formulation,
            epsilon,
            delta,
            eta,
            weight: weight.map(<[f64]>::to_vec),
            systems: Buffers::default(),
        })
    }

    /// Log scale factors of the flat metrics e^{2 s} g of the positive and the negative phase,
    /// with their true sign: negative inside a cap of a sphere, where 0 is kept on its rim.
    ///
    /// # Errors
    /// As [`Functional::value_and_gradient`].
    pub fn log_scale(&self, u: &[f64]) -> Result<[Vec<f64>; 2]> {
        check_vector("u", u, self.surface.mesh().n_vertices())?;
        let [mut positive, mut negative] = self.take_systems()?;
        let (first, second) = rayon::join(
            || self.solve(u, 1.0, &mut positive),
            || self.solve(u, -1.0, &mut negative),
        );
        first?;
        second?;
        let scales = [&positive, &negative].map(|system| {
            // The paper's equation determines minus the log scale factor.
            system.solution.iter().map(|s| -s).collect()
        });
        self.systems.give_back([positive, negative]);
        Ok(scales)
    }

    fn take_systems(&self) -> Result<[System; 2]> {
        if let Some(systems) = self.systems.take() {
            return Ok(systems);
        }
        Ok([System::new(&self.surface)?, System::new(&self.surface)?])
    }

    /// Solves A\[u\] s = b\[u\] for one phase.
    fn solve(&self, u: &[f64], sign: f64, system: &mut System) -> Result<()> {
        let mesh = self.surface.mesh();
        let curvature = mesh.angle_defects();
        for (i, c) in system.indicator.iter_mut().enumerate() {
            let inside = self.weight.as_ref().map_or(1.0, |w| w[i]);
            *c = inside * chi(sign * u[i], self.delta);
            let at = self.formulation.at(*c, self.epsilon, self.eta);
            system.penalty[i] = mesh.mass()[i] * at.penalty;
            system.solution[i] = if mesh.on_boundary()[i] {
                0.0
            } else {
                curvature[i] * at.source
            };
        }
        if self.formulation == Formulation::Paper {
            system.stiffness.refill(mesh, &system.indicator, self.eta);
        }
        self.surface.dirichlet_system()?.fill(
            mesh,
            &system.stiffness,
            &system.penalty,
            &mut system.values,
        );
        system.cholesky.factor(&system.values)?;
        system.cholesky.solve(&mut system.solution)
    }

    /// J of one phase; leaves its derivative by the vertex values of u in `system.gradient`.
    fn evaluate(&self, u: &[f64], sign: f64, system: &mut System) -> Result<f64> {
        self.solve(u, sign, system)?;
        let mesh = self.surface.mesh();
        let mut value = 0.0;
        for i in 0..u.len() {
            let moment = mesh.mass()[i] * system.solution[i];
            value += moment * system.solution[i];
            system.adjoint[i] = moment;
        }
        system.cholesky.solve(&mut system.adjoint)?;
        let (s, adjoint) = (&system.solution, &system.adjoint);
        for (i, g) in system.gradient.iter_mut().enumerate() {
            let at = self
                .formulation
                .at(system.indicator[i], self.epsilon, self.eta);
            *g = adjoint[i]
                * (mesh.angle_defects()[i] * at.source_prime
                    - mesh.mass()[i] * at.penalty_prime * s[i]);
        }
        if self.formulation == Formulation::Paper {
            for (face, cotangents) in mesh.faces().iter().zip(mesh.half_cotangents()) {
                let energy: f64 = (0..3)
                    .map(|k| {
                        let (a, b) = (face[k] as usize, face[(k + 1) % 3] as usize);
                        cotangents[k] * (s[a] - s[b]) * (adjoint[a] - adjoint[b])
                    })
                    .sum();
                for &v in face {
                    system.gradient[v as usize] -= energy / 3.0;
                }
            }
        }
        for (i, g) in system.gradient.iter_mut().enumerate() {
            let inside = self.weight.as_ref().map_or(1.0, |w| w[i]);
            *g *= 2.0 * sign * inside * chi_prime(sign * u[i], self.delta);
        }
        Ok(value)
    }
}

impl System {
    fn new(surface: &Surface) -> Result<Self> {
        let n = surface.mesh().n_vertices();
        let matrix = surface.dirichlet_system()?;
        Ok(Self {
            cholesky: Cholesky::new(matrix.symbolic())?,
            stiffness: Stiffness::new(surface.mesh()),
            values: vec![0.0; matrix.len()],
            indicator: vec![0.0; n],
            penalty: vec![0.0; n],
            solution: vec![0.0; n],
            adjoint: vec![0.0; n],
            gradient: vec![0.0; n],
        })
    }
}

impl Functional for Distortion {
    fn value_and_gradient(&self, u: &[f64], gradient: &mut [f64]) -> Result<f64> {
        check_vector("u", u, self.surface.mesh().n_vertices())?;
        check_length("gradient", gradient.len(), u.len())?;
        let [mut positive, mut negative] = self.take_systems()?;
        let (first, second) = rayon::join(
            || self.evaluate(u, 1.0, &mut positive),
            || self.evaluate(u, -1.0, &mut negative),
        );
        let value = first? + second?;
        for (g, (a, b)) in gradient
            .iter_mut()
            .zip(positive.gradient.iter().zip(&negative.gradient))
        {
            *g = a + b;
        }
        self.systems.give_back([positive, negative]);
        Ok(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::TriangleMesh;
    use crate::testing::{check_gradient, grid, torus};

    #[test]
    fn gradients() {
        for mesh in [
            grid(16, 14, |x, y| (3.0 * x).sin() * (2.0 * y).cos()),
            torus(24, 12, 0.4),
        ] {
            let surface = Arc::new(Surface::new(mesh));
            let mesh = surface.mesh();
            let u: Vec<f64> = mesh
                .vertices()
                .iter()
                .map(|p| 0.9 * (3.0 * p[0] + 2.0 * p[1] + 0.4).sin())
                .collect();
            let weight: Vec<f64> = mesh
                .vertices()
                .iter()
                .map(|p| 1.0 / (1.0 + (-6.0 * p[0]).exp()))
                .collect();
            for formulation in [Formulation::Paper, Formulation::Sharp] {
                for weight in [None, Some(&weight[..])] {
                    let functional =
                        Distortion::new(surface.clone(), formulation, 0.2, 0.02, 1e-3, weight)
                            .unwrap();
                    check_gradient(&functional, &u, 1e-6);
                }
            }
        }
    }

    #[test]
    fn flat_sheet_has_nothing_to_distort() {
        let surface = Arc::new(Surface::new(grid(20, 20, |_, _| 0.0)));
        let mesh = surface.mesh();
        let u: Vec<f64> = mesh.vertices().iter().map(|p| 2.0 * p[0] - 1.0).collect();
        for formulation in [Formulation::Paper, Formulation::Sharp] {
            let functional =
                Distortion::new(surface.clone(), formulation, 0.1, 0.01, 1e-6, None).unwrap();
            let mut gradient = vec![0.0; u.len()];
            let value = functional.value_and_gradient(&u, &mut gradient).unwrap();
            assert!(value < 1e-20, "{value}");
        }
    }

    /// A wavy sheet; every fifth face has a vertex so near to the middle of its first edge that the
    /// angles there are `degrees`.
    fn needles(degrees: f64) -> TriangleMesh {
        let sheet = grid(12, 12, |x, y| 0.1 * (6.0 * x).sin() * (5.0 * y).cos());
        let mut vertices = sheet.vertices().to_vec();
        let mut faces = Vec::new();
        for (f, face) in sheet.faces().iter().enumerate() {
            let face = face.map(i64::from);
            if f % 5 != 0 {
                faces.push(face);
                continue;
            }
            let [a, b, c] = face.map(|v| sheet.vertices()[v as usize]);
            // About half the edge over the height, the legs being of one length.
            let part = 0.5 * degrees.to_radians().tan();
            let rest = 0.5 * (1.0 - part);
            let new = vertices.len() as i64;
            vertices.push([0, 1, 2].map(|k| rest * (a[k] + b[k]) + part * c[k]));
            faces.extend((0..3).map(|k| [face[k], face[(k + 1) % 3], new]));
        }
        TriangleMesh::new(vertices, &faces).unwrap()
    }

    #[test]
    fn needles_are_solved() {
        for degrees in [0.5, 0.1, 0.01] {
            let surface = Arc::new(Surface::new(needles(degrees)));
            let mesh = surface.mesh();
            let mixed = mesh.vertices().iter().map(|p| (4.0 * p[0] - 2.0).tanh());
            let n = mesh.n_vertices();
            let fields = [vec![1.0; n], vec![-1.0; n], vec![0.0; n], mixed.collect()];
            let weight: Vec<f64> = mesh
                .vertices()
                .iter()
                .map(|p| 1.0 / (1.0 + (-6.0 * p[1]).exp()))
                .collect();
            for formulation in [Formulation::Paper, Formulation::Sharp] {
                for weight in [None, Some(&weight[..])] {
                    let functional =
                        Distortion::new(surface.clone(), formulation, 0.1, 0.01, 1e-6, weight)
                            .unwrap();
                    let mut gradient = vec![0.0; n];
                    for u in &fields {
                        let value = functional.value_and_gradient(u, &mut gradient).unwrap();
                        assert!(value > 0.0 && value.is_finite(), "{value}");
                        assert!(gradient.iter().all(|g| g.is_finite()));
                    }
                    check_gradient(&functional, &fields[3], 1e-6);
                }
            }
        }
    }

    #[test]
    fn singular_matrix_is_no_nan() {
        // The printed formulation has no penalty left for a pure phase of a closed surface: rounding decides
        // whether the last pivot, and so J, is a huge number or none.
        let surface = Arc::new(Surface::new(torus(24, 12, 0.4)));
        let mesh = surface.mesh();
        let n = mesh.n_vertices();
        let functional =
            Distortion::new(surface, Formulation::Paper, 0.1, 0.01, 1e-3, None).unwrap();
        match functional.value_and_gradient(&vec![1.0; n], &mut vec![0.0; n]) {
            Ok(value) => assert!(value.is_finite()),
            Err(error) => assert!(matches!(
                error,
                crate::Error::NotPositiveDefinite { vertex, .. } if vertex < n
            )),
        }
    }

    #[test]
    fn torus_halves_have_opposite_signs_of_scale() {
        // The outer half is curved like a sphere and shrinks inside, the inner half stretches.
        let surface = Arc::new(Surface::new(torus(60, 24, 0.4)));
        let mesh = surface.mesh();
        let functional =
            Distortion::new(surface.clone(), Formulation::Sharp, 0.1, 0.01, 1e-6, None).unwrap();
        let u: Vec<f64> = mesh
            .vertices()
            .iter()
            .map(|p| (10.0 * (p[0].hypot(p[1]) - 1.0)).tanh())
            .collect();
        let [outer, inner] = functional.log_scale(&u).unwrap();
        assert!(outer[0] < -0.01, "{}", outer[0]);
        assert!(inner[12] > 0.01, "{}", inner[12]);
    }
}
