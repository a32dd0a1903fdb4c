//! Refilling the weighted stiffness, and the Cholesky factorisation of S + diag(m p).

mod meshes;

use std::sync::Arc;
use std::time::Duration;

use criterion::{Criterion, SamplingMode, criterion_group, criterion_main};
use meshes::{Random, cases};
use phaseatlas_core::TriangleMesh;
use phaseatlas_core::linear::{Cholesky, Factorisation, Ordering, SymbolicFactorisation};
use phaseatlas_core::operators::Stiffness;

/// The lower triangle of the stiffness' pattern: starts of the columns and rows of the entries.
fn lower_triangle(mesh: &TriangleMesh) -> (Vec<usize>, Vec<u32>) {
    let mut starts = vec![0];
    let mut rows = Vec::new();
    let mut edges = mesh.edges().iter().peekable();
    for column in 0..mesh.n_vertices() {
        rows.push(column as u32);
        while let Some(edge) = edges.next_if(|edge| edge[0] as usize == column) {
            rows.push(edge[1]);
        }
        starts.push(rows.len());
    }
    (starts, rows)
}

fn linear(criterion: &mut Criterion) {
    for case in cases() {
        let mesh = case.surface.mesh();
        let mut random = Random(3);
        let weight: Vec<f64> = (0..mesh.n_vertices()).map(|_| random.uniform()).collect();
        let mut stiffness = Stiffness::new(mesh);

        let mut group = criterion.benchmark_group(&case.label);
        group
            .sample_size(10)
            .sampling_mode(SamplingMode::Flat)
            .warm_up_time(Duration::from_millis(200))
            .measurement_time(Duration::from_secs(1));
        group.bench_function("stiffness refill", |bencher| {
            bencher.iter(|| stiffness.refill(mesh, &weight, 1e-3));
        });

        let (starts, rows) = lower_triangle(mesh);
        let analyse = || {
            SymbolicFactorisation::new(
                &starts,
                &rows,
                Ordering::LeastWork,
                Factorisation::Automatic,
            )
            .expect("there is memory")
        };
        group.bench_function("cholesky analyse", |bencher| bencher.iter(analyse));

        let stiffness = Stiffness::new(mesh);
        // The penalty of one phase in the sharp formulation of the distortion.
        let penalty: Vec<f64> = mesh
            .vertices()
            .iter()
            .zip(mesh.mass())
            .map(|(p, m)| {
                if p[0] < 0.0 {
                    30.0 * m / case.epsilon.powi(2)
                } else {
                    1e-3 * m
                }
            })
            .collect();
        let system = case.surface.dirichlet_system().expect("there is memory");
        // What has not changed since the last factorisation is kept: every value has.
        let matrices = [1.0, 1.0 + 1e-9].map(|scale| {
            let mut values = vec![0.0; system.len()];
            system.fill(mesh, &stiffness, &penalty, &mut values);
            for value in &mut values {
                *value *= scale;
            }
            values
        });
        let mut matrices = matrices.iter().cycle();
        let mut cholesky = Cholesky::new(Arc::new(analyse())).expect("there is memory");
        group.bench_function("cholesky refactor", |bencher| {
            bencher.iter(|| {
                cholesky
                    .factor(matrices.next().expect("a cycle has no end"))
                    .expect("the matrix is positive definite");
            });
        });
        let mut column = weight.clone();
        group.bench_function("cholesky solve", |bencher| {
            bencher.iter(|| {
                column.copy_from_slice(&weight);
                cholesky.solve(&mut column).expect("the length fits");
            });
        });
        group.finish();
    }
}

criterion_group!(benches, linear);
criterion_main!(benches);
