"""A server for a page on this machine alone, by the standard library.

It listens on the loopback. Another user of the machine, or a page of another site in the same
browser, must reach nothing:

- the address holds a random token, compared in constant time, which no browser passes on
  (Referrer-Policy);
- the Host header must be this server's own (DNS rebinding), and so must an Origin;
- the page may load nothing from elsewhere (Content-Security-Policy);
- names of files never come from a request;
- headers are bounded, and so are the number of connections and their time
  (:mod:`impasto._internal.connections`).
"""

from __future__ import annotations

import json
import os
import secrets
import sys
import threading
from collections.abc import Callable
from contextlib import nullcontext
from http import HTTPStatus
from http.client import LineTooLong
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import IO, Any

from impasto._internal.connections import IDLE, Connections
from impasto.errors import ArgumentError, ImpastoError

MOST_HEADERS = 32 << 10
"""Bytes of a request before its body."""
LOOPBACK = "127.0.0.1"
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


KINDS = {"html": "text/html", "css": "text/css", "js": "text/javascript"}


def kind_of(name: str) -> str:
    """The media type of a page's own file, by the end of its name."""
    return f"{KINDS[name.rpartition('.')[2]]}; charset=utf-8"


class LoopbackServer(ThreadingHTTPServer):
    """Serve a page to this machine.

    Parameters
    ----------
    handler
        What answers requests.
    port
        To listen on; 0: a free one.

    Raises
    ------
    ArgumentError
        A port that is in use or not allowed.
    """

    daemon_threads = True
    # Elsewhere it would let another program listen on the same port.
    allow_reuse_address = os.name == "posix"
    # Where it is full the next one waits for a second, also that of the page.
    request_queue_size = 1024

    def __init__(self, handler: type[LoopbackHandler], port: int = 0) -> None:
        self.connections = Connections()
        self.token = secrets.token_urlsafe(24)
        self.busy = threading.Lock()
        try:
            super().__init__((LOOPBACK, port), handler)
        except (OSError, OverflowError) as error:
            raise ArgumentError(
                f"port: cannot listen on {port} ({error}); leave it out for a free one"
            ) from error

    @property
    def url(self) -> str:
        """The address of the page."""
        return f"http://{LOOPBACK}:{self.server_port}/{self.token}/"

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer a connection in a thread of its own, if there is room for it."""
        if self.connections.admit(request):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def shutdown_request(self, request: Any) -> None:
        """Close a connection."""
        self.connections.gone(request)
        super().shutdown_request(request)

    def service_actions(self) -> None:
        """End connections whose time is over, every half second."""
        self.connections.end_late()

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


class LoopbackHandler(BaseHTTPRequestHandler):
    """Refuses requests that are not the page's own; subclasses answer the others."""

    server: LoopbackServer
    protocol_version = "HTTP/1.1"
    server_version = "impasto"
    sys_version = ""
    timeout = IDLE
    policy = POLICY
    one_at_a_time = True
    """Whether what is sent is made for one request after the other."""

    def setup(self) -> None:
        """Bound what is read."""
        super().setup()
        self.rfile: Any = _Bounded(self.rfile)

    def handle_one_request(self) -> None:
        """Answer one request of a connection."""
        self.rfile.left = MOST_HEADERS
        self.server.connections.waiting(self.connection, IDLE)
        try:
            super().handle_one_request()
        except LineTooLong:
            # Of the first line: nothing is known of the request.
            self.command = self.requestline = ""
            self.send_error(HTTPStatus.REQUEST_URI_TOO_LONG)

    def answer(self, made: Callable[[], tuple[bytes, str]]) -> None:
        """Send data and media type, or why there are none."""
        self.server.connections.waiting(self.connection, None)
        try:
            with self.server.busy if self.one_at_a_time else nullcontext():
                data, kind = made()
        except IndexError:
            self.refuse(HTTPStatus.NOT_FOUND, "there is nothing at this address")
        except ImpastoError as error:
            self.refuse(HTTPStatus.UNPROCESSABLE_ENTITY, str(error))
        except OSError as error:
            words = error.strerror or str(error)
            where = "" if error.filename is None else f"{error.filename}: "
            self.refuse(HTTPStatus.INTERNAL_SERVER_ERROR, f"{where}{words}")
        except Exception as error:  # the page says what the command line would
            words = f"{type(error).__name__}: {error}"
            self.refuse(
                HTTPStatus.INTERNAL_SERVER_ERROR, f"a defect in impasto, please report it: {words}"
            )
        else:
            self.send(HTTPStatus.OK, data, kind)

    def hosts(self) -> tuple[str, str]:
        """The names of this server, as a Host header gives them."""
        port = self.server.server_port
        return f"{LOOPBACK}:{port}", f"localhost:{port}"

    def own_path(self) -> str | None:
        """What lies behind the token; None where the request was refused."""
        _, _, rest = self.path.partition("/")
        token, slash, path = rest.partition("?")[0].partition("/")
        own = secrets.compare_digest(token.encode("utf-8", "replace"), self.server.token.encode())
        forbidden, words = HTTPStatus.FORBIDDEN, ""
        if self.headers.get_all("Host", []) not in [[host] for host in self.hosts()]:
            words = "the Host is not this server's"
        elif self._from_another_site():
            words = "the page of another site may not ask"
        elif not (own and slash):
            words = "open the address that the command printed"
        elif self.request_version == "HTTP/0.9":
            # Its answers have no headers, so no policy.
            forbidden, words = HTTPStatus.HTTP_VERSION_NOT_SUPPORTED, "HTTP/0.9 is not spoken"
        elif self.command == "GET" and self._has_body():
            # It would be taken for the next request.
            forbidden, words = HTTPStatus.BAD_REQUEST, "a GET has no body"
        elif not self.server.connections.known(self.connection):
            forbidden, words = HTTPStatus.SERVICE_UNAVAILABLE, "too many connections are open"
        if words:
            self._stranger(forbidden, words)
            return None
        return path

    def _from_another_site(self) -> bool:
        """Whether a browser says so; to follow a link or to type an address is no such thing."""
        if not set(self.headers.get_all("Origin", [])) <= {f"http://{one}" for one in self.hosts()}:
            return True
        site, mode = (self.headers.get(f"Sec-Fetch-{name}") for name in ("Site", "Mode"))
        return site in {"cross-site", "same-site"} and mode != "navigate"

    def _has_body(self) -> bool:
        return self.headers.get("Content-Length", "0") != "0" or "Transfer-Encoding" in self.headers

    def _stranger(self, status: HTTPStatus, words: str) -> None:
        """Refuse, and close the connection."""
        self.close_connection = True
        # An answer always has headers, whatever version was asked for.
        self.request_version = self.protocol_version
        self.refuse(status, words)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """What the library refuses, with the headers of all answers: methods, too long, no HTTP."""
        status = HTTPStatus(code)
        if status is HTTPStatus.NOT_IMPLEMENTED:
            status = HTTPStatus.METHOD_NOT_ALLOWED
        self._stranger(status, status.phrase)

    def refuse(self, status: HTTPStatus, words: str) -> None:
        """Answer with a reason."""
        self.send(status, json.dumps({"error": words}).encode("utf-8"), "application/json")

    def send(self, status: HTTPStatus, data: bytes, kind: str) -> None:
        """Answer with data."""
        try:
            self.send_response(status)
            for name, value in (
                ("Content-Type", kind),
                ("Content-Length", str(len(data))),
                ("Cache-Control", "no-store"),
                ("Content-Security-Policy", self.policy),
                ("Cross-Origin-Opener-Policy", "same-origin"),
                ("Cross-Origin-Resource-Policy", "same-origin"),
                ("Referrer-Policy", "no-referrer"),
                ("X-Content-Type-Options", "nosniff"),
            ):
                self.send_header(name, value)
            if self.close_connection:
                self.send_header("Connection", "close")
            self.end_headers()
            if self.command != "HEAD":
                self.wfile.write(data)
        except OSError:  # the browser has gone
            self.close_connection = True

    def log_message(self, format: str, *arguments: Any) -> None:
        """Nothing: the terminal shows what is saved, not each request."""


class _Bounded:
    """What a connection sends; of the lines of one request no more than so many bytes.

    Attributes
    ----------
    left
        Bytes that the lines of this request may still have.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self.left = 0

    def readline(self, size: int = -1) -> bytes:
        """One line.

        Raises
        ------
        LineTooLong
            It would be more than is left.
        """
        most = self.left + 1 if size < 0 else min(size, self.left + 1)
        line = self._file.readline(most)
        self.left -= len(line)
        if self.left < 0:
            raise LineTooLong("header line")
        return line

    def read(self, size: int = -1) -> bytes:
        """A body, whose length was checked."""
        return self._file.read(size)

    def close(self) -> None:
        """Close it."""
        self._file.close()

    @property
    def closed(self) -> bool:
        """Whether it is closed."""
        return self._file.closed
