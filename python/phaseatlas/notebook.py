"""What notebooks show of a value."""

from __future__ import annotations

__all__ = ["Pictured"]


class Pictured:
    """A value that notebooks show as a page, where it is not too large; see `page.as_frame`."""

    def _repr_html_(self) -> str | None:
        # A page is made of what this is a part of.
        from .page import as_frame

        return as_frame(self)
