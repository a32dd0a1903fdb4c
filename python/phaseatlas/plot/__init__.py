"""Pictures of segmented and textured surfaces, drawn without a display or a GPU."""

from .colours import palette, scalar_colors, segment_colors
from .figures import segments, textured, uv_layout
from .render import render, render_textured

__all__ = [
    "palette",
    "render",
    "render_textured",
    "scalar_colors",
    "segment_colors",
    "segments",
    "textured",
    "uv_layout",
]
