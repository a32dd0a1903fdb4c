"""A surface of more than a million faces from file to file, beside xatlas on the same file.

    python benches/compare/large.py [MESH] [--faces 1300000] [--bound 600] [--suffix .obj]

The triangles of the mesh, by default a starfish, are split four in one until there are so many,
and the vertices moved by a hundredth of an edge or so, so that old faces are not flat. Both tools
run in processes of their own: seconds on the clock and of the CPU and the peak of the memory are of
reading, charts, maps, packing, checks, figures and writing for phaseatlas, and of reading, charts,
maps and packing for xatlas. A tool that takes longer than the bound is stopped.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import trimesh

import phaseatlas as pa
from phaseatlas import datasets

PEER = """
import sys, numpy as np, trimesh, xatlas
mesh = trimesh.load(sys.argv[1], process=False)
atlas = xatlas.Atlas()
atlas.add_mesh(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
atlas.generate()
print(atlas.chart_count, "charts")
"""


def write_input(mesh: Path | None, n_faces: int, path: Path) -> int:
    """Write a fine surface and return the number of its faces."""
    surface = datasets.starfish(5) if mesh is None else pa.load(mesh)
    vertices, faces = surface.vertices, surface.faces
    while len(faces) < n_faces:
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    fine = trimesh.Trimesh(vertices, faces, process=False)
    noise = np.random.default_rng(0).standard_normal(vertices.shape)
    fine.vertices = vertices + 0.03 * np.sqrt(fine.area / len(faces)) * noise
    fine.export(path)
    return len(faces)


def timed(command: list[str], bound: float) -> tuple[float, float, float] | None:
    """Seconds on the clock, of the CPU, and gigabytes; None where it takes too long or fails."""
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    while True:
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)
            break
        if time.perf_counter() - start > bound:
            process.send_signal(signal.SIGKILL)
            os.wait4(process.pid, 0)
            process.returncode = -signal.SIGKILL
            return None
        time.sleep(0.02)
    if process.returncode:
        return None
    wall = time.perf_counter() - start
    # Linux counts in kibibytes, macOS in bytes.
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    return wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * unit / 1e9


def main() -> None:
    parser = argparse.ArgumentParser(description="A large surface from file to file.")
    parser.add_argument("mesh", type=Path, nargs="?")
    parser.add_argument("--faces", type=int, default=1_300_000)
    parser.add_argument("--bound", type=float, default=600.0, help="seconds for each tool")
    parser.add_argument("--suffix", choices=[".obj", ".glb", ".ply"], default=".obj")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"large{arguments.suffix}"
        count = write_input(arguments.mesh, arguments.faces, path)
        print(f"{count} faces", flush=True)
        output = path.with_name("out.glb" if arguments.suffix == ".ply" else f"out{path.suffix}")
        commands = {
            "phaseatlas": [
                sys.executable,
                "-m",
                "phaseatlas",
                "atlas",
                str(path),
                "-o",
                str(output),
            ]
        }
        if importlib.util.find_spec("xatlas") is not None:
            commands["xatlas"] = [sys.executable, "-c", PEER, str(path)]
        found = {name: timed(command, arguments.bound) for name, command in commands.items()}
    for name, figures in found.items():
        if figures is None:
            print(f"{name}: failed, or more than {arguments.bound:g} s")
        else:
            wall, cpu, peak = figures
            print(f"{name}: {wall:.1f} s, {cpu:.1f} s of the CPU, {peak:.2f} GB")
    mine, theirs = found["phaseatlas"], found.get("xatlas")
    if mine is not None and theirs is not None:
        ratios = (own / other for own, other in zip(mine, theirs, strict=True))
        print("phaseatlas / xatlas:", *(f"{ratio:.2f}" for ratio in ratios))


if __name__ == "__main__":
    main()
