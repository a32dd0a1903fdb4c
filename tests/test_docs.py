"""The pages name files that are there, and numbers that the code has."""

from __future__ import annotations

import ast
import itertools
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    page
    for folder in (ROOT, ROOT / "docs", ROOT / "docs" / "decisions", ROOT / "benches")
    for page in folder.glob("*.md")
)
FOLDERS = (".ci", ".github", "benches", "docs", "examples", "python", "rust", "tests")
FILES = [
    "/" + path.relative_to(ROOT).as_posix()
    for folder in FOLDERS
    for path in (ROOT / folder).rglob("*")
    if "__pycache__" not in path.parts
] + [f"/{path.name}" for path in ROOT.iterdir()]
# Written by what the pages describe.
MADE = {"results.json"}
# Files of the project have these endings; those of its users have others too.
PROJECT = r"[\w./{},-]+\.(?:pyi|py|rs|md|toml)"
DRIVER = ("grids", "stages", "starts", "sharp", "lbfgs")


def named_files(text):
    """Files in backquotes, in drawings and in the drawn tree, braces written out."""
    fences = re.findall(r"^```(\w*)\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)
    blocks = [block for language, block in fences if language in ("", "mermaid")]
    quoted = re.findall(rf"`({PROJECT})`", text)
    drawn = [name for block in blocks for name in re.findall(PROJECT, block)]
    for name in {name.removeprefix("../") for name in (*quoted, *drawn)}:
        parts = [part.split(",") for part in re.split(r"[{}]", name)]
        # Commas outside braces separate nothing.
        parts = [p if k % 2 else [",".join(p)] for k, p in enumerate(parts)]
        yield from ("".join(chosen) for chosen in itertools.product(*parts))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_files_exist(page):
    text = page.read_text()
    missing = [
        name
        for name in named_files(text)
        if name not in MADE and not any(file.endswith(f"/{name}") for file in FILES)
    ]
    links = re.findall(r"\]\((?!https?:)([^)#]+)", text)
    missing += [link for link in links if not (page.parent / link).exists()]
    assert sorted(missing) == []


def constants(path):
    """Upper-case names that a module gives a value, as code."""
    tree = ast.parse(path.read_text())
    return {
        target.id: ast.unparse(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name) and target.id.isupper()
    }


def test_numbers_of_the_driver_are_those_of_the_code():
    page = (ROOT / "docs" / "decisions" / "driver-numbers.md").read_text()
    rows = re.findall(r"^\| `(\w+)` \| `([^`]+)` \|", page, flags=re.MULTILINE)
    written = {name: ast.unparse(ast.parse(value, mode="eval")) for name, value in rows}
    found = {}
    for name in DRIVER:
        folder = "optimise" if name == "lbfgs" else "segmentation"
        found |= constants(ROOT / "python" / "phaseatlas" / folder / f"{name}.py")
    assert written == found
