"""Servers on the loopback refuse what is not the page's own, however it is asked."""

from __future__ import annotations

import http.client
import resource
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import chromium
from impasto._internal import connections
from impasto._internal.connections import MOST_KNOWN, MOST_STRANGERS
from impasto._internal.loopback import MOST_HEADERS, LoopbackHandler, LoopbackServer
from impasto.cli.console import Stages
from impasto.cli.serving import serve
from impasto.local_page import PageServer
from loopback import request, serving

PATIENT = 20.0
"""Seconds after which a test gives up on a machine that does other things."""


class _Handler(LoopbackHandler):
    def do_GET(self) -> None:
        if (path := self.own_path()) is not None:
            self.answer(lambda: (f"<p>{path}</p>".encode(), "text/html"))


@pytest.fixture
def page() -> Iterator[LoopbackServer]:
    with serving(LoopbackServer(_Handler)) as server:
        yield server


def connected(server: LoopbackServer) -> socket.socket:
    return socket.create_connection(("127.0.0.1", server.server_port), PATIENT)


def raw(server: LoopbackServer, sent: bytes) -> bytes:
    """Whatever comes back until the server closes the connection."""
    with connected(server) as one:
        found = b""
        try:
            one.sendall(sent)
            while more := one.recv(1 << 16):
                found += more
        except ConnectionError:
            pass  # it was closed while more was sent
        return found


def status(answer: bytes) -> int:
    return int(answer.split()[1])


def own(server: LoopbackServer, *headers: str, path: str = "", method: str = "GET") -> bytes:
    """A request with the token and the Host of the server."""
    lines = [
        f"{method} /{server.token}/{path} HTTP/1.1", f"Host: 127.0.0.1:{server.server_port}",
        *headers,
    ]  # fmt: skip
    return ("\r\n".join(lines) + "\r\n\r\n").encode()


@pytest.mark.parametrize("method", ["HEAD", "POST", "PUT", "DELETE", "OPTIONS", "TRACE", "PATCH",
                                    "CONNECT", "PROPFIND", "get", "X" * 300])  # fmt: skip
def test_only_get_is_answered(page: LoopbackServer, method: str) -> None:
    """And nothing that names the server, the token or a header that was sent comes back."""
    answer = raw(page, own(page, "X-Own: a secret", "Content-Length: 0", method=method))
    assert status(answer) == 405
    head, _, body = answer.partition(b"\r\n\r\n")
    assert b"a secret" not in answer
    assert page.token.encode() not in answer
    assert b"default-src 'none'" in head
    assert (body == b"") == (method == "HEAD")


@pytest.mark.parametrize(
    "line",
    ["GET /{token}/ HTTP/9.9", "GET /{token}/ FTP/1.1", "GET", "GET /{token}/ HTTP/1.1 x", "\0\1\2",
     "GET /{token}/", "GET http://evil.example/{token}/ HTTP/1.1",
     "GET /%2e%2e/{token}/ HTTP/1.1", "GET /../{token}/ HTTP/1.1", "GET \\{token}\\ HTTP/1.1"],
)  # fmt: skip
def test_requests_that_are_none_are_refused(page: LoopbackServer, line: str) -> None:
    host = f"\r\nHost: 127.0.0.1:{page.server_port}\r\nConnection: close\r\n\r\n"
    answer = raw(page, (line.format(token=page.token) + host).encode())
    assert status(answer) in {400, 403, 505}


@pytest.mark.parametrize(
    "headers",
    [("Origin: http://evil.example",), ("Origin: null",), ("Origin: http://127.0.0.1:1",),
     ("Origin: https://127.0.0.1:{port}",), ("Host: evil.example",),
     ("Origin: http://127.0.0.1:{port}", "Origin: http://evil.example"),
     ("Sec-Fetch-Site: cross-site", "Sec-Fetch-Mode: no-cors"),
     ("Sec-Fetch-Site: same-site", "Sec-Fetch-Mode: cors"),
     ("Sec-Fetch-Site: cross-site", "Sec-Fetch-Mode: websocket", "Upgrade: websocket")],
)  # fmt: skip
def test_other_sites_are_refused(page: LoopbackServer, headers: tuple[str, ...]) -> None:
    answer = raw(page, own(page, *(one.format(port=page.server_port) for one in headers)))
    assert status(answer) == 403


def test_its_own_page_is_not(page: LoopbackServer) -> None:
    """A script of it, and the user who follows the link in a terminal or a page of notes."""
    for headers in (
        (f"Origin: http://127.0.0.1:{page.server_port}", "Sec-Fetch-Site: same-origin"),
        ("Sec-Fetch-Site: none", "Sec-Fetch-Mode: navigate"),
        ("Sec-Fetch-Site: cross-site", "Sec-Fetch-Mode: navigate"),
    ):
        assert status(raw(page, own(page, *headers, "Connection: close"))) == 200


def test_a_websocket_is_refused(page: LoopbackServer) -> None:
    upgrade = ("Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13",
               "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==")  # fmt: skip
    text = own(page, *upgrade).decode().replace(page.token, "x" * 32)
    assert status(raw(page, text.encode())) == 403
    # With the token it is an answer like any other: no connection is upgraded.
    with connected(page) as one:
        one.sendall(own(page, *upgrade, f"Origin: http://127.0.0.1:{page.server_port}"))
        assert status(one.recv(1 << 16)) == 200


@pytest.mark.parametrize(
    "body", [("Content-Length: 40",), ("Transfer-Encoding: chunked",), ("Content-Length: x",)]
)
def test_no_second_request_hides_in_the_first(page: LoopbackServer, body: tuple[str, ...]) -> None:
    """One answer, then the connection is closed."""
    answer = raw(page, own(page, *body) + own(page, path="hidden"))
    assert status(answer) == 400
    assert answer.count(b"HTTP/1.1") == 1


