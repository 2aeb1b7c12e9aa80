"""A server for a page on this machine alone, by the standard library.

It listens on the loopback. Another user of the machine, or a page of another site in the same
browser, must reach nothing:

- the address holds a random token, compared in constant time;
- the Host header must be this server's own (DNS rebinding);
- the page may load nothing from elsewhere (Content-Security-Policy);
- names of files never come from a request.
"""

from __future__ import annotations

import json
import secrets
import sys
import threading
from collections.abc import Callable
from contextlib import nullcontext
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from impasto.errors import ArgumentError, ImpastoError

PATIENCE = 30.0
"""Seconds after which a connection that sends nothing is closed."""
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
    allow_reuse_address = True

    def __init__(self, handler: type[LoopbackHandler], port: int = 0) -> None:
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
    timeout = PATIENCE
    policy = POLICY
    one_at_a_time = True
    """Whether what is sent is made for one request after the other."""

    def answer(self, made: Callable[[], tuple[bytes, str]]) -> None:
        """Send data and media type, or why there are none."""
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
        if self.headers.get_all("Host", []) not in [[host] for host in self.hosts()]:
            self.refuse(HTTPStatus.FORBIDDEN, "the Host is not this server's")
            return None
        _, _, rest = self.path.partition("/")
        token, slash, path = rest.partition("?")[0].partition("/")
        own = secrets.compare_digest(token.encode("utf-8", "replace"), self.server.token.encode())
        if not (own and slash):
            self.refuse(HTTPStatus.FORBIDDEN, "open the address that the command printed")
            return None
        return path

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
        """Nothing: the terminal shows what is saved, not each request."""
