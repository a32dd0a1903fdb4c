"""Pages of the gallery's scripts, which the build does not run, with the results of a kept run."""

from __future__ import annotations

import os
import re
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

# What sphinx-gallery puts before each block of code.
_MARK = ".. GENERATED FROM PYTHON SOURCE LINES"


def kept(app: Sphinx, page: str, source: list[str]) -> None:
    """Put picture and numbers of a script between its text and its code."""
    found = re.fullmatch(r"generated/gallery/plot_([a-z0-9]+)_\w+", page)
    if not found:
        return
    figure = found[1]
    folder = Path(os.environ.get("PHASEATLAS_GALLERY", app.srcdir / "gallery")).resolve()
    results = [folder / f"{figure}.png", folder / f"{figure}.txt"]
    for result in results:
        if not result.is_file():
            raise ExtensionError(f"{result} is missing; examples/run_all.py writes it")
    picture, numbers = (
        os.path.relpath(result, app.srcdir / "generated" / "gallery") for result in results
    )
    shown = (
        f".. image:: {picture}\n   :alt: {figure}\n   :class: result\n\n"
        f".. literalinclude:: {numbers}\n   :language: text\n\n"
        ".. rubric:: The script\n\n"
    )
    text, code = source[0].split(_MARK, 1)
    source[0] = f"{text}\n{shown}{_MARK}{code}"


def setup(app: Sphinx) -> dict[str, bool]:
    """Watch the pages as they are read."""
    app.connect("source-read", kept)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
