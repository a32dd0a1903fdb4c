//! Limited-memory BFGS: the inverse Hessian that the last steps of a minimisation tell.

use std::collections::VecDeque;

use rayon::prelude::*;

use crate::error::{Result, check_length, check_parameter, check_vector};
use crate::parallel::CHUNK;

/// A pair is kept only where its curvature s . y is more than this fraction of |s| |y|: without
/// positive curvature the approximation is not positive definite.
const LEAST_CURVATURE: f64 = 1e-10;

/// The approximation H of the inverse Hessian by the last pairs of a step s and the change y of
/// the gradient along it, in the compact form of Byrd, Nocedal and Schnabel (1994), equation (3.1):
///
/// H = gamma I + \[S, gamma Y\] \[\[R^-T (D + gamma Y^T Y) R^-1, -R^-T\], \[-R^-1, 0\]\] \[S, gamma Y\]^T
///
/// with R the upper triangle of S^T Y, D its diagonal and gamma = s . y / y . y of the last pair.
/// Its products with all pairs are taken together, by all threads; those of the two-loop recursion
/// wait for one another.
///
/// # Examples
/// ```
/// use phaseatlas_core::lbfgs::LimitedMemory;
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// // Two steps on the quadratic with the Hessian diag(1, 4) tell all of it.
/// let mut memory = LimitedMemory::new(2, 5)?;
/// memory.update(&[1.0, 0.0], &[1.0, 0.0])?;
/// memory.update(&[0.0, 1.0], &[0.0, 4.0])?;
/// let mut direction = [0.0; 2];
/// memory.direction(&[3.0, 8.0], &mut direction)?;
/// assert_eq!(direction, [-3.0, -2.0]);
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct LimitedMemory {
    n: usize,
    capacity: usize,
    /// oldest first
    pairs: VecDeque<Pair>,
    spare: Vec<Pair>,
    gamma: f64,
}

/// A step s, the change y of the gradient, and their products with the older pairs and themselves.
#[derive(Debug, Default)]
struct Pair {
    step: Vec<f64>,
    change: Vec<f64>,
    /// s_i . y of the pairs up to this one, oldest first: a column of R
    step_change: VecDeque<f64>,
    /// y_i . y likewise
    change_change: VecDeque<f64>,
}

impl LimitedMemory {
    /// Memory of up to `capacity` pairs of vectors of length `n`.
    ///
    /// # Errors
    /// `capacity` of 0.
    pub fn new(n: usize, capacity: usize) -> Result<Self> {
        check_parameter("capacity", capacity as f64, capacity > 0, "at least 1")?;
        Ok(Self {
            n,
            capacity,
            pairs: VecDeque::with_capacity(capacity),
            spare: Vec::new(),
            gamma: 1.0,
        })
    }

    /// Forgets all pairs: H is the identity again.
    pub fn clear(&mut self) {
        self.spare.extend(self.pairs.drain(..));
        self.gamma = 1.0;
    }

    /// Number of pairs.
    #[must_use]
    pub fn len(&self) -> usize {
        self.pairs.len()
    }

    /// Whether H is the identity.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Adds a `step` and the `change` of the gradient along it, for the oldest pair where the memory
    /// is full. False, and nothing is added, where the curvature is not positive.
    ///
    /// # Errors
    /// Vectors of another length or not finite.
    pub fn update(&mut self, step: &[f64], change: &[f64]) -> Result<bool> {
        check_vector("step", step, self.n)?;
        check_vector("change", change, self.n)?;
        let [curvature, steps, changes] = dots([(step, change), (step, step), (change, change)]);
        if curvature <= LEAST_CURVATURE * (steps * changes).sqrt() {
            return Ok(false);
        }
        if self.pairs.len() == self.capacity {
            self.spare.extend(self.pairs.pop_front());
            for pair in &mut self.pairs {
                pair.step_change.pop_front();
                pair.change_change.pop_front();
            }
        }
        let mut pair = self.spare.pop().unwrap_or_default();
        pair.step.clear();
        pair.step.extend_from_slice(step);
        pair.change.clear();
        pair.change.extend_from_slice(change);
        pair.step_change.clear();
        pair.change_change.clear();
        for (along, across) in self.products(change) {
            pair.step_change.push_back(along);
            pair.change_change.push_back(across);
        }
        pair.step_change.push_back(curvature);
        pair.change_change.push_back(changes);
        self.pairs.push_back(pair);
        self.gamma = curvature / changes;
        Ok(true)
    }

