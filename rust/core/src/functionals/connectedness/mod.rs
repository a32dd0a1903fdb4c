//! Connectedness of the phases, equation (3).

mod pairs;
mod phase;
mod tree;

use std::sync::Arc;

use rayon::prelude::*;

use super::functional::Functional;
use crate::error::{
    Result, check_length, check_parameter, check_positive, check_vector, check_weight,
};
use crate::graph::{Components, ContractedDual, DualWeights, Regions};
use crate::mesh::{NONE, TriangleMesh};
use crate::parallel::{Buffers, CHUNK};
use crate::potentials::ConnectednessPotentials;
use crate::surface::Surface;
use pairs::Pairs;
use phase::{Phase, Saturation};
use tree::SpanningTree;

/// Faces where the parent's indicator is smaller than this lie outside the parent: they belong to
/// no component, and paths pay F(0) more there. No path there is free, at any u.
const OUTSIDE: f64 = 0.25;
/// The price of a path is divided by the parent's indicator, but by no less than this.
const INDICATOR_FLOOR: f64 = 1e-2;

/// Which of C\[u\] (positive) and C\[-u\] (negative) a [`Connectedness`] evaluates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phases {
    /// The sum of the two.
    Both,
    /// C\[u\].
    Positive,
    /// C\[-u\].
    Negative,
}

/// How C measures the distances between components.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// All pairs, equation (3).
    Pairs,
    /// All pairs, with the distances along the shortest spanning tree, which takes one search
    /// from all components together: the sum over its edges of W W' d with W, W' the masses of the
    /// two parts that the edge joins. Zero exactly where the sum over all pairs is, and no
    /// smaller.
    Tree,
}

/// C\[u\] = sum over ordered pairs of components i != j of W_i W_j d_ij, equation (3), discretised
/// after Dondl and Wojtowytsch (2018).
///
/// Components are those of the faces with value at least the threshold a, a face's value
/// the mean of its corners. W_i is the integral of H over component i, d_ij the length of the
/// shortest dual path with edge weight mean F x mean diameter. Within a parent's indicator w, H
/// is weighted with w and the dual edge weight divided by it, with F(0) added
/// outside the parent. The gradient is the H' part inside
/// the components plus the F' part along each shortest path.
///
/// The masses may saturate: W / (W + w) with an area w in place of W holds components that are
/// small beside the whole as firmly as large ones, as long as they are not small beside w.
///
/// # Examples
/// ```
/// use std::sync::Arc;
///
/// use phaseatlas_core::functionals::{Connectedness, Functional, Phases};
/// use phaseatlas_core::{Surface, TriangleMesh};
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// // A strip of six triangles.
/// let vertices = (0..8).map(|i| [f64::from(i / 2), f64::from(i % 2), 0.0]).collect();
/// let faces = [[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5], [4, 6, 5], [5, 6, 7]];
/// let strip = Arc::new(Surface::new(TriangleMesh::new(vertices, &faces)?));
/// let positive = Connectedness::new(strip, 0.5, None, Phases::Positive)?;
/// let both_ends = [1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0, 1.0];
/// assert_eq!(positive.components(&both_ends)?, (2, 0));
/// let mut gradient = [0.0; 8];
/// assert!(positive.value_and_gradient(&both_ends, &mut gradient)? > 0.0);
/// assert_eq!(positive.value_and_gradient(&[1.0; 8], &mut gradient)?, 0.0);
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Connectedness {
    surface: Arc<Surface>,
    potentials: ConnectednessPotentials,
    phases: Phases,
    form: Form,
    saturation: Saturation,
    /// area x mean w of every face
    measure: Vec<f64>,
    inside: Vec<bool>,
    /// (D_f + D_g) / 4 / w of every half-edge, so that the weight is (F_f + F_g) scale
    scale: Vec<[f64; 3]>,
    workspaces: Buffers<[Workspace; 2]>,
}

/// The buffers of one phase's evaluation.
#[derive(Debug, Default)]
struct Workspace {
    price: Vec<f64>,
    face_gradient: Vec<f64>,
    values: Vec<f64>,
    /// those of positive mass
    components: Components,
    /// W_i
    masses: Vec<f64>,
    /// derivative by W_i
    potential: Vec<f64>,
    graph: ContractedDual,
    regions: Regions,
    pairs: Pairs,
    tree: SpanningTree,
}

