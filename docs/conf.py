"""How the site is made: ``sphinx-build -W --keep-going docs site``, without any network.

``PHASEATLAS_GALLERY`` names a folder of pictures and numbers that ``examples/run_all.py`` has
written, to show instead of those that are kept in ``docs/gallery``.
"""

import sys
from pathlib import Path

import numpydoc.xref

import phaseatlas

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "phaseatlas"
author = "The phaseatlas developers"
project_copyright = author
version = release = phaseatlas.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_gallery.gen_gallery",
    "numpydoc",
    "myst_parser",
    "sphinxcontrib.mermaid",
    # Of our own, in _ext.
    "written",
    "kept",
    "outside",
    "mathml",
]
exclude_patterns = ["gallery", "tutorials/*.rst", "_ext", "_templates"]
templates_path = ["_templates"]
# `name` in a docstring is a link where there is such a name.
default_role = "py:obj"

html_theme = "furo"
html_title = f"phaseatlas {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_math_renderer = "mathml"

# Markdown: $math$, ::: fences, anchors of headings, diagrams.
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
myst_fence_as_directive = ["mermaid"]
mermaid_fullscreen = False
# Readers of the decisions link to headings whose level jumps; included pages begin at any level.
suppress_warnings = ["myst.header"]

# The reference: docstrings say the types, so that signatures need none.
# Written before this is read, but not yet in the list of pages then.
autosummary_generate = ["generated/reference.rst"]
# Some file systems do not tell partition from Partition.
autosummary_filename_map = {"phaseatlas.partition": "phaseatlas.partition_function"}
autosummary_ignore_module_all = False
autodoc_typehints = "none"
autodoc_member_order = "bysource"
add_module_names = False
numpydoc_show_class_members = False
# Types of arguments are links where they are names of the package. numpydoc's own lead to the
# glossaries of NumPy and Python, which are elsewhere.
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"
numpydoc.xref.DEFAULT_LINKS.clear()
numpydoc_xref_aliases = {name: f"phaseatlas.{name}" for name in phaseatlas.__all__}

# Tutorials run with each build. The scripts of the gallery take minutes: their pages show the
# pictures and the numbers of the last run.
sphinx_gallery_conf = {
    "examples_dirs": ["tutorials", "../examples"],
    "gallery_dirs": ["generated/tutorials", "generated/gallery"],
    "filename_pattern": r"/tutorials/plot_",
    "ignore_pattern": r"(^|/)(?!plot_)[^/]*\.py$",
    "within_subsection_order": "FileNameSortKey",
    "write_computation_times": False,
    "show_signature": False,
    "download_all_examples": False,
    "min_reported_time": 1e9,
    "remove_config_comments": True,
    # What a script prints is shown; the value of its last line is not.
    "capture_repr": (),
}
