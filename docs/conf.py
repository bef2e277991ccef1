"""How Sphinx builds the documentation: ``make docs``. Nothing is fetched from the network."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from sphinx.application import Sphinx

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import generate  # noqa: E402

from rotorid import __version__  # noqa: E402

project = "rotorid"
author = "The rotorid developers"
copyright = "the rotorid developers"
release = version = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
    "running",
]
exclude_patterns = ["_build", "**/README.md", "gallery/*.ipynb", "gallery/*.py", "gallery/*.json"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
suppress_warnings = ["config.cache"]
highlight_language = "none"  # equations and what a terminal shows stand as they are

myst_heading_anchors = 4
myst_enable_extensions = ["attrs_inline", "colon_fence", "deflist"]

autodoc_typehints = "none"  # the docstrings say types, shapes and units
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False

sphinx_gallery_conf = {
    "examples_dirs": str(HERE.parent / "examples" / "gallery"),
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 0,
    "write_computation_times": False,
    "within_subsection_order": "FileNameSortKey",
    "capture_repr": (),
    "remove_config_comments": True,
    "nested_sections": False,
    "copyfile_regex": "",
    "plot_gallery": "True",
}

html_theme = "furo"
html_title = "rotorid"
html_show_sourcelink = False
html_copy_source = False
html_static_path = ["_static"]
html_css_files = ["page.css"]


def link_names(app: object, page: str, source: list[str]) -> None:
    """Make each name of the reference a link to all that its docstring says."""
    if page == "reference":
        source[0] = re.sub(r"`rid\.(\w+)`", r"{py:obj}`rid.\1 <rotorid.\1>`", source[0])


def setup(app: Sphinx) -> None:
    """Write the pages that follow from the program itself."""
    generate.write_pages(HERE / "generated")
    app.connect("source-read", link_names)