@pytest.mark.parametrize(
    ("sent", "code"),
    [
        (b"GET /" + b"x" * (2 * MOST_HEADERS), 414),
        (b"GET / HTTP/1.1\r\nX: " + b"x" * (2 * MOST_HEADERS), 431),
        (b"GET / HTTP/1.1\r\n" + b"X: 1\r\n" * MOST_HEADERS, 431),
        (b"GET / HTTP/1.1\r\n" + b"".join(b"X%d: 1\r\n" % i for i in range(101)) + b"\r\n", 431),
    ],
)
def test_huge_headers_are_refused(page: LoopbackServer, sent: bytes, code: int) -> None:
    """With what was not read still on its way the answer may be lost, never more."""
    answer = raw(page, sent)
    assert answer == b"" or status(answer) == code
    assert request(page, f"/{page.token}/").status == 200


def test_the_token_goes_to_no_other_site(page: LoopbackServer) -> None:
    """Neither by a Referer nor by a window that another page keeps."""
    headers = request(page, f"/{page.token}/").headers
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["Cross-Origin-Opener-Policy"] == "same-origin"
    assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Cache-Control"] == "no-store"
    assert "Access-Control-Allow-Origin" not in headers
    assert "Python" not in headers["Server"]


def test_ten_thousand_connections_leave_the_page_as_it_was(page: LoopbackServer) -> None:
    """They say nothing, or half a request; the page answers in between, and few threads run.

    Ends of sockets on this side are closed in turn: a process may have 1024 of them. An answer
    waits for the thousand connections that were asked for before it; two cores take a second.
    """
    before = threading.active_count()
    held: list[socket.socket] = []
    most, answers = 0, []
    room = resource.getrlimit(resource.RLIMIT_NOFILE)[0] - 6 * MOST_STRANGERS - 100
    for number in range(10_000):
        one = connected(page)
        if number % 2:
            one.sendall(b"GET / HT")
        held.append(one)
        if len(held) > min(600, room):
            held.pop(0).close()
        if number % 1000 == 999:
            most = max(most, threading.active_count() - before)
            start = time.monotonic()
            assert request(page, f"/{page.token}/still").status == 200
            answers.append(time.monotonic() - start)
    assert most <= 2 * MOST_STRANGERS + MOST_KNOWN
    assert sorted(answers)[len(answers) // 2] < 5.0
    for one in held:
        one.close()


def test_who_says_nothing_for_long_is_sent_away(
    page: LoopbackServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also with a letter now and then: the time is that of the whole request."""
    monkeypatch.setattr(connections, "SOON", 0.3)
    slow = connected(page)
    slow.settimeout(0.1)
    start, ended = time.monotonic(), False
    while not ended and time.monotonic() < start + PATIENT:
        try:
            slow.sendall(b"G")
            ended = slow.recv(100) == b""
        except TimeoutError:
            pass
        except ConnectionError:
            ended = True
    assert ended
    slow.close()
    # Who has shown the token may take longer for the next request.
    patient = http.client.HTTPConnection("127.0.0.1", page.server_port, timeout=PATIENT)
    for _ in range(2):
        patient.request("GET", f"/{page.token}/again")
        assert patient.getresponse().read() == b"<p>again</p>"
        time.sleep(1.0)
    patient.close()


def test_closed_connections_are_forgotten(page: LoopbackServer) -> None:
    for _ in range(2 * MOST_KNOWN):
        assert request(page, f"/{page.token}/").status == 200
    end = time.monotonic() + PATIENT
    while len(page.connections) and time.monotonic() < end:
        time.sleep(0.01)
    assert len(page.connections) == 0


def test_no_name_of_another_host_leads_here(tmp_path: Path) -> None:
    """DNS rebinding in a browser: a name that means this machine, with the right address."""
    chromium.needed()
    with serving(LoopbackServer(_Handler)) as server, chromium.Chromium(tmp_path) as browser:
        ready = "document.readyState === 'complete' && document.body.textContent"
        path = f"{server.server_port}/{server.token}/here"
        # Browsers take every name below localhost for this machine, as they do a rebound one.
        browser.open(f"http://evil.localhost:{path}", ready=ready)
        assert "the Host is not this server's" in browser.value("document.body.textContent")
        browser.open(f"http://localhost:{path}", ready=ready)
        assert browser.value("document.body.textContent") == "here"


def test_all_pages_have_this_server() -> None:
    from impasto.viewer import ViewServer

    assert issubclass(PageServer, LoopbackServer)
    assert issubclass(ViewServer, LoopbackServer)


@pytest.mark.parametrize(
    ("no_browser", "opens", "asked", "said"),
    [(False, True, 1, False), (False, False, 1, True), (True, True, 0, True)],
)
def test_an_address_that_no_browser_was_opened_with_is_to_be_opened(
    no_browser: bool,
    opens: bool,
    asked: int,
    said: bool,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    calls: list[str] = []

    def opened(url: str) -> bool:
        calls.append(url)
        return opens

    monkeypatch.setattr("webbrowser.open", opened)
    server = LoopbackServer(_Handler)
    # The server of a page runs until Ctrl-C: here, until it is ready.
    monkeypatch.setattr(server, "run", lambda ready: ready("http://127.0.0.1:1/token/"))
    try:
        assert serve(server, Stages(), "Ctrl-C here ends it", no_browser=no_browser) == 0
    finally:
        server.server_close()
    assert calls == ["http://127.0.0.1:1/token/"] * asked
    told = capsys.readouterr().err
    assert "http://127.0.0.1:1/token/" in told
    assert ("open this address in a browser" in told) == said
