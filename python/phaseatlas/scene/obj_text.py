"""The text of OBJ files: its lines, and the corners of its faces.

All of it runs over arrays of bytes, in blocks of lines.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..arrays import Bytes, Floats, Ints
from .mtl import charset

__all__ = [
    "Fields",
    "ObjText",
    "blocks",
    "corner_indices",
    "fields",
    "numbers",
    "read_text",
    "statements",
]

# Bytes a block: arrays of eight times as many are made of each.
_BLOCK = 1 << 22
_NEWLINE, _RETURN, _SLASH, _HASH = (ord(c) for c in "\n\r/#")
# What parts words, by byte, and what does not.
_BLANK = np.isin(np.arange(256), [ord(c) for c in " \t\n\f\r"])
OTHER, FACE, VERTEX, TEXTURE, NORMAL, ELEMENT = range(6)


@dataclass(frozen=True, eq=False)
class ObjText:
    """Lines of a file; one that goes on after a backslash is one line.

    Attributes
    ----------
    data : bytes
        The text in an encoding that contains ASCII.
    prefix : bytes
        What stands before it in the file.
    encoding : str, optional
        Of the file, if it does not contain ASCII.
    starts : (n + 1,) array of int
        Where each line starts; the last is the end of the text.
    charset : str
        Of names and comments: UTF-8, or Latin-1 where they are none.
    kinds : (n,) array of uint8
        FACE, VERTEX, TEXTURE, NORMAL, ELEMENT (points and lines), OTHER.
    continued : (k,) array of int
        Places of the backslashes after which a line goes on.
    """

    data: bytes
    prefix: bytes
    encoding: str | None
    charset: str
    starts: Ints
    kinds: Bytes
    continued: Ints


def read_text(content: bytes) -> ObjText:
    """Find the lines of a file in UTF-8, UTF-16, UTF-32 or an encoding that contains ASCII."""
    data, prefix, encoding = _decoded(content)
    padded = np.frombuffer(data + b"\n   ", dtype=np.uint8)
    continued = np.zeros(0, dtype=np.int64)
    text = padded[: len(data)]
    ends = (text == _NEWLINE) | ((text == _RETURN) & (padded[1 : len(data) + 1] != _NEWLINE))
    places = np.flatnonzero(ends)
    if b"\\" in data:
        continued, gone = _continued(data, places)
        places = np.delete(places, gone)
        padded = padded.copy()
        padded[continued] = ord(" ")
    starts = np.concatenate([[0], places + 1, [len(data)]])
    if len(places) and places[-1] == len(data) - 1:
        starts = starts[:-1]
    first = starts[:-1].copy()
    while True:
        blank = _BLANK[padded[first]] & (padded[first] != _NEWLINE) & (first < starts[1:] - 1)
        if not blank.any():
            break
        first[blank] += 1
    return ObjText(data, prefix, encoding, charset(data), starts, _kinds(padded, first), continued)


def _decoded(content: bytes) -> tuple[bytes, bytes, str | None]:
    # A file that starts with ASCII, as an OBJ does, shows its encoding by its first zeros, exactly
    # as JSON does.
    if content.startswith(b"\xef\xbb\xbf"):
        return content[3:], content[:3], None
    encoding: str = json.detect_encoding(content)
    if encoding == "utf-8":
        return content, b"", None
    prefix = b""
    for bom, exact in (
        (b"\xff\xfe\0\0", "utf-32-le"),
        (b"\0\0\xfe\xff", "utf-32-be"),
        (b"\xff\xfe", "utf-16-le"),
        (b"\xfe\xff", "utf-16-be"),
    ):
        if content.startswith(bom):
            prefix, encoding = bom, exact
            break
    return content[len(prefix) :].decode(encoding, errors="replace").encode(), prefix, encoding


def _continued(data: bytes, places: Ints) -> tuple[Ints, Ints]:
    """Backslashes at ends of lines, outside of comments, and the numbers of these ends."""
    found: list[tuple[int, int]] = []
    place = data.find(b"\\")
    while place >= 0:
        index = int(np.searchsorted(places, place))
        if index < len(places):
            start = int(places[index - 1]) + 1 if index else 0
            rest = data[place + 1 : places[index]]
            if not rest.strip() and b"#" not in data[start:place]:
                found.append((place, index))
        place = data.find(b"\\", place + 1)
    backslashes, ends = np.array(found, dtype=np.int64).reshape(-1, 2).T
    return backslashes, ends


def _kinds(padded: Bytes, first: Ints) -> Bytes:
    a, b, c = (padded[first + k] for k in range(3))
    kinds = np.full(len(first), OTHER, dtype=np.uint8)
    one, two = _BLANK[b], _BLANK[c]
    kinds[(a == ord("f")) & (one | ((b == ord("o")) & two))] = FACE
    kinds[(a == ord("v")) & one] = VERTEX
    kinds[(a == ord("v")) & (b == ord("t")) & two] = TEXTURE
    kinds[(a == ord("v")) & (b == ord("n")) & two] = NORMAL
    kinds[((a == ord("l")) | (a == ord("p"))) & one] = ELEMENT
    return kinds


def statements(text: ObjText, words: tuple[bytes, ...]) -> Iterator[tuple[int, bytes, bytes]]:
    """Lines that start with one of these words: their numbers, the word, and what follows."""
    first = {word[0] for word in words}
    others = np.flatnonzero(text.kinds == OTHER)
    letters = np.frombuffer(text.data + b"\n", dtype=np.uint8)[text.starts[others]]
    candidates = others[np.isin(letters, [*first, 32, 9])]
    for line in candidates.tolist():
        content = text.data[text.starts[line] : text.starts[line + 1]]
        word, _, rest = content.strip().partition(b" ")
        if b"\t" in word:
            word, _, rest = content.strip().partition(b"\t")
        if word in words:
            yield line, word, rest.strip()


def numbers(text: ObjText, kind: int, width: int) -> Floats:
    """Numbers of all lines of a kind, (n, width); NaN where a line has fewer."""
    lines = np.flatnonzero(text.kinds == kind)
    rows = [
        text.data[start:end].partition(b"#")[0].split()[1 : 1 + width]
        for start, end in zip(
            text.starts[lines].tolist(), text.starts[lines + 1].tolist(), strict=True
        )
    ]
    try:
        whole = np.array(rows, dtype=np.bytes_).astype(np.float64)
        if whole.shape == (len(rows), width):
            return whole
    except ValueError:
        pass
    values = np.full((len(rows), width), np.nan)
    for row, words in zip(values, rows, strict=True):
        for k, word in enumerate(words):
            try:
                row[k] = float(word)
            except ValueError:
                break
    return values


@dataclass(frozen=True, eq=False)
class Fields:
    """Corners of lines in a block of the text, as places in the block.

    Attributes
    ----------
    line : (c,) array of int
        Line of each corner.
    start, end : (c,) array of int
        Where it starts and ends.
    first, second : (c,) array of int
        Its slashes; the end where it has none.
    """

    line: Ints
    start: Ints
    end: Ints
    first: Ints
    second: Ints


def blocks(text: ObjText, stop: int = 0) -> Iterator[tuple[int, int]]:
    """Ranges of lines of about a block of bytes each, one of which starts at line `stop`."""
    line, n = 0, len(text.kinds)
    while line < n:
        last = int(np.searchsorted(text.starts, text.starts[line] + _BLOCK, side="right")) - 1
        last = min(max(last, line + 1), n)
        if line < stop < last:
            last = stop
        yield line, last
        line = last


def fields(text: ObjText, begin: int, end: int, kind: int, *, short: bool = False) -> Fields:
    """Find the corners of the faces (three corners or more), or of points and lines, in some lines.

    Parameters
    ----------
    text : ObjText
    begin, end : int
        The lines.
    kind : int
        FACE or ELEMENT.
    short : bool, default False
        Those of faces with fewer corners instead, which enclose nothing.
    """
    origin = int(text.starts[begin])
    block = np.frombuffer(text.data, np.uint8, int(text.starts[end]) - origin, origin)
    lengths = np.diff(text.starts[begin : end + 1])
    inside = np.repeat(text.kinds[begin:end] == kind, lengths)
    word = inside & ~_BLANK[block]
    near = np.searchsorted(text.continued, [origin, origin + len(block)])
    word[text.continued[near[0] : near[1]] - origin] = False
    edges = np.diff(np.concatenate([[False], word, [False]]).astype(np.int8))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    line = np.searchsorted(text.starts[begin : end + 1] - origin, starts, side="right") - 1
    # Two words that meet at the end of a line do not occur: the end is no part of a word.
    keyword = np.concatenate([[True], line[1:] != line[:-1]]) if len(line) else line > 0
    comment = block[starts] == _HASH
    if comment.any():
        first = np.full(end - begin, len(block))
        np.minimum.at(first, line[comment], starts[comment])
        comment = starts >= first[line]
    kept = ~keyword & ~comment
    if kind == FACE:
        counts = np.bincount(line[kept], minlength=end - begin)
        kept &= (counts[line] > 2) != short
    starts, ends, line = starts[kept], ends[kept], line[kept]
    slashes = np.concatenate([np.flatnonzero(block == _SLASH), [len(block), len(block)]])
    at = np.searchsorted(slashes, starts)
    first = np.minimum(slashes[at], ends)
    second = np.minimum(slashes[np.minimum(at + 1, len(slashes) - 1)], ends)
    return Fields(line + begin, starts, ends, first, second)


def corner_indices(text: ObjText) -> tuple[Ints, Ints, Ints]:
    """Lines, texture coordinates and normals of all corners; the latter from 0, -1 for none."""
    counts = [np.cumsum(text.kinds == kind) for kind in (TEXTURE, NORMAL)]
    parts = []
    for begin, end in blocks(text):
        found = fields(text, begin, end, FACE)
        origin = int(text.starts[begin])
        block = np.frombuffer(text.data, np.uint8, int(text.starts[end]) - origin, origin)
        spans = [(found.first + 1, found.second), (found.second + 1, found.end)]
        indices = []
        for (start, stop), count in zip(spans, counts, strict=True):
            value = _integers(block, start, stop)
            total = int(count[-1])
            index = np.where(value < 0, count[found.line] + value, value - 1)
            indices.append(np.where((value == 0) | (index < 0) | (index >= total), -1, index))
        parts.append((found.line, *indices))
    line, texture, normal = (np.concatenate(part) for part in zip(*parts, strict=True))
    return line, texture, normal


def _integers(block: Bytes, start: Ints, stop: Ints) -> Ints:
    """Integers in ranges of bytes; 0 where there is none."""
    length = np.maximum(stop - start, 0)
    padded = np.concatenate([block, np.zeros(1, dtype=np.uint8)])
    value = np.zeros(len(start), dtype=np.int64)
    negative = (length > 0) & (padded[np.minimum(start, len(block))] == ord("-"))
    for k in range(int(length.max(initial=0))):
        at = np.minimum(start + k, len(block))
        digit = padded[at].astype(np.int64) - ord("0")
        use = (k < length) & (digit >= 0) & (digit < 10)
        value = np.where(use, 10 * value + digit, value)
    return np.where(negative, -value, value)
