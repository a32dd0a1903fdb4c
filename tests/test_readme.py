import re
from pathlib import Path

import trimesh

import phaseatlas as pa

ROOT = Path(__file__).parents[1]
# The second goes on where the first ends.
PAGES = (ROOT / "README.md", ROOT / "docs" / "usage.md")


def test_python_examples_run(tmp_path, monkeypatch):
    surface = pa.datasets.starfish(3)
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    mesh.export(tmp_path / "model.obj")
    monkeypatch.chdir(tmp_path)
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    assert len(blocks) == 3
    namespace = {}
    for block in blocks:
        exec(block, namespace)
    assert namespace["tree"].components.tolist() == [1] * 8
    assert (tmp_path / "model.npz").exists()
    assert (tmp_path / "model.glb").exists()
