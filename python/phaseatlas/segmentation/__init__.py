"""Segments of a surface, and the phase fields that find them."""

from .segmentation import Segmentation

__all__ = ["Segmentation"]
