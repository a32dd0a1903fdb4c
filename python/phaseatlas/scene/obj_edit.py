"""New texture coordinates in the text of an OBJ file, which stays as it is otherwise."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..arrays import Bools, Bytes, Floats, Ints
from .obj_text import ELEMENT, FACE, TEXTURE, ObjText, blocks, fields, read_text

__all__ = ["Header", "vt_lines", "with_vt"]

# Decimals of texture coordinates: a texel of 16,384 is 6e-5, and these place a corner to a
# thousandth of it.
_DIGITS = 8


@dataclass(frozen=True)
class Header:
    """Lines that go, and lines without ends that stand before all, or before lines of faces."""

    dropped: tuple[int, ...] = ()
    top: tuple[bytes, ...] = ()
    before: dict[int, bytes] = field(default_factory=dict)


def with_vt(text: ObjText, uv: Floats, header: Header | None = None) -> bytes:
    """Return the file with new texture coordinates of its faces.

    Old `vt` lines go; new ones stand before the first face. Of faces only the index of the texture
    coordinates changes, of points and lines it goes.

    Parameters
    ----------
    text : ObjText
        The file.
    uv : (c, 2) array
        At the corners of all faces with three or more, v up.
    header : Header, optional
        Other changes.
    """
    header = header or Header()
    line_end = _line_end(text)
    lines, index = vt_lines(uv, line_end)
    gone = text.kinds == TEXTURE
    gone[list(header.dropped)] = True
    faces = np.flatnonzero(text.kinds == FACE)
    first_face = int(faces[0]) if len(faces) else len(text.kinds)
    pieces, done = [line + line_end for line in header.top], 0
    for begin, end in blocks(text, first_face):
        if begin == first_face:
            pieces.append(lines)
        piece, count = _rewritten(text, begin, end, index[done:], gone)
        pieces.append(piece)
        done += count
    data = b"".join(pieces)
    if header.before:
        data = _with_lines(data, np.searchsorted(faces, list(header.before)), header, line_end)
    if done != len(uv):
        raise ValueError(f"{done} corners of faces were found in the text, not {len(uv)}")
    if text.encoding is not None:
        data = data.decode("utf-8").encode(text.encoding)
    return text.prefix + data


def _with_lines(data: bytes, ordinals: Ints, header: Header, line_end: bytes) -> bytes:
    """Put lines before some of the lines of faces, which are given by their order."""
    text = read_text(data)
    places = text.starts[np.flatnonzero(text.kinds == FACE)[ordinals]].tolist()
    pieces, done = [], 0
    for place, line in zip(places, header.before.values(), strict=True):
        pieces += [data[done:place], line, line_end]
        done = place
    return b"".join([*pieces, data[done:]])


def _line_end(text: ObjText) -> bytes:
    place = text.data.find(b"\n")
    if place < 0:
        return b"\r" if b"\r" in text.data else b"\n"
    return b"\r\n" if place and text.data[place - 1] == ord("\r") else b"\n"


def _rewritten(
    text: ObjText, begin: int, end: int, index: Ints, without: Bools
) -> tuple[bytes, int]:
    """Some lines with indices from 1 at the corners of their faces, and how many these are."""
    origin = int(text.starts[begin])
    block = np.frombuffer(text.data, np.uint8, int(text.starts[end]) - origin, origin)
    kinds = text.kinds[begin:end]
    faces = fields(text, begin, end, FACE)
    if len(index) < len(faces.start):
        raise ValueError("more corners of faces were found in the text than were read")
    index = index[: len(faces.start)]
    gone = np.zeros(len(block) + 1, dtype=np.int32)
    bounds = text.starts[begin : end + 1] - origin
    old = np.flatnonzero(without[begin:end])
    spans = [(faces.first, faces.second), (bounds[old], bounds[old + 1])]
    if (kinds == ELEMENT).any():
        others = fields(text, begin, end, ELEMENT)
        spans.append((others.first, others.end))
    if len(np.unique(faces.line)) < np.count_nonzero(kinds == FACE):
        others = fields(text, begin, end, FACE, short=True)
        # Both slashes stay before a normal.
        spans.append((others.first + (others.second < others.end), others.second))
    for start, stop in spans:
        gone[start] += 1
        gone[stop] -= 1
    kept = np.flatnonzero(np.cumsum(gone[:-1]) == 0)
    digits = _digits(index)
    width = 1 + np.count_nonzero(digits, axis=1)
    # Bytes that are put in before each place.
    put = np.zeros(len(block) + 1, dtype=np.int64)
    put[faces.first] = width
    put = np.cumsum(put)
    out = np.empty(len(kept) + int(width.sum()), dtype=np.uint8)
    out[put[kept] + np.arange(len(kept))] = block[kept]
    at = np.searchsorted(kept, faces.first) + put[faces.first] - width
    out[at] = ord("/")
    for k in range(digits.shape[1]):
        shown = digits[:, k] > 0
        at = at + shown
        out[at[shown]] = digits[shown, k]
    return out.tobytes(), len(index)


def _digits(values: Ints) -> Bytes:
    """Decimal digits of positive integers as characters, 0 before the first."""
    width = len(str(int(values.max(initial=1))))
    digits = np.empty((len(values), width), dtype=np.uint8)
    rest = values.copy()
    for k in range(width - 1, -1, -1):
        rest, digit = np.divmod(rest, 10)
        digits[:, k] = np.where((rest > 0) | (digit > 0), digit + ord("0"), 0)
    return digits


def vt_lines(uv: Floats, line_end: bytes) -> tuple[bytes, Ints]:
    """Lines of the different coordinates in order of their first use; their numbers at corners."""
    scale = 10**_DIGITS
    whole = np.rint(uv * scale)
    inside = bool(len(uv)) and whole.min() >= 0 and whole.max() <= scale
    if inside:
        key = whole[:, 0].astype(np.int64) << 32 | whole[:, 1].astype(np.int64)
        _, first, place = np.unique(key, return_index=True, return_inverse=True)
    else:
        _, first, place = np.unique(uv, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(1, len(order) + 1)
    first = first[order]
    index: Ints = rank[place.reshape(-1)]
    if not inside:
        rows = [f"vt {u:.{_DIGITS}f} {v:.{_DIGITS}f}".encode() for u, v in uv[first].tolist()]
        return b"".join(row + line_end for row in rows), index
    template = b"vt 0." + b"0" * _DIGITS + b" 0." + b"0" * _DIGITS + line_end
    lines = np.tile(np.frombuffer(template, np.uint8), (len(first), 1))
    for axis, at in ((0, 3), (1, 3 + _DIGITS + 3)):
        rest = whole[first, axis].astype(np.int64)
        for k in range(at + _DIGITS + 1, at + 1, -1):
            rest, digit = np.divmod(rest, 10)
            lines[:, k] = digit + ord("0")
        lines[:, at] = rest + ord("0")
    return lines.tobytes(), index