    /// Writes the descent direction -H `gradient` to `direction`.
    ///
    /// # Errors
    /// Vectors of another length, `gradient` not finite.
    pub fn direction(&self, gradient: &[f64], direction: &mut [f64]) -> Result<()> {
        check_vector("gradient", gradient, self.n)?;
        check_length("direction", direction.len(), self.n)?;
        let k = self.pairs.len();
        let gamma = self.gamma;
        let products = self.products(gradient);
        // a = R^-1 S^T g
        let mut a: Vec<f64> = products.iter().map(|product| product.0).collect();
        for j in (0..k).rev() {
            a[j] /= self.pairs[j].step_change[j];
            for i in 0..j {
                a[i] -= self.pairs[j].step_change[i] * a[j];
            }
        }
        // b = R^-T (D a + gamma (Y^T Y a - Y^T g))
        let mut b = vec![0.0; k];
        for i in 0..k {
            let row = (0..k).map(|j| self.pairs[i.max(j)].change_change[i.min(j)] * a[j]);
            let sum: f64 = row.sum();
            b[i] = self.pairs[i].step_change[i] * a[i] + gamma * (sum - products[i].1);
        }
        for j in 0..k {
            for i in 0..j {
                b[j] -= self.pairs[j].step_change[i] * b[i];
            }
            b[j] /= self.pairs[j].step_change[j];
        }
        direction
            .par_chunks_mut(CHUNK)
            .zip(gradient.par_chunks(CHUNK))
            .enumerate()
            .for_each(|(chunk, (direction, gradient))| {
                let range = chunk * CHUNK..chunk * CHUNK + gradient.len();
                for (d, g) in direction.iter_mut().zip(gradient) {
                    *d = -gamma * g;
                }
                for (pair, (a, b)) in self.pairs.iter().zip(a.iter().zip(&b)) {
                    let steps = &pair.step[range.clone()];
                    let changes = &pair.change[range.clone()];
                    for ((d, s), y) in direction.iter_mut().zip(steps).zip(changes) {
                        *d += gamma * a * y - b * s;
                    }
                }
            });
        Ok(())
    }

    /// (s_i . vector, y_i . vector) of all pairs.
    fn products(&self, vector: &[f64]) -> Vec<(f64, f64)> {
        let k = self.pairs.len();
        let partial: Vec<Vec<(f64, f64)>> = vector
            .par_chunks(CHUNK)
            .enumerate()
            .map(|(chunk, vector)| {
                let range = chunk * CHUNK..chunk * CHUNK + vector.len();
                let products = self.pairs.iter().map(|pair| {
                    let steps = &pair.step[range.clone()];
                    let changes = &pair.change[range.clone()];
                    (dot(steps, vector), dot(changes, vector))
                });
                products.collect()
            })
            .collect();
        let mut products = vec![(0.0, 0.0); k];
        for chunk in partial {
            for (sum, product) in products.iter_mut().zip(chunk) {
                sum.0 += product.0;
                sum.1 += product.1;
            }
        }
        products
    }
}

/// Scalar products, summed over chunks in order.
fn dots<const N: usize>(vectors: [(&[f64], &[f64]); N]) -> [f64; N] {
    vectors.map(|(a, b)| {
        let chunks = a.chunks(CHUNK).zip(b.chunks(CHUNK));
        chunks.map(|(a, b)| dot(a, b)).sum()
    })
}