impl Connectedness {
    /// Measures the distances between all pairs, with masses that do not saturate and H = 1 at 1.
    ///
    /// # Errors
    /// `threshold` outside (0, 1), `weight` of another length or outside [0, 1].
    pub fn new(
        surface: Arc<Surface>,
        threshold: f64,
        weight: Option<&[f64]>,
        phases: Phases,
    ) -> Result<Self> {
        // Below 0 the phases would overlap.
        let legal = threshold > 0.0 && threshold < 1.0;
        check_parameter("threshold", threshold, legal, "in (0, 1)")?;
        let mesh = surface.mesh();
        if let Some(weight) = weight {
            check_weight("weight", weight, mesh.n_vertices())?;
        }
        let indicator: Vec<f64> = (0..mesh.n_faces())
            .map(|f| weight.map_or(1.0, |w| mesh.face_mean(w, f)))
            .collect();
        let inside: Vec<bool> = indicator.iter().map(|&w| w >= OUTSIDE).collect();
        let measure = mesh.areas().iter().zip(&indicator);
        let measure = measure.map(|(area, w)| area * w).collect();
        let diameters = mesh.diameters();
        let scale = mesh
            .neighbours()
            .iter()
            .enumerate()
            .map(|(f, across)| {
                across.map(|g| {
                    if g == NONE {
                        return 0.0;
                    }
                    let g = g as usize;
                    let w = (0.5 * (indicator[f] + indicator[g])).max(INDICATOR_FLOOR);
                    0.25 * (diameters[f] + diameters[g]) / w
                })
            })
            .collect();
        Ok(Self {
            surface,
            potentials: ConnectednessPotentials::new(threshold, 1.0),
            phases,
            form: Form::Pairs,
            saturation: Saturation::default(),
            measure,
            inside,
            scale,
            workspaces: Buffers::default(),
        })
    }

    /// Takes these faces for the parent instead of those where its indicator is at least 1/4.
    ///
    /// # Errors
    /// `inside` of another length than there are faces.
    pub fn within(self, inside: &[bool]) -> Result<Self> {
        check_length("inside", inside.len(), self.mesh().n_faces())?;
        Ok(Self {
            inside: inside.to_vec(),
            ..self
        })
    }

    /// Measures distances as `form` says.
    #[must_use]
    pub fn with_form(self, form: Form) -> Self {
        Self { form, ..self }
    }

    /// Takes W / (W + `saturation`) for the mass W of a component.
    ///
    /// # Errors
    /// `saturation` that is not positive.
    pub fn with_saturation(self, saturation: f64) -> Result<Self> {
        check_positive("saturation", saturation)?;
        Ok(Self {
            saturation: Saturation(Some(saturation)),
            ..self
        })
    }

    /// Lets H reach 1 at `plateau` instead of at 1.
    ///
    /// # Errors
    /// `plateau` outside (threshold, 1].
    pub fn with_plateau(self, plateau: f64) -> Result<Self> {
        let threshold = self.potentials.threshold();
        let legal = plateau > threshold && plateau <= 1.0;
        check_parameter("plateau", plateau, legal, "in (threshold, 1]")?;
        Ok(Self {
            potentials: ConnectednessPotentials::new(threshold, plateau),
            ..self
        })
    }

    /// Number of components of each phase at `u` that carry mass, (positive, negative).
    ///
    /// # Errors
    /// As [`Functional::value_and_gradient`].
    pub fn components(&self, u: &[f64]) -> Result<(usize, usize)> {
        check_vector("u", u, self.mesh().n_vertices())?;
        let count = |sign: f64| {
            let mut workspace = Workspace::default();
            self.find_components(u, sign, &mut workspace);
            workspace.masses.len()
        };
        Ok((count(1.0), count(-1.0)))
    }

    fn mesh(&self) -> &TriangleMesh {
        self.surface.mesh()
    }

