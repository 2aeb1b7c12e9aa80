"""The page's script: ES modules joined into one file, without a bundler.

Browsers import no modules from ``file://``, so a site that is opened from a stick needs a classic
script. The modules are therefore written so that they can stand one after the other in one scope:
each imports by name from modules before it and exports declarations by name, and no two declare the
same name at the top.
"""

from __future__ import annotations

import re
from functools import cache
from importlib import resources
from typing import Literal

MODULES = (
    "numbers",
    "colour",
    "half",
    "exr",
    "basis",
    "state",
    "tiles",
    "values",
    "environment",
    "tables",
    "pacer",
    "prefilter",
    "shader",
    "renderer",
    "plots",
    "annotations",
    "elements",
    "inspector",
    "controls",
    "saving",
    "geometry",
    "drawing",
    "pointer",
    "viewer",
    "mount",
)
"""In the order in which they may import."""
PAGE = ("host", "start")
"""What stands after them in a page of its own."""
ENTRIES = "mount, pageHost, scriptSource"
"""What other pages need: what shows a painting in an element, where state and files are."""
START = "startPage"
"""What starts the page of a site."""
NOTEBOOK = "notebook"
"""The module that stands after them in a notebook, and what it exports to anywidget."""
RENDER = "renderNotebook"
Form = Literal["classic", "module", "notebook"]
IMPORT = re.compile(r"^import \{[^}]*\} from \"\./(\w+)\.js\";\n", re.MULTILINE)
EXPORT = re.compile(r"^export (?=(?:async )?(?:function|const|class|let)\b)", re.MULTILINE)


COMMENT = re.compile(r"^//.*\n|(?<=[;,{]) +// [^`\"\n]*$", re.MULTILINE)
"""Of a line, or behind the end of a statement, also in the text of a shader."""
INDENTED = re.compile(r"^[ ]+|^\n", re.MULTILINE)


def page_file(name: str) -> str:
    """The text of a file of the page."""
    return (resources.files("impasto.viewer") / "page" / name).read_text(encoding="utf-8")


@cache
def style() -> str:
    """The style of the page, without comments and spaces, which are for its authors."""
    text = re.sub(r"/\*.*?\*/", "", page_file("style.css"), flags=re.DOTALL)
    return re.sub(r"\s*([{};,])\s*|(?<=:) ", r"\1", text).strip()


@cache
def script(form: Form = "classic") -> str:
    """All modules in one script, without comments and indentation, which are for their authors.

    Parameters
    ----------
    form
        ``"classic"``: starts by itself on the page of a site. ``"module"``: an ES module that
        exports ``mount`` and what it needs, for other pages. ``"notebook"``: an ES module with its
        style, whose default export has the ``render`` that anywidget calls.

    Raises
    ------
    ValueError
        A module imports from one after it, or exports otherwise than by name.
    """
    joined = []
    modules = (*MODULES, NOTEBOOK) if form == "notebook" else (*MODULES, *PAGE)
    for number, name in enumerate(modules):
        text = page_file(f"{name}.js")
        later = set(IMPORT.findall(text)) - set(modules[:number])
        if later:
            raise ValueError(f"{name}.js imports {sorted(later)}, which do not stand before it")
        text = EXPORT.sub("", IMPORT.sub("", text))
        if found := re.search(r"^(?:import|export)\b.*$", text, re.MULTILINE):
            raise ValueError(f"{name}.js: {found[0]!r} cannot be joined")
        joined.append(text)
    body = COMMENT.sub("", INDENTED.sub("", "\n".join(joined)))
    if form == "module":
        return f"{body}\nexport {{ {ENTRIES} }};\n"
    if form == "notebook":
        if found := re.search(r"[`\\]|\$\{", style()):
            raise ValueError(f"style.css: {found[0]!r} cannot stand in a template of the script")
        body = f"const STYLE = `{style()}`;\n{body}"
        return f"{body}\nexport default {{ render: {RENDER} }};\n"
    return f"(() => {{\n'use strict';\n{body}\n{START}();\n}})();\n"