/// Scalar product in eight sums side by side, which the compiler makes vectors of.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    const LANES: usize = 8;
    let (a_blocks, a_rest) = a.as_chunks::<LANES>();
    let (b_blocks, b_rest) = b.as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for (a, b) in a_blocks.iter().zip(b_blocks) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    let rest = a_rest.iter().zip(b_rest).map(|(a, b)| a * b);
    sums.iter().sum::<f64>() + rest.sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 30;

    fn vector(seed: usize) -> Vec<f64> {
        (0..N)
            .map(|i| ((7 * seed + 3 * i * i + i) as f64).sin())
            .collect()
    }

    /// Pairs of the quadratic with the Hessian diag(1, 2, ..., N).
    fn pair(seed: usize) -> (Vec<f64>, Vec<f64>) {
        let step = vector(seed);
        let change = step.iter().enumerate().map(|(i, s)| (i + 1) as f64 * s);
        let change = change.collect();
        (step, change)
    }

    /// The two-loop recursion of Nocedal (1980).
    fn two_loops(pairs: &[(Vec<f64>, Vec<f64>)], gradient: &[f64]) -> Vec<f64> {
        let mut q = gradient.to_vec();
        let mut alphas = Vec::new();
        for (s, y) in pairs.iter().rev() {
            let alpha = dot(s, &q) / dot(s, y);
            for (q, y) in q.iter_mut().zip(y) {
                *q -= alpha * y;
            }
            alphas.push(alpha);
        }
        if let Some((s, y)) = pairs.last() {
            let gamma = dot(s, y) / dot(y, y);
            for q in &mut q {
                *q *= gamma;
            }
        }
        for ((s, y), alpha) in pairs.iter().zip(alphas.iter().rev()) {
            let beta = dot(y, &q) / dot(s, y);
            q.iter_mut()
                .zip(s)
                .for_each(|(q, s)| *q += (alpha - beta) * s);
        }
        q.iter().map(|q| -q).collect()
    }

    #[test]
    fn direction_is_that_of_the_two_loop_recursion() {
        let mut memory = LimitedMemory::new(N, 4).unwrap();
        let gradient = vector(99);
        let mut direction = vec![0.0; N];
        let mut pairs = Vec::new();
        for seed in 0..7 {
            memory.direction(&gradient, &mut direction).unwrap();
            let kept = &pairs[pairs.len().max(4) - 4..];
            for (a, b) in direction.iter().zip(two_loops(kept, &gradient)) {
                assert!((a - b).abs() < 1e-9, "{seed}: {a} {b}");
            }
            let (step, change) = pair(seed);
            assert!(memory.update(&step, &change).unwrap());
            pairs.push((step, change));
        }
        memory.clear();
        memory.direction(&gradient, &mut direction).unwrap();
        assert!(direction.iter().zip(&gradient).all(|(d, g)| *d == -g));
    }

    #[test]
    fn secant_equation_of_the_last_pair() {
        let mut memory = LimitedMemory::new(N, 5).unwrap();
        for seed in 0..9 {
            let (step, change) = pair(seed);
            memory.update(&step, &change).unwrap();
        }
        let (step, change) = pair(8);
        let mut direction = vec![0.0; N];
        memory.direction(&change, &mut direction).unwrap();
        for (d, s) in direction.iter().zip(&step) {
            assert!((d + s).abs() < 1e-10);
        }
    }

    #[test]
    fn curvature_that_is_not_positive_is_left_out() {
        let mut memory = LimitedMemory::new(N, 2).unwrap();
        let step = vector(1);
        let change: Vec<f64> = step.iter().map(|s| -s).collect();
        assert!(!memory.update(&step, &change).unwrap());
        assert!(memory.is_empty());
        assert!(!memory.update(&step, &vec![0.0; N]).unwrap());
        assert!(memory.update(&step, &step).unwrap());
        assert_eq!(memory.len(), 1);
    }

    #[test]
    fn bad_arguments_are_named() {
        assert!(LimitedMemory::new(3, 0).is_err());
        let mut memory = LimitedMemory::new(2, 1).unwrap();
        let error = memory.update(&[0.0, f64::NAN], &[1.0, 1.0]).unwrap_err();
        assert!(error.to_string().starts_with("step[1]"));
        assert!(memory.direction(&[1.0], &mut [0.0, 0.0]).is_err());
    }
}