    fn find_components(&self, u: &[f64], sign: f64, workspace: &mut Workspace) {
        let mesh = self.mesh();
        let potentials = self.potentials;
        let m = mesh.n_faces();
        workspace.values.resize(m, 0.0);
        workspace
            .values
            .par_chunks_mut(CHUNK)
            .enumerate()
            .for_each(|(chunk, values)| {
                for (offset, value) in values.iter_mut().enumerate() {
                    *value = sign * mesh.face_mean(u, chunk * CHUNK + offset);
                }
            });
        let values = &workspace.values;
        let threshold = potentials.threshold();
        workspace.components.label(
            mesh,
            |f| self.inside[f] && values[f] >= threshold,
            |_, _| true,
        );
        workspace.masses.clear();
        for c in 0..workspace.components.count() {
            let faces = workspace.components.faces_of(c).iter();
            let mass = faces.map(|&f| self.measure[f as usize] * potentials.h(values[f as usize]));
            workspace.masses.push(mass.sum());
        }
        let masses = &mut workspace.masses;
        workspace.components.retain(|c| masses[c] > 0.0);
        masses.retain(|&mass| mass > 0.0);
    }

    /// Evaluates one phase; leaves its derivative by the face values in `face_gradient`, which is
    /// empty where that is zero.
    fn evaluate(&self, u: &[f64], sign: f64, workspace: &mut Workspace) -> f64 {
        self.find_components(u, sign, workspace);
        workspace.face_gradient.clear();
        let count = workspace.components.count();
        if count < 2 {
            return 0.0;
        }
        let potentials = self.potentials;
        workspace.face_gradient.resize(self.mesh().n_faces(), 0.0);
        workspace.price.clear();
        let prices = workspace.values.iter().zip(&self.inside);
        workspace.price.extend(prices.map(|(&value, &inside)| {
            potentials.f(value) + if inside { 0.0 } else { potentials.f(0.0) }
        }));
        workspace.potential.clear();
        workspace.potential.resize(count, 0.0);
        let Workspace {
            price,
            face_gradient,
            values,
            components,
            masses,
            potential,
            graph,
            regions,
            pairs,
            tree,
        } = workspace;
        let weights = DualWeights {
            price,
            scale: &self.scale,
        };
        graph.contract(self.mesh(), weights, components);
        regions.grow(graph, components);
        let phase = Phase {
            mesh: self.mesh(),
            weights,
            masses,
            saturation: self.saturation,
            graph,
            regions,
        };
        let add = |f: u32, a: f64| {
            let f = f as usize;
            face_gradient[f] += a * potentials.f_prime(values[f]);
        };
        let value = match self.form {
            Form::Pairs => pairs.sum(&phase, potential, add),
            Form::Tree => tree.sum(&phase, potential, add),
        };
        for (c, &slope) in potential.iter().enumerate() {
            for &f in components.faces_of(c) {
                let f = f as usize;
                face_gradient[f] += slope * self.measure[f] * potentials.h_prime(values[f]);
            }
        }
        value
    }

    fn scatter(&self, face_gradient: &[f64], factor: f64, gradient: &mut [f64]) {
        for (face, &g) in self.mesh().faces().iter().zip(face_gradient) {
            if g != 0.0 {
                for &v in face {
                    gradient[v as usize] += factor * g / 3.0;
                }
            }
        }
    }
}

