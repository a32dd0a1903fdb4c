//! Evaluations allocate nothing once their buffers are there. One test, since the counter sees the
//! whole process.

#![expect(unsafe_code, reason = "the trait of allocators is unsafe")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use phaseatlas_core::functionals::{
    Connectedness, Distortion, Form, Formulation, Functional, Phases,
};
use phaseatlas_core::linear::{Cholesky, Factorisation, Ordering, SymbolicFactorisation};
use phaseatlas_core::{Surface, TriangleMesh};

struct Counting;

static COUNT: AtomicUsize = AtomicUsize::new(0);

unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.fetch_add(1, Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        COUNT.fetch_add(1, Relaxed);
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn allocations(work: impl FnOnce()) -> usize {
    let before = COUNT.load(Relaxed);
    work();
    COUNT.load(Relaxed) - before
}

const K: usize = 60;

/// A wavy sheet of K x K squares.
fn sheet() -> TriangleMesh {
    let at = |i: usize| i as f64 / K as f64;
    let vertices = (0..(K + 1) * (K + 1))
        .map(|v| (at(v % (K + 1)), at(v / (K + 1))))
        .map(|(x, y)| [x, y, 0.1 * (6.0 * x).sin() * (5.0 * y).cos()])
        .collect();
    let mut faces = Vec::new();
    for v in (0..(K + 1) * K).filter(|v| v % (K + 1) != K) {
        let [a, b, c, d] = [v, v + 1, v + K + 2, v + K + 1].map(|v| v as i64);
        faces.extend([[a, b, c], [a, c, d]]);
    }
    TriangleMesh::new(vertices, &faces).expect("a sheet is a valid mesh")
}

/// Lower triangle of the five-point Laplacian on a K x K grid.
fn laplacian() -> (Vec<usize>, Vec<u32>, Vec<f64>) {
    let (mut starts, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
    for j in 0..K * K {
        rows.push(j as u32);
        values.push(4.1);
        for i in [j + 1, j + K] {
            if i < K * K && (i != j + 1 || i % K != 0) {
                rows.push(i as u32);
                values.push(-1.0);
            }
        }
        starts.push(rows.len());
    }
    (starts, rows, values)
}

#[test]
fn nothing_is_allocated_after_the_first_call() {
    let (starts, rows, values) = laplacian();
    for factorisation in [Factorisation::Simplicial, Factorisation::Supernodal] {
        let symbolic =
            SymbolicFactorisation::new(&starts, &rows, Ordering::LeastWork, factorisation).unwrap();
        let mut cholesky = Cholesky::new(Arc::new(symbolic)).unwrap();
        let mut columns = vec![1.0; 2 * K * K];
        let mut doubled = values.clone();
        let mut both = || {
            for value in &mut doubled {
                *value *= 2.0;
            }
            cholesky.factor(&doubled).unwrap();
            cholesky.solve(&mut columns).unwrap();
        };
        assert!(
            allocations(&mut both) > 0,
            "the counter sees the first call"
        );
        assert_eq!(allocations(&mut both), 0, "{factorisation:?}");
    }

    // Within the pool: to call into it from outside is what the pool itself allocates for.
    let surface = Arc::new(Surface::new(sheet()));
    let mesh = surface.mesh();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(2)
        .build()
        .unwrap();
    let fields: Vec<Vec<f64>> = (0..6)
        .map(|k| {
            let wave = |p: &[f64; 3]| 0.02 * (9.0 * p[0] + 4.0 * p[1] + f64::from(k)).sin();
            mesh.vertices().iter().map(wave).collect()
        })
        .collect();
    for formulation in [Formulation::Paper, Formulation::Sharp] {
        let make =
            || Distortion::new(surface.clone(), formulation, 0.05, 0.02, 1e-3, None).unwrap();
        let evaluate = |functional: &Distortion, gradient: &mut [f64], fields: &[Vec<f64>]| {
            for u in fields {
                functional.value_and_gradient(u, gradient).unwrap();
            }
        };
        // The dense kernels keep memory of their own for each thread.
        pool.broadcast(|_| evaluate(&make(), &mut vec![0.0; mesh.n_vertices()], &fields[..1]));
        let functional = make();
        let mut gradient = vec![0.0; mesh.n_vertices()];
        pool.install(|| {
            evaluate(&functional, &mut gradient, &fields[..1]);
            let count = allocations(|| evaluate(&functional, &mut gradient, &fields[1..]));
            assert_eq!(count, 0, "{formulation:?}");
        });
    }

    // One thread, so that the same buffers come to the same searches again.
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    let fields: Vec<Vec<f64>> = (0..4)
        .map(|k| {
            let wave = |p: &[f64; 3]| (30.0 * p[0] + f64::from(k)).sin() * (20.0 * p[1]).cos();
            mesh.vertices().iter().map(wave).collect()
        })
        .collect();
    for form in [Form::Pairs, Form::Tree] {
        let functional = Connectedness::new(surface.clone(), 0.7, None, Phases::Both).unwrap();
        let functional = functional.with_form(form);
        let mut gradient = vec![0.0; mesh.n_vertices()];
        let mut all = || {
            for u in &fields {
                assert!(functional.value_and_gradient(u, &mut gradient).unwrap() > 0.0);
            }
        };
        pool.install(|| {
            assert!(allocations(&mut all) > 0);
            assert_eq!(allocations(&mut all), 0, "{form:?}");
        });
    }
}
