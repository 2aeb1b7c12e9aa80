"""A server for one page on this machine alone, by the standard library.

It listens on the loopback. Another user of the machine, or a page of another site in the same
browser, must neither read photographs nor write the file:

- the address holds a random token, compared in constant time;
- the Host header must be this server's own (DNS rebinding);
- a save must be JSON from the page's own origin (cross-site requests), of bounded length;
- names of files never come from a request: what can be fetched is a table and two numbers;
- the page may load nothing from elsewhere (Content-Security-Policy).
"""

from __future__ import annotations

import json
import re
import secrets
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any, Protocol

from impasto._internal.damage import DAMAGE
from impasto.errors import ArgumentError, ImpastoError

LARGEST = 4 << 20
"""Bytes of a save; a mesh of 6000 nodes, the most that is estimated, takes 0.1 MB."""
PATIENCE = 30.0
"""Seconds after which a connection that sends nothing is closed."""
LOOPBACK = "127.0.0.1"
KINDS = {"html": "text/html", "css": "text/css", "js": "text/javascript"}
PICTURE = re.compile(r"picture/(\d{1,5})")
TILE = re.compile(r"tile/(\d{1,5})/(\d{1,5})/(\d{1,5})")
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


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
        return data, f"{KINDS[name.rpartition('.')[2]]}; charset=utf-8"


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


class PageServer(ThreadingHTTPServer):
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

    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, subject: Subject, page: Page, port: int = 0) -> None:
        self.subject = subject
        self.page = page
        self.token = secrets.token_urlsafe(24)
        self.busy = threading.Lock()
        try:
            super().__init__((LOOPBACK, port), _Handler)
        except (OSError, OverflowError) as error:
            raise ArgumentError(
                f"port: cannot listen on {port} ({error}); leave it out for a free one"
            ) from error

    @property
    def url(self) -> str:
        """The address of the page."""
        return f"http://{LOOPBACK}:{self.server_port}/{self.token}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Nothing where a browser went away in the middle of a request."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)

    def run(self, ready: Callable[[str], None]) -> None:
        """Call ``ready`` with the address, and serve until Ctrl-C."""
        try:
            ready(self.url)
            self.serve_forever()
        except KeyboardInterrupt:
            pass
        finally:
            self.server_close()


class _Handler(BaseHTTPRequestHandler):
    server: PageServer
    protocol_version = "HTTP/1.1"
    server_version = "impasto"
    sys_version = ""
    timeout = PATIENCE

    def do_GET(self) -> None:
        path = self._own_path()
        if path is None:
            return
        if (found_file := self.server.page.read(path)) is not None:
            self._send(HTTPStatus.OK, *found_file)
        elif path == "document.json":
            self._answer(self._document)
        elif found := PICTURE.fullmatch(path):
            number = int(found[1])
            self._answer(lambda: (self.server.subject.picture(number), "image/png"))
        elif found := TILE.fullmatch(path):
            number, column, row = map(int, found.groups())
            self._answer(lambda: (self.server.subject.tile(number, column, row), "image/png"))
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "there is nothing at this address")

    def do_POST(self) -> None:
        # What is not read of a body would be taken for the next request.
        self.close_connection = True
        path = self._own_path()
        if path is None:
            return None
        if path != "save":
            return self._refuse(HTTPStatus.NOT_FOUND, "there is nothing at this address")
        if self.headers.get("Origin") not in {f"http://{host}" for host in self._hosts()}:
            return self._refuse(HTTPStatus.FORBIDDEN, "a save must come from the page itself")
        if self.headers.get_content_type() != "application/json":
            return self._refuse(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "expected application/json")
        length = self.headers.get("Content-Length", "")
        if not re.fullmatch(r"\d{1,12}", length):
            return self._refuse(HTTPStatus.LENGTH_REQUIRED, "expected a Content-Length")
        if int(length) > LARGEST:
            return self._refuse(
                HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"a save may have {LARGEST} bytes at most"
            )
        try:
            content = json.loads(self.rfile.read(int(length)), parse_constant=_no_number)
            if not isinstance(content, dict):
                raise ValueError("expected an object at the top")
        except DAMAGE as error:  # brackets may be nested too deep, and numbers too long
            return self._refuse(HTTPStatus.BAD_REQUEST, f"not valid JSON ({error})")
        return self._answer(lambda: self._saved(content))

    def _document(self) -> tuple[bytes, str]:
        content = json.dumps(self.server.subject.document(), allow_nan=False)
        return content.encode("utf-8"), "application/json"

    def _saved(self, content: dict[str, Any]) -> tuple[bytes, str]:
        said = self.server.subject.save(content)
        return json.dumps({"said": said}).encode("utf-8"), "application/json"

    def _answer(self, made: Callable[[], tuple[bytes, str]]) -> None:
        """Send what a subject makes, or why it cannot; one request at a time."""
        try:
            with self.server.busy:
                data, kind = made()
        except IndexError:
            self._refuse(HTTPStatus.NOT_FOUND, "there is nothing at this address")
        except ImpastoError as error:
            self._refuse(HTTPStatus.UNPROCESSABLE_ENTITY, str(error))
        except OSError as error:
            words = error.strerror or str(error)
            where = "" if error.filename is None else f"{error.filename}: "
            self._refuse(HTTPStatus.INTERNAL_SERVER_ERROR, f"{where}{words}")
        except Exception as error:  # the page says what the command line would
            words = f"{type(error).__name__}: {error}"
            self._refuse(
                HTTPStatus.INTERNAL_SERVER_ERROR, f"a defect in impasto, please report it: {words}"
            )
        else:
            self._send(HTTPStatus.OK, data, kind)

    def _hosts(self) -> tuple[str, str]:
        port = self.server.server_port
        return f"{LOOPBACK}:{port}", f"localhost:{port}"

    def _own_path(self) -> str | None:
        """What lies behind the token; None where the request was refused."""
        if self.headers.get_all("Host", []) not in [[host] for host in self._hosts()]:
            self._refuse(HTTPStatus.FORBIDDEN, "the Host is not this server's")
            return None
        _, _, rest = self.path.partition("/")
        token, slash, path = rest.partition("?")[0].partition("/")
        own = secrets.compare_digest(token.encode("utf-8", "replace"), self.server.token.encode())
        if not (own and slash):
            self._refuse(HTTPStatus.FORBIDDEN, "open the address that the command printed")
            return None
        return path

    def _refuse(self, status: HTTPStatus, words: str) -> None:
        self._send(status, json.dumps({"error": words}).encode("utf-8"), "application/json")

    def _send(self, status: HTTPStatus, data: bytes, kind: str) -> None:
        try:
            self.send_response(status)
            for name, value in (
                ("Content-Type", kind),
                ("Content-Length", str(len(data))),
                ("Cache-Control", "no-store"),
                ("Content-Security-Policy", POLICY),
                ("Cross-Origin-Resource-Policy", "same-origin"),
                ("Referrer-Policy", "same-origin"),
                ("X-Content-Type-Options", "nosniff"),
            ):
                self.send_header(name, value)
            if self.close_connection:
                self.send_header("Connection", "close")
            self.end_headers()
            self.wfile.write(data)
        except OSError:  # the browser has gone
            self.close_connection = True

    def log_message(self, format: str, *arguments: Any) -> None:
        """Nothing: the terminal shows what is saved, not each picture."""


def _no_number(name: str) -> None:
    """NaN and Infinity are no JSON, though Python's reader takes them."""
    raise ValueError(f"{name} is not a number")