impl Functional for Connectedness {
    fn value_and_gradient(&self, u: &[f64], gradient: &mut [f64]) -> Result<f64> {
        check_vector("u", u, self.mesh().n_vertices())?;
        check_length("gradient", gradient.len(), u.len())?;
        gradient.fill(0.0);
        let mut workspaces = self.workspaces.take().unwrap_or_default();
        let [positive, negative] = &mut workspaces;
        let (first, second) = rayon::join(
            || match self.phases {
                Phases::Negative => None,
                _ => Some(self.evaluate(u, 1.0, positive)),
            },
            || match self.phases {
                Phases::Positive => None,
                _ => Some(self.evaluate(u, -1.0, negative)),
            },
        );
        if first.is_some() {
            self.scatter(&positive.face_gradient, 1.0, gradient);
        }
        if second.is_some() {
            self.scatter(&negative.face_gradient, -1.0, gradient);
        }
        self.workspaces.give_back(workspaces);
        Ok(first.unwrap_or(0.0) + second.unwrap_or(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{check_gradient, grid};

    fn bumps(mesh: &TriangleMesh, height: f64) -> Vec<f64> {
        let bump = |p: &[f64; 3], x: f64| {
            let r2 = (p[0] - x).powi(2) + (p[1] - 0.5).powi(2);
            (-r2 / 0.01).exp()
        };
        mesh.vertices()
            .iter()
            .map(|p| -0.6 + height * (bump(p, 0.2) + 0.9 * bump(p, 0.5) + bump(p, 0.8)))
            .collect()
    }

    #[test]
    fn gradients_with_three_components() {
        let surface = Arc::new(Surface::new(grid(40, 30, |x, y| 0.1 * (6.0 * x).sin() * y)));
        let mesh = surface.mesh();
        let functional = Connectedness::new(surface.clone(), 0.8, None, Phases::Both).unwrap();
        let u = bumps(mesh, 1.8);
        assert_eq!(functional.components(&u).unwrap().0, 3);
        check_gradient(&functional, &u, 1e-5);
        let weight: Vec<f64> = mesh.vertices().iter().map(|p| p[0].min(1.0)).collect();
        let weighted = Connectedness::new(surface, 0.8, Some(&weight), Phases::Both).unwrap();
        check_gradient(&weighted, &u, 1e-5);
    }

    #[test]
    fn gradients_of_the_tree_and_of_saturated_masses() {
        let surface = Arc::new(Surface::new(grid(40, 30, |x, y| 0.1 * (6.0 * x).sin() * y)));
        let mesh = surface.mesh();
        let u = bumps(mesh, 1.8);
        let new = || Connectedness::new(surface.clone(), 0.3, None, Phases::Both).unwrap();
        for functional in [
            new().with_form(Form::Tree),
            new().with_saturation(0.01).unwrap(),
            new().with_form(Form::Tree).with_saturation(0.01).unwrap(),
            new().with_plateau(0.6).unwrap(),
        ] {
            check_gradient(&functional, &u, 1e-5);
        }
    }

    #[test]
    fn tree_of_bumps_in_a_row_is_all_pairs() {
        // The way between the outer two leads through the middle one, along the tree.
        let surface = Arc::new(Surface::new(grid(40, 30, |_, _| 0.0)));
        let mesh = surface.mesh();
        let u = bumps(mesh, 1.8);
        let new = || Connectedness::new(surface.clone(), 0.8, None, Phases::Positive).unwrap();
        let (mut a, mut b) = (vec![0.0; u.len()], vec![0.0; u.len()]);
        let tree = new().with_form(Form::Tree);
        let tree = tree.value_and_gradient(&u, &mut a).unwrap();
        let pairs = new().value_and_gradient(&u, &mut b).unwrap();
        assert!((tree - pairs).abs() < 1e-12 * pairs, "{tree}, {pairs}");
        let apart = a.iter().zip(&b).map(|(x, y)| (x - y).abs());
        assert!(apart.fold(0.0, f64::max) < 1e-12);
    }

    #[test]
    fn zero_exactly_when_connected() {
        let surface = Arc::new(Surface::new(grid(20, 20, |_, _| 0.0)));
        let mesh = surface.mesh();
        let functional = Connectedness::new(surface.clone(), 0.8, None, Phases::Both).unwrap();
        let u: Vec<f64> = mesh.vertices().iter().map(|p| 4.0 * p[0] - 2.0).collect();
        let mut gradient = vec![1.0; u.len()];
        assert_eq!(
            functional.value_and_gradient(&u, &mut gradient).unwrap(),
            0.0
        );
        assert!(gradient.iter().all(|&g| g == 0.0));
        assert!(
            functional
                .value_and_gradient(&bumps(mesh, 1.8), &mut gradient)
                .unwrap()
                > 0.0
        );
    }

    #[test]
    fn phases_mirror() {
        let surface = Arc::new(Surface::new(grid(30, 30, |_, _| 0.0)));
        let mesh = surface.mesh();
        let positive = Connectedness::new(surface.clone(), 0.8, None, Phases::Positive).unwrap();
        let negative = Connectedness::new(surface.clone(), 0.8, None, Phases::Negative).unwrap();
        let u = bumps(mesh, 1.8);
        let minus: Vec<f64> = u.iter().map(|x| -x).collect();
        let (mut a, mut b) = (vec![0.0; u.len()], vec![0.0; u.len()]);
        let first = positive.value_and_gradient(&u, &mut a).unwrap();
        let second = negative.value_and_gradient(&minus, &mut b).unwrap();
        assert_eq!(first, second);
        assert!(a.iter().zip(&b).all(|(x, y)| *x == -*y));
    }
}
