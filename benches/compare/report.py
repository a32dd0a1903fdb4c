"""The tables of the terminal, `benches/RESULTS.md` and `benches/results.json`.

A run writes its own section of the Markdown and leaves the other one as it is; `benches/NOTES.md`,
which is written by hand, is its end. The JSON file, which the repository does not keep, has the
numbers of the last run of each command with all their digits.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

__all__ = ["publish"]

_FOLDER = Path(__file__).parents[1]
_AUTHORS = "the authors' C++"
_MOST_COLUMNS = 12
_TITLES = {"work": "Pieces of work", "solves": "Whole solves"}

_INTRODUCTION = f"""# Results

Made by `benches/compare/run.py` and `benches/compare/solves.py`; `README.md` beside this file
says how. Not to be edited.

Within a table all columns but *{_AUTHORS}* are of one run on one machine, the contenders called in
turn. Times of pieces of work are milliseconds, minimum and median over the rounds; the ratio is the
minimum over that of phaseatlas: above 1, phaseatlas is faster. Before they are timed, peers are
checked to return what phaseatlas returns, to a relative 1e-8. *(part)* marks a bound: it does a
part of the work only.

*{_AUTHORS}* are figures of the design notes: the authors' C++ (OpenMP, CHOLMOD) on another machine
with two cores, icosphere of 40,962 vertices, not in the same run. Their solve with distortion is
one of 300 steps.

Times of whole solves are seconds of wall but where it says CPU; `README.md` explains the columns.
"""


def publish(section: str, about: dict[str, Any], rows: list[dict[str, Any]]) -> None:
    """Print the rows of a section, and keep them in `RESULTS.md` and `results.json`.

    Parameters
    ----------
    section : {"work", "solves"}
    about : dict
        Of the run, as `measure.about` returns it.
    rows : list of dict
        All with the same keys, which become the columns; "table" names the table of a row.
    """
    numbers = _FOLDER / "results.json"
    results = json.loads(numbers.read_text()) if numbers.exists() else {}
    results[section] = {"run": about, "rows": rows}
    numbers.write_text(json.dumps(dict(sorted(results.items())), indent=1) + "\n")
    page = _FOLDER / "RESULTS.md"
    kept = _sections(page.read_text()) if page.exists() else {}
    kept[_TITLES[section]] = _section(about, rows)
    parts = [f"## {title}\n\n{kept[title]}" for title in _TITLES.values() if title in kept]
    page.write_text("\n".join([_INTRODUCTION, *parts, (_FOLDER / "NOTES.md").read_text()]))
    console = Console()
    for title, cells in _tables(rows):
        table = Table(*cells[0], title=title)
        for row in cells[1:]:
            table.add_row(*row)
        console.print(table)


def _tables(rows: list[dict[str, Any]]) -> list[tuple[str, list[list[str]]]]:
    tables: dict[str, list[list[str]]] = {}
    for row in rows:
        columns = {name: value for name, value in row.items() if name != "table"}
        cells = tables.setdefault(row["table"], [list(columns)])
        cells.append([_cell(value) for value in columns.values()])
    return [
        # Figures of one solve are many: they go down the page.
        (title, [list(column) for column in zip(*cells, strict=True)])
        if len(cells[0]) > _MOST_COLUMNS
        else (title, cells)
        for title, cells in tables.items()
    ]


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        if value == 0 or not 1e-3 <= abs(value) < 1e5:
            return f"{value:.1e}"
        return f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"
    return str(value)


def _sections(page: str) -> dict[str, str]:
    """The text below each heading of the second level."""
    found = {}
    for part in f"\n{page}".split("\n## ")[1:]:
        title, _, text = part.partition("\n")
        found[title] = text.strip("\n") + "\n"
    return found


def _section(about: dict[str, Any], rows: list[dict[str, Any]]) -> str:
    parts = [_run(about)]
    for heading, cells in _tables(rows):
        lines = ["| " + " | ".join(row) + " |" for row in cells]
        lines.insert(1, "|" + " --- |" * len(cells[0]))
        parts.append(f"### {heading}\n\n" + "\n".join(lines) + "\n")
    return "\n".join(parts)


def _run(about: dict[str, Any]) -> str:
    lines = []
    for name, value in about.items():
        if isinstance(value, dict):
            value = ", ".join(f"{key} {version}" for key, version in value.items())
        elif isinstance(value, list):
            value = "; ".join(str(entry) for entry in value)
        lines.append(f"- {name}: {f'`{value}`' if name == 'command' else value}")
    return "\n".join(lines) + "\n"
