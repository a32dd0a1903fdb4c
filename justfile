# What a change has to pass, one recipe a check; `just --list` shows them.
# `pip install rust-just` brings the program; the recipes use the Python that is active.

set shell := ["bash", "-euo", "pipefail", "-c"]

# All checks but the tests in Python: Rust, style and types, demo, site.
check: rust lint demo docs

# Format, lint and test the Rust crates; their documentation examples are tests too.
rust:
    cargo fmt --all --check
    cargo clippy --workspace --all-targets --locked -- -D warnings
    cargo test --workspace --locked
    RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked --quiet

# Style and types of the Python; the types of the core need the installed package.
lint:
    pip install --quiet '.[lint]'
    ruff check
    ruff format --check
    mypy
    python -m mypy.stubtest phaseatlas._core

# Install the package and run its tests; `just test tests/test_area.py -k gradient` runs some.
test *arguments:
    pip install '.[test]'
    pytest {{ arguments }}

# Run the demo of the README and see that it writes its files.
demo:
    #!/usr/bin/env bash
    set -euo pipefail
    folder=$(mktemp -d)
    trap 'rm -rf "$folder"' EXIT
    phaseatlas demo "$folder"
    for name in atlas.glb atlas.png segments.png blended.glb blended.png; do test -s "$folder/$name"; done

# Build the site in site/, without any network: open site/index.html.
docs:
    pip install --quiet '.[docs]'
    sphinx-build -W --keep-going docs site

# The same with all scripts of the gallery run anew, which takes a while; see examples/run_all.py.
docs-all *arguments:
    pip install --quiet '.[docs]'
    python examples/run_all.py site/run {{ arguments }}
    PHASEATLAS_GALLERY=site/run/gallery sphinx-build -W --keep-going docs site

# Put the Python and the Rust into shape.
format:
    cargo fmt --all
    ruff check --fix
    ruff format

# Hashes of the fields of small runs: the same before and after a change of form.
hashes:
    python benches/field_hashes.py

# All generated surfaces at all levels, without and with distortion: the better part of an hour.
sweep word="":
    python tests/test_sweep.py {{ word }}

# Criterion's benchmarks of the core, all or by name: `just bench perimeter`.
bench *names:
    cargo bench -p phaseatlas-core -- {{ names }}
