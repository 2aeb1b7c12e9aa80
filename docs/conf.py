"""How the documentation is built: `make docs`, offline, warnings are errors."""

import re
import sys
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.ext.napoleon.docstring import GoogleDocstring

import impasto

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "impasto"
author = "the impasto authors"
copyright = author
release = version = impasto.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "myst_parser",
    "sphinxcontrib.bibtex",
    "mathml",
]
exclude_patterns = ["_build", "_generated"]
source_suffix = {".md": "markdown"}
nitpicky = True
# Types are read, not followed: pages build offline and link to no other project's manual.
nitpick_ignore_regex = [("py:class", ".*"), ("py:data", ".*")]

myst_enable_extensions = ["amsmath", "attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
myst_links_external_new_tab = False

bibtex_bibfiles = ["references.bib"]
bibtex_reference_style = "author_year"

html_math_renderer = "mathml"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_type_aliases = {name: name for name in ("ArrayLike", "NDArray", "Light", "Picture")}
autodoc_preserve_defaults = True
autodoc_default_options = {"members": True}
autoclass_content = "class"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_attr_annotations = False
python_use_unqualified_type_names = True
maximum_signature_line_length = 88
add_module_names = False

html_theme = "pydata_sphinx_theme"
html_title = "impasto"
html_static_path = ["_static"]
html_css_files = ["impasto.css"]
html_show_sourcelink = False
html_show_copyright = False
html_show_sphinx = False
html_copy_source = False
html_sidebars = {"**": []}
html_theme_options = {
    "logo": {"text": "impasto"},
    "navbar_end": ["theme-switcher"],
    "navbar_align": "left",
    "header_links_before_dropdown": 9,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": [],
    "footer_end": [],
    "show_prev_next": False,
    "pygments_light_style": "friendly",
    "pygments_dark_style": "a11y-dark",
}


def plain_names(*event: Any) -> tuple[str | None, str | None]:
    """Signatures with the names that the code uses for its types, not with what they stand for."""
    *_, signature, result = event

    def plain(text: str | None) -> str | None:
        return text and re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", text)

    return plain(signature), plain(result)


def whole_sentence(docstring: GoogleDocstring) -> list[str]:
    """What stands under an attribute is a sentence; napoleon would split it at its colon."""
    return docstring._dedent(docstring._consume_to_end())


GoogleDocstring._parse_attribute_docstring = whole_sentence


def linked_citations(*event: Any) -> None:
    """``[@key]`` of docstrings is a citation of the bibliography."""
    *_, lines = event
    lines[:] = [re.sub(r"\[@([\w-]+)\]", r":cite:p:`\1`", line) for line in lines]


def setup(app: Sphinx) -> None:
    app.connect("autodoc-process-signature", plain_names)
    app.connect("autodoc-process-docstring", linked_citations)
