"""Pages to look at: a surface, a segmentation or an atlas as one file of HTML."""

from .page import as_frame, html_of, write_page

__all__ = ["as_frame", "html_of", "write_page"]
