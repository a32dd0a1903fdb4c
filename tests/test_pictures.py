"""Pictures of files that are converted, or cannot be read."""

import io
import struct
import zlib

import numpy as np
from PIL import Image

from phaseatlas.page.subject import Picture
from phaseatlas.scene.picture import as_png_or_jpeg, read_picture

RAMP = np.tile(np.arange(0, 65536, 1024, dtype=np.uint16), (64, 1))


def file_of(pixels, kind):
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, format=kind)
    return file.getvalue()


def huge(kind):
    """A file that says it has 20000 pixels a side, more than Pillow takes."""
    data = file_of(RAMP.astype(np.uint8), kind)
    if kind == "bmp":
        return data[:18] + struct.pack("<ii", 20000, 20000) + data[26:]
    head = b"IHDR" + struct.pack(">II", 20000, 20000) + data[24:29]
    return data[:12] + head + struct.pack(">I", zlib.crc32(head)) + data[33:]


def test_sixteen_bits_are_scaled_and_not_cut_off():
    expected = RAMP[..., None] / 257
    page = np.asarray(Image.open(io.BytesIO(Picture.read(file_of(RAMP, "png")).data)))
    # A JPEG is about that.
    assert np.abs(page - expected).max() < 4
    converted = np.asarray(Image.open(io.BytesIO(as_png_or_jpeg(file_of(RAMP, "tiff")))))
    assert np.abs(converted[..., :3] - expected).max() <= 0.5
    looked_up = read_picture(file_of(RAMP, "png")).pixels
    np.testing.assert_allclose(looked_up[..., :3], np.repeat(expected, 3, axis=2) / 255, atol=1e-7)


def test_what_is_too_large_to_be_read_is_none():
    assert Picture.read(huge("png")).data is None
    assert as_png_or_jpeg(huge("bmp")) is None
    assert read_picture(huge("png")) is None
