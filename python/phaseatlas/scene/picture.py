"""Pictures as bytes of a file."""

from __future__ import annotations

import io

from ..arrays import Bytes

__all__ = ["as_png_or_jpeg", "kind_of", "png"]

_SIGNATURES = {b"\x89PNG": "png", b"\xff\xd8\xff": "jpg", b"RIFF": "webp", b"\xabKTX": "ktx2"}


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
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(io.BytesIO(data)) as picture:
            out = io.BytesIO()
            picture.convert("RGBA").save(out, format="png")
            return out.getvalue()
    except (OSError, UnidentifiedImageError, ValueError):
        return None
