"""phaseatlas view."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated

import typer

from .output import check_output
from .process import Record, complain
from .report import say_written

__all__ = ["view"]


def view(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="A mesh, an atlas, or OUT.npz of segment."),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="OUT.html.", show_default="a temporary page, which is opened"
        ),
    ] = None,
) -> Record:
    """Make a page to look at a file: its surface, charts, stretch, texel density and figures.

    The page is one file and makes no request.
    """
    if output is not None:
        check_output(output, [file], ".html")
    from ..page import write_page
    from ..page.files import subject_of_file

    shown = subject_of_file(file)
    page = output
    if page is None:
        # It stays: who looks at it may do so after this process.
        page = Path(tempfile.mkdtemp(prefix="phaseatlas-"), f"{file.stem}.html")
    write_page(shown, page, title=file.name)
    say_written(page)
    if output is None:
        import webbrowser

        if not webbrowser.open(page.as_uri()):
            complain(f"no browser could be started; open {page}")
    return {"input": str(file), "output": str(page), "files": [str(page)], "metrics": shown.metrics}
