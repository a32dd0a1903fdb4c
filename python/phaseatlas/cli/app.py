"""The application: its commands, and the options that stand before them."""

from __future__ import annotations

from typing import Annotated

import typer

from ..meanings import METRICS
from .atlas import atlas
from .batch import batch
from .demo import demo
from .meshes import info, remesh
from .process import USAGE, checked, say
from .segment import segment
from .view import view

__all__ = ["app"]

# Without rich, whose boxes spread a message over lines and take a tenth of a second to import.
app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback(invoke_without_command=True)
def phaseatlas(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    """Cut surfaces into connected segments of equal area and turn them into texture atlases."""
    if version:
        from .._core import __version__

        say(f"phaseatlas {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help(), err=True)
        raise typer.Exit(USAGE)


# \b keeps the lines of a paragraph apart.
_FIGURES = "\b\nFigures of an atlas:\n" + "\n".join(
    f"  {name:10}  {meaning}" for name, meaning in METRICS.items()
)

for command in (segment, atlas, batch, view, remesh, info, demo):
    epilog = _FIGURES if command is atlas else None
    app.command(command.__name__, epilog=epilog)(checked(command))
