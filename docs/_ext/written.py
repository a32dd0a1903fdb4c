"""Pages that are written from what is there, so that they stay true: options, names, timings."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

import phaseatlas
from phaseatlas.cli.app import app as cli

if TYPE_CHECKING:
    from sphinx.application import Sphinx

# Parts of the reference: a title, what it is about, and the modules of the package whose names it
# has. What comes from elsewhere is in the last part.
PARTS = {
    "Surfaces and files": ("surface", "transfer", "cutting", "io", "remesh", "scene"),
    "Charts by energy": ("partitioning",),
    "Segments by phase fields": ("segmentation",),
    "Atlases": ("atlas", "unwrapping", "file_atlas", "atlas_options", "batching"),
    "Pages": ("viewer", "page"),
    "Everything else": (),
}
# Modules of the package that are documented name by name, and what each is for.
MODULES = {
    "functionals": "The functionals of the paper, each a value and a gradient.",
    "optimise": "Minimisers of sums of functionals under one constraint.",
    "datasets": "Surfaces to try things on.",
    "plot": "Pictures, drawn without a display or a GPU.",
}
# Names of other modules that the documented ones take or give.
RECORDS = {
    "segmentation.options": ("Options", "Widths"),
    "segmentation.clusters": ("ClusterTree", "cluster_tree"),
    "unwrapping": ("UnwrapReport",),
    "partitioning": ("Phase",),
    "atlas.charts": ("Layout",),
    "atlas.outlines": ("Outlines", "Piece", "Seam", "Notches", "outlines"),
    "atlas.overlap": ("charts_glb",),
    "atlas.metrics": ("Flaws", "atlas_metrics"),
    "scene.document": ("Document", "read_document"),
    "scene.describe": ("describe",),
    "scene.repair": ("RepairReport", "Repaired", "repair"),
    "scene.rebake": ("rebake",),
}


def commands() -> Iterator[tuple[str, Any, list[tuple[str, str, str]]]]:
    """Yield each command's name, itself, and what it takes: names, meaning and default."""
    group = typer.main.get_command(cli)
    context = group.make_context("phaseatlas", [], resilient_parsing=True)
    yield "phaseatlas", group, _taken(group, context)
    for name, command in group.commands.items():
        inner = command.make_context(name, [], parent=context, resilient_parsing=True)
        yield f"phaseatlas {name}", command, _taken(command, inner)


def _taken(command: Any, context: Any) -> list[tuple[str, str, str]]:
    taken = []
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record is not None:
            names, text = record
            meaning, _, default = text.partition("  [")
            taken.append((names, meaning, default.removesuffix("]")))
    return taken


def options_page() -> str:
    """Every command of the command line with every option, as reStructuredText."""
    lines = [
        ".. Written by docs/_ext/written.py.",
        "",
        "Every option",
        "============",
        "",
        "This page is made of the program itself; ``-h`` after a command prints the same. Errors",
        "and warnings are one line each on the error stream. The exit code is 0 for success, 1",
        "for a failure, 2 for arguments that cannot be used, 3 for warnings under ``--strict``,",
        "and 130 after Ctrl-C.",
    ]
    for name, command, taken in commands():
        needed = [names.split()[0] for names, _, _ in taken if not names.startswith("-")]
        usage = " ".join(
            [name, "[OPTIONS]", *needed] if name != "phaseatlas" else [name, "COMMAND"]
        )
        lines += ["", name, "-" * len(name), "", f".. program:: {name}", ""]
        lines += [_literal(paragraph) for paragraph in (command.help or "").strip().splitlines()]
        lines += ["", ".. code-block:: text", "", f"   {usage}", ""]
        for names, meaning, default in taken:
            said = _literal(" ".join([meaning, *([_default(default)] if default else [])]))
            if names.startswith("-"):
                lines += [f".. option:: {names.replace(' / ', ', ')}", "", f"   {said}", ""]
            else:
                lines += [f"``{names}``", f"   {said}", ""]
    return "\n".join(lines) + "\n"


def _default(text: str) -> str:
    """A sentence of what is said in brackets: ``default: (none)``, ``required``, ``x>=0``."""
    text = re.sub(r"default: \((.*?)\)", r"default: \1", text)
    text = re.sub(r"([\d.]+)<=x<=([\d.]+)", r"from \1 to \2", text)
    text = re.sub(r"x>=([\d.]+)", r"at least \1", text)
    return f"{text[0].upper()}{text[1:]}."


def _literal(text: str) -> str:
    """Text in which reStructuredText sees no markup."""
    options = re.sub(r"(?<![\w-])(--[a-z][a-z-]*)", r"``\1``", text)
    pieces = options.split("``")
    return "``".join(
        p if k % 2 else re.sub(r"([*_`|\\])", r"\\\1", p) for k, p in enumerate(pieces)
    )


