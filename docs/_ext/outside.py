"""Links of Markdown pages that lead out of docs/, to files that the site has as pages or not."""

from __future__ import annotations

import posixpath

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

# Files above docs/ that the site has, and their pages.
PAGES = {
    "../README.md": "index",
    "../CONTRIBUTING.md": "contributing",
    "../CHANGELOG.md": "changelog",
    "../benches/README.md": "timings",
    "../benches/RESULTS.md": "timings",
    "../benches/NOTES.md": "timings",
    "../examples": "generated/gallery/index",
}


def lead(app: Sphinx, document: nodes.document) -> None:
    """Make links to other pages of what the site has, and text of what it does not have."""
    here = posixpath.dirname(app.env.current_document.docname)
    for node in list(document.findall(addnodes.pending_xref)):
        if node.get("reftype") != "myst":
            continue
        target = node["reftarget"]
        if node.get("refdomain") == "doc":
            if not target.startswith("/"):
                continue
            path = posixpath.relpath(f"{target}.md", app.srcdir.as_posix())
        else:
            path = posixpath.normpath(posixpath.join(here, target))
            if not (app.srcdir / path).exists():
                # Of a page from above that is included here.
                path = f"../{path}"
        if path in PAGES:
            node["refdomain"], node["reftarget"], node["reftargetid"] = "doc", PAGES[path], None
        elif path.startswith("../") and (app.srcdir / path).exists():
            node.replace_self(node.children)


def setup(app: Sphinx) -> dict[str, bool]:
    """Watch the documents as they are read."""
    app.connect("doctree-read", lead)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
