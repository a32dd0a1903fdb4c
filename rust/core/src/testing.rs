//! Meshes, fields and checks that the tests of several files share.

use std::f64::consts::PI;

use crate::functionals::Functional;
use crate::mesh::TriangleMesh;

/// A regular grid of nx x ny squares on [0, 1]^2, lifted by `height`.
pub(crate) fn grid(nx: usize, ny: usize, height: impl Fn(f64, f64) -> f64) -> TriangleMesh {
    let mut vertices = Vec::new();
    for j in 0..=ny {
        for i in 0..=nx {
            let (x, y) = (i as f64 / nx as f64, j as f64 / ny as f64);
            vertices.push([x, y, height(x, y)]);
        }
    }
    let mut faces = Vec::new();
    let index = |i: usize, j: usize| (j * (nx + 1) + i) as i64;
    for j in 0..ny {
        for i in 0..nx {
            faces.push([index(i, j), index(i + 1, j), index(i + 1, j + 1)]);
            faces.push([index(i, j), index(i + 1, j + 1), index(i, j + 1)]);
        }
    }
    TriangleMesh::new(vertices, &faces).expect("a grid is a valid mesh")
}

/// A torus of radii 1 and `minor`.
pub(crate) fn torus(n_major: usize, n_minor: usize, minor: f64) -> TriangleMesh {
    let mut vertices = Vec::new();
    for i in 0..n_major {
        let a = 2.0 * PI * i as f64 / n_major as f64;
        for j in 0..n_minor {
            let b = 2.0 * PI * j as f64 / n_minor as f64;
            let r = 1.0 + minor * b.cos();
            vertices.push([r * a.cos(), r * a.sin(), minor * b.sin()]);
        }
    }
    let index = |i: usize, j: usize| ((i % n_major) * n_minor + j % n_minor) as i64;
    let mut faces = Vec::new();
    for i in 0..n_major {
        for j in 0..n_minor {
            faces.push([index(i, j), index(i + 1, j), index(i + 1, j + 1)]);
            faces.push([index(i, j), index(i + 1, j + 1), index(i, j + 1)]);
        }
    }
    TriangleMesh::new(vertices, &faces).expect("a torus is a valid mesh")
}

/// Lower triangle of the five-point Laplacian plus `shift` on a k x k grid.
pub(crate) fn laplacian(k: usize, shift: f64) -> (Vec<usize>, Vec<u32>, Vec<f64>) {
    let (mut starts, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
    for j in 0..k * k {
        rows.push(j as u32);
        values.push(4.0 + shift);
        if (j + 1) % k != 0 {
            rows.push(j as u32 + 1);
            values.push(-1.0);
        }
        if j + k < k * k {
            rows.push((j + k) as u32);
            values.push(-1.0);
        }
        starts.push(rows.len());
    }
    (starts, rows, values)
}

/// A deterministic, irregular phase field in [-1, 1].
pub(crate) fn noise(n: usize) -> Vec<f64> {
    (0..n)
        .map(|i| ((i as f64 * 12.9898).sin() * 43_758.545_3).fract())
        .collect()
}

/// Numbers below 2^31 from a linear congruential generator.
pub(crate) fn numbers(seed: u64) -> impl FnMut() -> u32 {
    let mut state = seed;
    move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as u32
    }
}

/// Compares the gradient with a central difference along an irregular direction.
pub(crate) fn check_gradient(functional: &dyn Functional, u: &[f64], tolerance: f64) {
    let mut gradient = vec![0.0; u.len()];
    functional.value_and_gradient(u, &mut gradient).unwrap();
    let direction: Vec<f64> = (0..u.len()).map(|i| (i as f64 * 0.7 + 0.3).sin()).collect();
    let step = 1e-5;
    let mut scratch = vec![0.0; u.len()];
    let mut at = |t: f64| {
        let moved: Vec<f64> = u.iter().zip(&direction).map(|(a, d)| a + t * d).collect();
        functional.value_and_gradient(&moved, &mut scratch).unwrap()
    };
    let difference = (at(step) - at(-step)) / (2.0 * step);
    let derivative: f64 = gradient.iter().zip(&direction).map(|(g, d)| g * d).sum();
    assert!(
        (difference - derivative).abs() <= tolerance * derivative.abs().max(1e-3),
        "difference {difference}, derivative {derivative}"
    );
}
