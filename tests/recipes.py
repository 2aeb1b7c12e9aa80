"""Runs the recipes of docs/how-to.md: Python as Sybil finds it, and every line of a console.

Blocks of MyST's ``{code-block}`` are not run: what they need (a browser, Blender, a compiler, time)
is not everywhere. Their lines of ``impasto`` are parsed, so that no option is there that is not.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

from sybil import Document, Example, Sybil
from sybil.parsers.markdown import CodeBlockParser, PythonCodeBlockParser

from impasto.cli import main

PAGE = Path(__file__).resolve().parents[1] / "docs" / "how-to.md"
DEMO = "impasto demo --out demo --size "
"""The command that makes the painting of the page, before its size."""


def commands(text: str) -> Iterator[list[str]]:
    """The words of each line after a prompt; a backslash goes on."""
    for line in text.replace("\\\n", " ").splitlines():
        if line.startswith("$ "):
            yield shlex.split(line[2:], comments=True)


def shown(text: str) -> list[str]:
    """The consoles of a page that are shown and not run."""
    return re.findall(r"^```\{code-block\} console\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def run(size: int | None = None) -> Document:
    """Run all recipes in the working directory; ``size`` replaces that of the page's painting.

    Returns
    -------
    Document
        With the names that the recipes defined in its ``namespace``.
    """

    def console(example: Example) -> None:
        for words in commands(str(example.parsed)):
            program, *rest = words
            assert program == "impasto", words
            if size is not None and " ".join(words).startswith(DEMO):
                rest[rest.index("--size") + 1] = str(size)
            code = main(rest)
            assert code == 0, f"{shlex.join(words)}: exit code {code}"

    parsers = [PythonCodeBlockParser(), CodeBlockParser("console", console)]
    document = Sybil(parsers=parsers).parse(PAGE)
    for example in document.examples():
        example.evaluate()
    return document
