"""Pictures as bytes of a file."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bytes, Floats, Ints

if TYPE_CHECKING:
    from PIL import Image

__all__ = [
    "MOST_16_BIT",
    "Picture",
    "as_png_or_jpeg",
    "eight_bits",
    "grey_values",
    "kind_of",
    "png",
    "read_picture",
    "unreadable",
]

#: Largest value of an image of 16 bits.
MOST_16_BIT = 2**16 - 1
_MOST_32_BIT = 2**31 - 1
_SIGNATURES = {b"\x89PNG": "png", b"\xff\xd8\xff": "jpg", b"RIFF": "webp", b"\xabKTX": "ktx2"}


def unreadable() -> tuple[type[Exception], ...]:
    """What Pillow raises for a picture that it cannot read, or that is too large to be one."""
    from PIL import Image

    return OSError, ValueError, SyntaxError, Image.DecompressionBombError


def png(image: Bytes) -> bytes:
    """Return a PNG file of an image, (h, w, 3) or (h, w, 4), first row on top."""
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(image).save(data, format="png")
    return data.getvalue()


def kind_of(data: bytes) -> str:
    """Suffix of a picture, by its first bytes; empty where they are unknown."""
    return next((kind for start, kind in _SIGNATURES.items() if data.startswith(start)), "")


def as_png_or_jpeg(data: bytes) -> bytes | None:
    """The picture in a format that glTF holds; None where it cannot be read."""
    if kind_of(data) in ("png", "jpg"):
        return data
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data)) as picture:
            out = io.BytesIO()
            eight_bits(picture).convert("RGBA").save(out, format="png")
            return out.getvalue()
    except unreadable():
        return None


def grey_values(picture: Image.Image) -> Floats | None:
    """Values of a grey picture of more than 8 bits, those of integers in [0, 1]; else None."""
    if picture.mode[0] not in "IF":
        return None
    # Pillow's own conversion cuts values off at 255 instead of scaling them.
    grey = np.asarray(picture, dtype=np.float64)
    if picture.mode == "F":
        return grey
    return grey / (MOST_16_BIT if grey.max() <= MOST_16_BIT else _MOST_32_BIT)


def eight_bits(picture: Image.Image) -> Image.Image:
    """The picture with 8 bits a channel; values beyond [0, 1] become the next ones."""
    grey = grey_values(picture)
    if grey is None:
        return picture
    from PIL import Image

    return Image.fromarray(np.rint(255 * np.clip(grey, 0.0, 1.0)).astype(np.uint8))


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture to be looked up.

    Attributes
    ----------
    pixels : (h, w, 4) array of uint8 or float32
        First row on top; floats are values.
    values : (256,) array or None
        Of the first three channels of bytes.
    """

    pixels: NDArray[Any]
    values: Floats | None

    def reduced(self, ratio: float) -> Picture:
        """Return means of squares of pixels, at most `ratio` a side and as many as fit."""
        height, width = self.pixels.shape[:2]
        fitting = [k for k in range(2, int(ratio) + 1) if height % k == 0 and width % k == 0]
        if not fitting:
            return self
        k = fitting[-1]
        small = np.empty((height // k, width // k, 4), dtype=np.float32)
        for row in range(len(small)):
            block = self._decoded(self.pixels[row * k : row * k + k])
            small[row] = block.reshape(k, width // k, k, 4).mean(axis=(0, 2))
        return Picture(small, None)

    def sample(self, places: Floats, wrap: tuple[str, str]) -> Floats:
        """Values between the centres of pixels, bilinear, (k, 4).

        Parameters
        ----------
        places : (k, 2) array
            In [0, 1] over the picture, v down.
        wrap : tuple of str
            What is beyond, for u and v: "repeat", "mirror" or "clamp".
        """
        height, width = self.pixels.shape[:2]
        found = np.zeros((len(places), 4))
        at = places * [width, height] - 0.5
        low = np.floor(at)
        part = at - low
        for dx in (0, 1):
            for dy in (0, 1):
                column = _wrapped(low[:, 0] + dx, width, wrap[0])
                row = _wrapped(low[:, 1] + dy, height, wrap[1])
                weight = (part[:, 0] if dx else 1 - part[:, 0]) * (
                    part[:, 1] if dy else 1 - part[:, 1]
                )
                found += weight[:, None] * self._decoded(self.pixels[row, column])
        return found

    def _decoded(self, pixels: NDArray[Any]) -> Floats:
        if self.values is None:
            return pixels.astype(np.float64)
        decoded: Floats = self.values[pixels]
        decoded[..., 3] = pixels[..., 3] / 255
        return decoded


def _wrapped(index: Floats, count: int, wrap: str) -> Ints:
    """Pixels at whole places that may lie outside."""
    found: Floats
    if wrap == "clamp":
        found = np.clip(index, 0, count - 1)
    elif wrap == "mirror":
        found = np.mod(index, 2 * count)
        found = np.minimum(found, 2 * count - 1 - found)
    else:
        found = np.mod(index, count)
    return found.astype(np.int64)


def read_picture(data: bytes, decode: Callable[[Floats], Floats] | None = None) -> Picture | None:
    """Read a picture; None where that cannot be done.

    Parameters
    ----------
    data : bytes
        Of a PNG, a JPEG or another format that Pillow reads.
    decode : callable, optional
        From bytes as parts of 255 to values.
    """
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data)) as picture:
            grey = grey_values(picture)
            if grey is not None:
                grey = np.clip(grey, 0.0, 1.0)
                grey = decode(grey) if decode else grey
                pixels = np.ones((*grey.shape, 4), dtype=np.float32)
                pixels[..., :3] = grey[..., None]
                return Picture(pixels, None)
            whole = np.asarray(picture.convert("RGBA"))
    except unreadable():
        return None
    steps = np.arange(256) / 255
    return Picture(whole, decode(steps) if decode else steps)
