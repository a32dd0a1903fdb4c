"""PLY files as they are: elements with numbers and lists, of any name, in text or binary."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Ints
from .polygons import starts_of, walk

__all__ = ["Element", "Lists", "Ply", "read_elements", "write_elements"]

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_NAMES = {
    **{"i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint"},
    **{"f4": "float", "f8": "double"},
}
Column = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Lists:
    """A list a row: their sizes, and all members one list after the other."""

    sizes: Ints
    values: Column

    def take(self, rows: Ints) -> Lists:
        """The lists of some rows."""
        sizes = self.sizes[rows]
        inside = np.arange(sizes.sum()) - np.repeat(starts_of(sizes), sizes)
        return Lists(sizes, self.values[np.repeat(starts_of(self.sizes)[rows], sizes) + inside])


@dataclass(frozen=True, eq=False)
class Element:
    """Columns by name, each with a number or a list a row."""

    rows: int
    columns: dict[str, Column | Lists]


@dataclass(frozen=True, eq=False)
class Ply:
    """Elements by name, the lines of comments, and whether the file is in ASCII."""

    elements: dict[str, Element]
    comments: tuple[str, ...] = ()
    text: bool = False


@dataclass(frozen=True)
class _Property:
    name: str
    type: str
    # Type of the length of a list; none for a number.
    length: str | None = None


def read_elements(data: bytes) -> Ply:
    """Read a file in ASCII or binary of either byte order.

    Raises
    ------
    ValueError
        For a header that makes no sense and a file that is cut short.
    """
    form, declared, comments, start = _header(data)
    elements: dict[str, Element] = {}
    if form == "ascii":
        words = np.array(data[start:].split(), dtype=np.bytes_)
        try:
            numbers = words.astype(np.float64)
        except ValueError as error:
            raise ValueError("a value is no number") from error
        place = 0
        for name, rows, properties in declared:
            elements[name], place = _text_rows(numbers, place, rows, properties)
    else:
        order = "<" if form == "binary_little_endian" else ">"
        place = start
        for name, rows, properties in declared:
            elements[name], place = _binary_rows(data, place, rows, properties, order)
    return Ply(elements, comments, form == "ascii")


def _header(
    data: bytes,
) -> tuple[str, list[tuple[str, int, list[_Property]]], tuple[str, ...], int]:
    place = data.find(b"end_header")
    if not data.startswith(b"ply") or place < 0:
        raise ValueError("there is no PLY header")
    # Old Macintosh files end their lines with a carriage return alone.
    end = place + len(b"end_header")
    start = end + 1 if data[end : end + 1] == b"\r" and data[end + 1 : end + 2] != b"\n" else 0
    start = start or data.find(b"\n", place) + 1 or len(data)
    form, comments = "", []
    declared: list[tuple[str, int, list[_Property]]] = []
    for line in data[:place].decode("latin-1").splitlines():
        match line.split():
            case ["format", form, *_] if form in (
                "ascii",
                "binary_little_endian",
                "binary_big_endian",
            ):
                pass
            case ["comment" | "obj_info", *_]:
                comments.append(line)
            case ["element", name, rows]:
                declared.append((name, int(rows), []))
            case ["property", "list", length, kind, name] if declared:
                declared[-1][2].append(_Property(name, _TYPES[kind], _TYPES[length]))
            case ["property", kind, name] if declared and kind in _TYPES:
                declared[-1][2].append(_Property(name, _TYPES[kind]))
            case ["ply"] | []:
                pass
            case ["format" | "element" | "property", *_]:
                raise ValueError(f"the header says {line.strip()[:40]!r}")
            case _:
                # Some exporters leave the keyword out.
                comments.append(f"comment {line.strip()}")
    if not form:
        raise ValueError("the header names no format")
    return form, declared, tuple(comments), start


def _text_rows(
    numbers: Column, place: int, rows: int, properties: list[_Property]
) -> tuple[Element, int]:
    step = dict.fromkeys(["i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"], 1)

    def read(offsets: Ints, kind: str) -> Column:
        return numbers[offsets].astype(f"<{kind}")

    return _rows(read, len(numbers), place, rows, properties, step)


def _binary_rows(
    data: bytes, place: int, rows: int, properties: list[_Property], order: str
) -> tuple[Element, int]:
    step = {kind: int(kind[1]) for kind in _NAMES}
    raw = np.frombuffer(data, dtype=np.uint8)

    def read(offsets: Ints, kind: str) -> Column:
        size = step[kind]
        window = np.lib.stride_tricks.sliding_window_view(raw, size)
        taken = np.ascontiguousarray(window[offsets]).view(f"{order}{kind}").reshape(-1)
        return taken.astype(f"<{kind}")

    return _rows(read, len(data), place, rows, properties, step)


def _rows(
    read: Any, end: int, place: int, rows: int, properties: list[_Property], step: dict[str, int]
) -> tuple[Element, int]:
    """Columns of an element, by the places of its values; without a loop where lists are even."""
    if rows == 0:
        empty = np.zeros(0, dtype=np.int64)
        return Element(0, {p.name: _empty(p, empty) for p in properties}), place
    least = sum(step[p.length or p.type] for p in properties)
    if place + rows * least > end:
        raise ValueError("the file is cut short")
    sizes = _even(read, end, place, rows, properties, step)
    if sizes is None:
        sizes = _uneven(read, end, place, rows, properties, step)
    lengths = np.zeros(rows, dtype=np.int64)
    within = []
    for p in properties:
        within.append(lengths.copy())
        if p.length is None:
            lengths += step[p.type]
        else:
            lengths += step[p.length] + step[p.type] * sizes[p.name]
    starts = place + starts_of(lengths)
    if starts[-1] + lengths[-1] > end:
        raise ValueError("the file is cut short")
    columns: dict[str, Column | Lists] = {}
    for p, offset in zip(properties, within, strict=True):
        at = starts + offset
        if p.length is None:
            columns[p.name] = read(at, p.type)
            continue
        size = sizes[p.name]
        inside = np.arange(size.sum()) - np.repeat(starts_of(size), size)
        members = np.repeat(at + step[p.length], size) + step[p.type] * inside
        columns[p.name] = Lists(size, read(members, p.type))
    return Element(rows, columns), int(starts[-1] + lengths[-1])


def _empty(p: _Property, empty: Ints) -> Column | Lists:
    none = np.zeros(0, dtype=f"<{p.type}")
    return none if p.length is None else Lists(empty, none)


def _even(
    read: Any, end: int, place: int, rows: int, properties: list[_Property], step: dict[str, int]
) -> dict[str, Ints] | None:
    """Sizes of the lists, if those of all rows are as in the first."""
    at, offsets, first = place, {}, {}
    for p in properties:
        if p.length is None:
            at += step[p.type]
            continue
        if at + step[p.length] > end:
            return None
        first[p.name] = max(int(read(np.array([at]), p.length)[0]), 0)
        offsets[p.name] = at
        at += step[p.length] + step[p.type] * first[p.name]
    if place + rows * (at - place) > end:
        return None
    index = np.arange(rows) * (at - place)
    sizes = {}
    for p in properties:
        if p.length is not None:
            sizes[p.name] = read(offsets[p.name] + index, p.length).astype(np.int64)
            if (sizes[p.name] != first[p.name]).any():
                return None
    return sizes


def _uneven(
    read: Any, end: int, place: int, rows: int, properties: list[_Property], step: dict[str, int]
) -> dict[str, Ints]:
    lists = [p for p in properties if p.length is not None]
    whole = np.arange(place, end)
    if len(lists) == 1 and (length := lists[0].length) is not None:
        (p,) = lists
        # A length of more bytes than one is read at every place where it might stand.
        counts = read(whole[: len(whole) - step[length] + 1], length).astype(np.int64)
        at = [q.name for q in properties].index(p.name)
        before = sum(step[q.type] for q in properties[:at])
        after = sum(step[q.type] for q in properties[at + 1 :]) + step[length] - 1
        try:
            starts = np.array(walk(counts.tolist(), rows, 0, before, after, step[p.type]))
        except IndexError as error:
            raise ValueError("the file is cut short") from error
        return {p.name: counts[starts[:-1] + before]}
    sizes: dict[str, list[int]] = {p.name: [] for p in lists}
    at = place
    for _ in range(rows):
        for p in properties:
            if p.length is None:
                at += step[p.type]
                continue
            if at + step[p.length] > end:
                raise ValueError("the file is cut short")
            size = int(read(np.array([at]), p.length)[0])
            sizes[p.name].append(size)
            at += step[p.length] + step[p.type] * size
    return {name: np.array(size, dtype=np.int64) for name, size in sizes.items()}


def write_elements(ply: Ply) -> bytes:
    """Return a file in ASCII, or in binary, little-endian."""
    header = ["ply", f"format {'ascii' if ply.text else 'binary_little_endian'} 1.0", *ply.comments]
    blocks = []
    for name, element in ply.elements.items():
        header.append(f"element {name} {element.rows}")
        for column, values in element.columns.items():
            if isinstance(values, Lists):
                kind = _NAMES[values.values.dtype.str[1:]]
                header.append(f"property list {_length(values)[0]} {kind} {column}")
            else:
                header.append(f"property {_NAMES[values.dtype.str[1:]]} {column}")
        blocks.append(_pack_text(element) if ply.text else _pack(element))
    return "\n".join([*header, "end_header", ""]).encode("latin-1", "replace") + b"".join(blocks)


def _length(lists: Lists) -> tuple[str, str]:
    return ("uchar", "u1") if lists.sizes.max(initial=0) < 256 else ("int", "i4")


def _pack_text(element: Element) -> bytes:
    """Rows of words, the shortest that are read as the same numbers."""
    # What stands where: the row, the column, the place in a list, the words.
    pieces: list[tuple[Ints, Ints, Ints, Column]] = []
    rows = np.arange(element.rows)
    for k, values in enumerate(element.columns.values()):
        if not isinstance(values, Lists):
            pieces.append((rows, np.full_like(rows, k), 0 * rows, values.astype(np.str_)))
            continue
        inside = np.arange(len(values.values)) - np.repeat(starts_of(values.sizes), values.sizes)
        row = np.repeat(rows, values.sizes)
        pieces.append((rows, np.full_like(rows, k), 0 * rows, values.sizes.astype(np.str_)))
        pieces.append((row, np.full_like(row, k), inside + 1, values.values.astype(np.str_)))
    if not element.rows or not pieces:
        return b""
    row, column, place = (np.concatenate([piece[k] for piece in pieces]) for k in range(3))
    order = np.lexsort((place, column, row))
    words = np.concatenate([piece[3].astype(object) for piece in pieces])[order]
    last = np.append(row[order][1:] != row[order][:-1], True)
    return "".join((words + np.where(last, "\n", " ").astype(object)).tolist()).encode()


def _pack(element: Element) -> bytes:
    # What stands where: the row, the place in it, the values.
    pieces: list[tuple[Ints, Ints, Column]] = []
    rows = np.arange(element.rows)
    lengths = np.zeros(element.rows, dtype=np.int64)
    for values in element.columns.values():
        if not isinstance(values, Lists):
            pieces.append((rows, lengths.copy(), values))
            lengths += values.dtype.itemsize
            continue
        counts = values.sizes.astype(_length(values)[1])
        pieces.append((rows, lengths.copy(), counts))
        lengths += counts.dtype.itemsize
        inside = np.arange(len(values.values)) - np.repeat(starts_of(values.sizes), values.sizes)
        row = np.repeat(rows, values.sizes)
        size = values.values.dtype.itemsize
        pieces.append((row, lengths[row] + size * inside, values.values))
        lengths += size * values.sizes
    starts = starts_of(lengths)
    out = np.empty(int(lengths.sum()), dtype=np.uint8)
    for row, offset, column in pieces:
        raw = np.ascontiguousarray(column).view(np.uint8).reshape(len(column), -1)
        at = starts[row] + offset
        for byte in range(column.dtype.itemsize):
            out[at + byte] = raw[:, byte]
    return out.tobytes()
