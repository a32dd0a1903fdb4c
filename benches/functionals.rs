//! One value and gradient of every functional.

mod meshes;

use std::sync::Arc;
use std::time::Duration;

use criterion::{Criterion, SamplingMode, criterion_group, criterion_main};
use meshes::{Case, Random, cases, distance, unit};
use phaseatlas_core::functionals::{
    Area, Connectedness, Distortion, Form, Formulation, Functional, Perimeter, Phases,
};

type WithForm = fn(Connectedness) -> Connectedness;

/// Ways to evaluate the connectedness.
const FORMS: [(&str, WithForm); 2] = [("pairs", |c| c), ("tree", |c| c.with_form(Form::Tree))];

/// tanh across an interface at signed distance `x`.
fn profile(x: f64, epsilon: f64) -> f64 {
    (3.0 * x / (2.0 * 2_f64.sqrt() * epsilon)).tanh()
}

/// Two halves, as after a solve.
fn halves(case: &Case) -> Vec<f64> {
    case.surface
        .mesh()
        .vertices()
        .iter()
        .map(|p| profile(p[0] + 0.1 * p[1], case.epsilon))
        .collect()
}

/// Caps around `count` directions spread over the sphere (a Fibonacci lattice), which together
/// take a quarter of it: one component of the positive phase each.
fn caps(case: &Case, count: usize) -> Vec<f64> {
    let golden_angle = std::f64::consts::PI * (3.0 - 5_f64.sqrt());
    let centres: Vec<[f64; 3]> = (0..count)
        .map(|i| {
            let z = 1.0 - (2 * i + 1) as f64 / count as f64;
            let (sine, cosine) = (golden_angle * i as f64).sin_cos();
            let radius = (1.0 - z * z).sqrt();
            [radius * cosine, radius * sine, z]
        })
        .collect();
    let chord = (1.0 / count as f64).sqrt();
    // A sphere of unit area has this radius.
    let radius = (0.25 / std::f64::consts::PI).sqrt();
    case.surface
        .mesh()
        .vertices()
        .iter()
        .map(|&p| {
            let nearest = centres
                .iter()
                .map(|&centre| distance(unit(p), centre))
                .fold(f64::INFINITY, f64::min);
            profile(radius * (chord - nearest), case.epsilon)
        })
        .collect()
}

/// Random values, of the amplitude at which about `count` components arise.
fn noise(case: &Case, count: usize) -> Vec<f64> {
    let mut random = Random(2);
    let signs: Vec<f64> = (0..case.surface.mesh().n_vertices())
        .map(|_| 2.0 * random.uniform() - 1.0)
        .collect();
    let functional = connectedness(case);
    let scaled = |amplitude: f64| -> Vec<f64> { signs.iter().map(|s| amplitude * s).collect() };
    let (mut low, mut high) = (0.9, 1.5);
    for _ in 0..30 {
        let amplitude = 0.5 * (low + high);
        let (found, _) = functional
            .components(&scaled(amplitude))
            .expect("u fits the mesh");
        if found < count {
            low = amplitude;
        } else {
            high = amplitude;
        }
    }
    scaled(high)
}

fn connectedness(case: &Case) -> Connectedness {
    Connectedness::new(
        case.surface.clone(),
        1.0 - case.epsilon.sqrt(),
        None,
        Phases::Positive,
    )
    .expect("epsilon is below 1")
}

/// Times `make(case)` at `field(case)` on every surface.
fn bench<F: Functional>(
    criterion: &mut Criterion,
    name: &str,
    make: impl Fn(&Case) -> F,
    field: impl Fn(&Case) -> Vec<f64>,
) {
    let mut group = criterion.benchmark_group(name);
    group
        .sample_size(10)
        .sampling_mode(SamplingMode::Flat)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_secs(1));
    for case in cases() {
        let functional = make(&case);
        let u = field(&case);
        // The factorisation keeps what has not changed since the last call.
        let moved: Vec<f64> = u.iter().map(|x| x * (1.0 - 1e-9)).collect();
        let mut fields = [&u, &moved].into_iter().cycle();
        let mut gradient = vec![0.0; u.len()];
        group.bench_function(&case.label, |bencher| {
            bencher.iter(|| {
                let u = fields.next().expect("a cycle has no end");
                functional
                    .value_and_gradient(u, &mut gradient)
                    .expect("u fits the mesh")
            });
        });
    }
    group.finish();
}

fn functionals(criterion: &mut Criterion) {
    bench(
        criterion,
        "perimeter",
        |case| Perimeter::new(case.surface.clone(), case.epsilon).expect("epsilon is positive"),
        halves,
    );
    bench(
        criterion,
        "area",
        |case| {
            Area::new(case.surface.mesh(), 0.1 * case.epsilon, None).expect("delta is in [0, 1)")
        },
        halves,
    );
    bench(
        criterion,
        "connectedness, 1 component",
        connectedness,
        halves,
    );
    for (form, with_form) in FORMS {
        let make = |case: &Case| with_form(connectedness(case));
        let name = |components: &str| format!("connectedness {form}, {components} components");
        bench(criterion, &name("20"), make, |case| caps(case, 20));
        bench(criterion, &name("250"), make, |case| noise(case, 250));
    }
    for (name, formulation, eta) in [
        ("distortion sharp", Formulation::Sharp, 1e-6),
        ("distortion paper", Formulation::Paper, 1e-3),
    ] {
        let make = |case: &Case| {
            let (surface, epsilon) = (Arc::clone(&case.surface), case.epsilon);
            Distortion::new(surface, formulation, epsilon, 0.1 * epsilon, eta, None)
                .expect("the parameters are valid")
        };
        bench(criterion, name, make, halves);
    }
}

criterion_group!(benches, functionals);
criterion_main!(benches);
