"""Requests to a server on the loopback, as a browser or an attacker sends them."""

from __future__ import annotations

import http.client
import json
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from impasto._internal.loopback import LoopbackServer

Server = TypeVar("Server", bound=LoopbackServer)


@contextmanager
def serving(server: Server) -> Iterator[Server]:
    """The server, answering."""
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@dataclass
class Answer:
    status: int
    kind: str
    data: bytes
    headers: dict[str, str]

    @property
    def error(self) -> str:
        return str(json.loads(self.data)["error"])


def request(
    server: LoopbackServer, path: str, body: bytes | None = None, **headers: str | None
) -> Answer:
    """As the page asks; a header of None is left out. The path is sent as it is."""
    own = f"127.0.0.1:{server.server_port}"
    sent: dict[str, str | None] = {"Host": own}
    if body is not None:
        sent |= {"Origin": f"http://{own}", "Content-Type": "application/json"}
        sent |= {"Content-Length": str(len(body))}
    sent |= {name.replace("_", "-"): value for name, value in headers.items()}
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=20)
    connection.putrequest(
        "GET" if body is None else "POST", path, skip_host=True, skip_accept_encoding=True
    )
    for name, value in sent.items():
        if value is not None:
            connection.putheader(name, value)
    connection.endheaders()
    try:
        if body:
            connection.send(body)
    except OSError:
        pass  # refused before the body was read
    answer = connection.getresponse()
    found = Answer(answer.status, answer.getheader("Content-Type", ""), answer.read(),
                   dict(answer.getheaders()))  # fmt: skip
    connection.close()
    return found


@contextmanager
def running(words: list[str], folder: Path) -> Iterator[str]:
    """The address that a command prints; Ctrl-C then ends it without an error."""
    code = (
        "import signal\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores it\n"
        "from impasto.cli import main\n"
        f"raise SystemExit(main({words}))\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], cwd=folder, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stderr is not None
            line = ""
            while "http://" not in line:
                line = process.stderr.readline()
                assert line, "the command ended before it printed an address"
            yield line.strip()
            process.send_signal(signal.SIGINT)
            assert process.wait(30) == 0
            assert "Traceback" not in process.stderr.read()
        finally:
            process.kill()


def fetched(url: str) -> bytes:
    """What a browser gets from an address."""
    host, _, path = url.removeprefix("http://").partition("/")
    connection = http.client.HTTPConnection(host, timeout=20)
    connection.request("GET", f"/{path}")
    answer = connection.getresponse()
    assert answer.status == 200
    data = answer.read()
    connection.close()
    return data
