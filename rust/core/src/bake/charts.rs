//! Overlapping charts, face by face.

use crate::error::{Error, Result, check_length, check_vector};

/// The charts over the faces of a surface: a face may lie in several, and in a chart at most once.
#[derive(Debug)]
pub struct Charts {
    /// Those of face `f` are `triangles[starts[f]..starts[f + 1]]`, in the order of the charts.
    starts: Vec<usize>,
    /// The face in the vertices of a chart.
    triangles: Vec<[u32; 3]>,
    /// The vertices of all charts in the plane.
    points: Vec<[f64; 2]>,
    /// Their blending weights; [`None`] where all are 1.
    weights: Option<Vec<f64>>,
}

/// A place where a texture is asked for, and the weight of the answer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub(super) place: [f64; 2],
    pub(super) weight: f64,
}

impl Charts {
    /// Takes the charts one after the other: the faces of each, their corners in the vertices of all
    /// charts, the places of these vertices in the plane and their blending weights, which are 1
    /// without `weights`.
    ///
    /// # Errors
    /// Lengths that do not match, indices out of range, numbers that are not finite.
    pub fn new(
        n_faces: usize,
        faces: &[i64],
        triangles: &[[i64; 3]],
        points: Vec<[f64; 2]>,
        weights: Option<Vec<f64>>,
    ) -> Result<Self> {
        check_length("triangles", triangles.len(), faces.len())?;
        check_vector("points", points.as_flattened(), 2 * points.len())?;
        if let Some(weights) = &weights {
            check_vector("weights", weights, points.len())?;
        }
        let mut starts = vec![0; n_faces + 1];
        for (position, &face) in faces.iter().enumerate() {
            let face = check_index("faces", position, face, n_faces)? as usize;
            starts[face + 1] += 1;
        }
        for face in 0..n_faces {
            starts[face + 1] += starts[face];
        }
        let mut cursor = starts.clone();
        let mut sorted = vec![[0; 3]; triangles.len()];
        for (position, (&face, corners)) in faces.iter().zip(triangles).enumerate() {
            let slot = &mut cursor[face as usize];
            for (target, &corner) in sorted[*slot].iter_mut().zip(corners) {
                *target = check_index("triangles", position, corner, points.len())?;
            }
            *slot += 1;
        }
        Ok(Self {
            starts,
            triangles: sorted,
            points,
            weights,
        })
    }

    /// Number of faces of the surface.
    #[must_use]
    pub fn n_faces(&self) -> usize {
        self.starts.len() - 1
    }

    /// Leaves in `samples` one place for each chart with a positive weight at a point of a face.
    /// Weights and places are linear in the face.
    pub(super) fn sample(
        &self,
        face: usize,
        barycentric: [f64; 3],
        scale: f64,
        samples: &mut Vec<Sample>,
    ) {
        samples.clear();
        for corners in &self.triangles[self.starts[face]..self.starts[face + 1]] {
            let corners = corners.map(|corner| corner as usize);
            let mean = |values: [f64; 3]| {
                values[0] * barycentric[0] + values[1] * barycentric[1] + values[2] * barycentric[2]
            };
            let weight = match &self.weights {
                None => 1.0,
                Some(weights) => mean(corners.map(|corner| weights[corner])),
            };
            if weight > 0.0 {
                let points = corners.map(|corner| self.points[corner]);
                let place = [0, 1].map(|axis| scale * mean(points.map(|point| point[axis])));
                samples.push(Sample { place, weight });
            }
        }
    }
}

/// An index of 32 bits, below `count`.
fn check_index(argument: &'static str, position: usize, index: i64, count: usize) -> Result<u32> {
    match u32::try_from(index) {
        Ok(checked) if (checked as usize) < count => Ok(checked),
        _ => Err(Error::Index {
            argument,
            position,
            index,
            count,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points() -> Vec<[f64; 2]> {
        vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [5.0, 5.0]]
    }

    #[test]
    fn samples_come_in_the_order_of_the_charts() {
        let triangles = [[1, 2, 3], [0, 1, 2], [0, 2, 3]];
        let weights = Some(vec![1.0, 0.0, 0.0, 0.5]);
        let charts = Charts::new(2, &[1, 0, 1], &triangles, points(), weights).unwrap();
        let mut samples = Vec::new();
        charts.sample(1, [0.5, 0.25, 0.25], 2.0, &mut samples);
        assert_eq!(samples.len(), 2);
        assert_eq!(samples[0].weight, 0.125);
        assert_eq!(samples[0].place, [3.5, 3.0]);
        assert_eq!(samples[1].weight, 0.625);
        charts.sample(0, [0.0, 1.0, 0.0], 2.0, &mut samples);
        assert!(samples.is_empty(), "a weight of 0 is none");
    }

    #[test]
    fn bad_input_is_named() {
        let message = |faces: &[i64], triangles: &[[i64; 3]], weights| {
            let charts = Charts::new(2, faces, triangles, points(), weights);
            charts.unwrap_err().to_string()
        };
        assert!(message(&[2], &[[0, 1, 2]], None).starts_with("faces[0]: 2"));
        assert!(message(&[-1], &[[0, 1, 2]], None).starts_with("faces[0]: -1"));
        assert!(message(&[1], &[[0, 1, 4]], None).starts_with("triangles[0]: 4"));
        assert!(message(&[1, 0], &[[0, 1, 2]], None).starts_with("triangles: length 1"));
        let weights = Some(vec![0.0, f64::NAN, 0.0, 0.0]);
        assert!(message(&[1], &[[0, 1, 2]], weights).starts_with("weights[1]: NaN"));
    }
}
