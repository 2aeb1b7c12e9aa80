"""A server for a page on this machine alone that shows a subject and saves it.

Besides what every page of this machine alone refuses (:mod:`impasto._internal.loopback`), a save
must be JSON from the page's own origin (cross-site requests), of bounded length. What can be
fetched is a table and two numbers.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from http import HTTPStatus
from importlib import resources
from typing import Any, Protocol

from impasto._internal.damage import DAMAGE
from impasto._internal.loopback import LoopbackHandler, LoopbackServer, kind_of

LARGEST = 4 << 20
"""Bytes of a save; a mesh of 6000 nodes, the most that is estimated, takes 0.1 MB."""
PICTURE = re.compile(r"picture/(\d{1,5})")
TILE = re.compile(r"tile/(\d{1,5})/(\d{1,5})/(\d{1,5})")


@dataclass(frozen=True)
class Page:
    """The files of a page, which are parts of a package.

    Attributes
    ----------
    package
        Its dotted name; the files lie in its folder ``page``.
    names
        ``page.html``, which is the page itself, and all that it loads.
    """

    package: str
    names: tuple[str, ...]

    def read(self, address: str) -> tuple[bytes, str] | None:
        """The file at an address, and its type; None: there is none."""
        name = address or "page.html"
        if name not in self.names or address == "page.html":
            return None
        data = (resources.files(self.package) / "page" / name).read_bytes()
        return data, kind_of(name)


class Subject(Protocol):
    """What the page shows and changes."""

    def document(self) -> dict[str, Any]:
        """All that the page shows, as JSON."""

    def picture(self, number: int) -> bytes:
        """A whole photograph, reduced where it is large, as PNG; IndexError: there is none."""

    def tile(self, number: int, column: int, row: int) -> bytes:
        """A part of a photograph, pixel for pixel, as PNG; IndexError: there is none."""

    def save(self, content: dict[str, Any]) -> str:
        """Check and write what the page sends; returns what to tell the user."""


class PageServer(LoopbackServer):
    """Serve the page for one subject.

    Parameters
    ----------
    subject
        What the page shows and changes.
    page
        Its files.
    port
        To listen on; 0: a free one.

    Raises
    ------
    ArgumentError
        A port that is in use or not allowed.
    """

    def __init__(self, subject: Subject, page: Page, port: int = 0) -> None:
        self.subject = subject
        self.page = page
        super().__init__(_Handler, port)


class _Handler(LoopbackHandler):
    server: PageServer

    def do_GET(self) -> None:
        path = self.own_path()
        if path is None:
            return
        if (found_file := self.server.page.read(path)) is not None:
            self.send(HTTPStatus.OK, *found_file)
        elif path == "document.json":
            self.answer(self._document)
        elif found := PICTURE.fullmatch(path):
            number = int(found[1])
            self.answer(lambda: (self.server.subject.picture(number), "image/png"))
        elif found := TILE.fullmatch(path):
            number, column, row = map(int, found.groups())
            self.answer(lambda: (self.server.subject.tile(number, column, row), "image/png"))
        else:
            self.refuse(HTTPStatus.NOT_FOUND, "there is nothing at this address")

    def do_POST(self) -> None:
        # What is not read of a body would be taken for the next request.
        self.close_connection = True
        path = self.own_path()
        if path is None:
            return None
        if path != "save":
            return self.refuse(HTTPStatus.NOT_FOUND, "there is nothing at this address")
        if self.headers.get("Origin") not in {f"http://{host}" for host in self.hosts()}:
            return self.refuse(HTTPStatus.FORBIDDEN, "a save must come from the page itself")
        if self.headers.get_content_type() != "application/json":
            return self.refuse(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "expected application/json")
        length = self.headers.get("Content-Length", "")
        if not re.fullmatch(r"\d{1,12}", length):
            return self.refuse(HTTPStatus.LENGTH_REQUIRED, "expected a Content-Length")
        if int(length) > LARGEST:
            return self.refuse(
                HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"a save may have {LARGEST} bytes at most"
            )
        try:
            content = json.loads(self.rfile.read(int(length)), parse_constant=_no_number)
            if not isinstance(content, dict):
                raise ValueError("expected an object at the top")
        except DAMAGE as error:  # brackets may be nested too deep, and numbers too long
            return self.refuse(HTTPStatus.BAD_REQUEST, f"not valid JSON ({error})")
        return self.answer(lambda: self._saved(content))

    def _document(self) -> tuple[bytes, str]:
        content = json.dumps(self.server.subject.document(), allow_nan=False)
        return content.encode("utf-8"), "application/json"

    def _saved(self, content: dict[str, Any]) -> tuple[bytes, str]:
        said = self.server.subject.save(content)
        return json.dumps({"said": said}).encode("utf-8"), "application/json"


def _no_number(name: str) -> None:
    """NaN and Infinity are no JSON, though Python's reader takes them."""
    raise ValueError(f"{name} is not a number")