def reference_page() -> str:
    """Every public name, in parts, as reStructuredText."""
    names = [n for n in phaseatlas.__all__ if n not in (*MODULES, "__version__")]
    left = {name: getattr(phaseatlas, name).__module__.split(".")[1] for name in names}
    lines = [
        ".. Written by docs/_ext/written.py.",
        "",
        "Reference",
        "=========",
        "",
        ".. currentmodule:: phaseatlas",
        "",
        "``import phaseatlas as pa`` gives all names of the first parts. They stay: each keyword,",
        "attribute and key of a file, too.",
    ]
    for title, modules in PARTS.items():
        chosen = [n for n, module in left.items() if module in modules or not modules]
        left = {n: module for n, module in left.items() if n not in chosen}
        lines += _part(title, chosen, "")
    for module, about in MODULES.items():
        found = getattr(phaseatlas, module)
        # Aliases of types and constants have no page.
        verbs = [n for n in found.__all__ if _is_verb(getattr(found, n))]
        lines += _part(f"phaseatlas.{module}", verbs, f"{module}.", about)
    lines += ["", "Records and helpers", "-------------------", ""]
    lines += ["What the functions above take, give or are made of.", ""]
    lines += [".. autosummary::", "   :toctree: reference", ""]
    lines += [f"   {module}.{name}" for module, some in RECORDS.items() for name in some]
    return "\n".join(lines) + "\n"


def benchmarks_page(results: str) -> str:
    """Of `benches/RESULTS.md`: one surface, the quickest peers, the program of the authors."""
    surface = "icosphere, 40,962 vertices"
    lines = [
        ".. Written by docs/_ext/written.py.",
        "",
        "Benchmarks",
        "==========",
        "",
        f"Milliseconds on two cores, {surface}: the minimum over the rounds, of phaseatlas",
        "and of the quickest peer that does the whole work, called in turn in one run. *Authors*",
        "is the C++ program of the paper's authors, on another machine with two cores; its solves",
        "with distortion are of 300 steps. The :doc:`full tables </timings>` have all peers.",
        "",
        *_table_head(
            "Pieces of work", ("work", "phaseatlas", "peer", "its time", "ratio", "authors")
        ),
    ]
    rows: dict[str, list[list[str]]] = {}
    for work, contender, least, _, ratio, _, authors in _rows(results, surface):
        if "(part)" not in contender:
            rows.setdefault(work, []).append([contender, least, ratio, authors])
    for work, (own, *peers) in rows.items():
        best = min(peers, key=lambda peer: float(peer[1]), default=["none", "", "", ""])
        lines += _table_row(work, own[1], best[0], *best[1:3], own[3])
    lines += ["", "Seconds of whole solves, two segments from random values:", ""]
    names, *figures = _rows(results, f"{surface}, two segments from random u", head=True)
    wanted = dict(zip([row[0] for row in figures], [row[1:] for row in figures], strict=True))
    lines += _table_head("Whole solves", ("solve", "seconds", "CPU", "steps", "authors"))
    for k, name in enumerate(names[1:]):
        keys = ("seconds", "CPU seconds", "iterations", "authors' seconds")
        lines += _table_row(name, *(wanted[key][k] for key in keys))
    lines += ["", ":doc:`/atlas_quality` rates whole atlases beside those of other tools."]
    return "\n".join(lines) + "\n"


def _rows(text: str, title: str, *, head: bool = False) -> list[list[str]]:
    """Rows of the table under a heading."""
    section = text.split(f"### {title}\n", 1)[1].split("\n#", 1)[0]
    rows = [line.strip("| ").split(" | ") for line in section.splitlines() if line.startswith("|")]
    cells = [[cell.strip(" |") for cell in line] for line in rows]
    wide = [line + [""] * (len(cells[0]) - len(line)) for line in cells]
    return [*wide[:1], *wide[2:]] if head else wide[2:]


def _table_head(title: str, names: Iterable[str]) -> list[str]:
    return [f".. list-table:: {title}", "   :header-rows: 1", "", *_table_row(*names)]


def _table_row(*cells: str) -> list[str]:
    lead = ["   * - ", *["     - "] * (len(cells) - 1)]
    return [f"{before}{_literal(cell)}".rstrip() for before, cell in zip(lead, cells, strict=True)]


def _is_verb(found: object) -> bool:
    return inspect.isroutine(found) or inspect.isclass(found)


def _part(title: str, names: list[str], prefix: str, about: str = "") -> list[str]:
    if not names:
        return []
    head = [
        "",
        title,
        "-" * len(title),
        "",
        about,
        "",
        ".. autosummary::",
        "   :toctree: reference",
        "",
    ]
    return head + [f"   {prefix}{name}" for name in names]


def write(app: Sphinx) -> None:
    """Write the pages, where they have changed."""
    folder = Path(app.srcdir, "generated")
    folder.mkdir(exist_ok=True)
    results = Path(app.srcdir.parent, "benches", "RESULTS.md").read_text(encoding="utf-8")
    pages = {
        "options": options_page(),
        "reference": reference_page(),
        "benchmarks": benchmarks_page(results),
    }
    for name, text in pages.items():
        path = folder / f"{name}.rst"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before autosummary looks for names."""
    app.connect("builder-inited", write, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
