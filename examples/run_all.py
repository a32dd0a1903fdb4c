"""Draw all pictures of the gallery and write its page.

``python examples/run_all.py docs`` writes ``docs/gallery.md`` and the pictures and numbers of
``docs/gallery/``. The page is made of the scripts: their titles, their texts, what they print.
"""

from __future__ import annotations

import argparse
import ast
import subprocess
import sys
import time
from pathlib import Path

EXAMPLES = Path(__file__).parent
# The meshes that scripts can use where they are given.
MODELS = {
    "plot_charts_by_energy": ["spot.obj", "hand.obj", "fertility.obj"],
    "plot_figure5_atlas": ["spot.obj"],
    "plot_figure9_fertility": ["fertility.obj"],
}

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("folder", type=Path, help="where gallery.md and gallery/ are written")
parser.add_argument("--meshes", type=Path, help="folder with spot.obj, hand.obj and fertility.obj")
parser.add_argument("--only", nargs="+", metavar="FIGURE", help="such as figure6; keep the others")
parser.add_argument("--quick", action="store_true", help="small and fast")
arguments = parser.parse_args()

pictures = arguments.folder / "gallery"
pictures.mkdir(parents=True, exist_ok=True)
page = [
    "# Gallery",
    "Atlases of models and the paper's figures, each by a short script in "
    "[`examples/`](../examples), with the numbers it prints. `python examples/run_all.py docs` "
    "makes this page; `--meshes FOLDER` gives it the models `spot.obj`, `hand.obj` and "
    "`fertility.obj`.",
]
for script in sorted(EXAMPLES.glob("plot_*.py")):
    figure = script.stem.split("_")[1]
    output = pictures / f"{figure}.txt"
    if arguments.only is None or figure in arguments.only:
        options = ["--quick"] if arguments.quick else []
        if arguments.meshes and script.stem in MODELS:
            options += ["--model", *(str(arguments.meshes / name) for name in MODELS[script.stem])]
        began = time.perf_counter()
        run = subprocess.run(
            [sys.executable, str(script), str(pictures), *options],
            stdout=subprocess.PIPE,
            text=True,
        )
        print(f"{run.stdout}{script.name}: {time.perf_counter() - began:.0f} s\n", flush=True)
        if run.returncode:
            sys.exit(f"{script.name} failed")
        printed = [line for line in run.stdout.splitlines() if not line.startswith("wrote ")]
        output.write_text("\n".join(printed) + "\n")
    if not output.exists():
        continue
    title, _, text = ast.get_docstring(ast.parse(script.read_text())).split("\n", 2)
    page += [f"## {title}", f"[`{script.name}`](../examples/{script.name})", text.strip()]
    if (pictures / f"{figure}.png").exists():
        page.append(f"![{title}](gallery/{figure}.png)")
    page.append(f"```text\n{output.read_text().rstrip()}\n```")
(arguments.folder / "gallery.md").write_text("\n\n".join(page) + "\n")
