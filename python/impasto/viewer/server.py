"""``impasto view``: a site for this machine alone, whose tiles are made when they are asked for."""

from __future__ import annotations

from http import HTTPStatus

from impasto._internal.loopback import LoopbackHandler, LoopbackServer, kind_of
from impasto.viewer.contents import Contents
from impasto.viewer.policy import policy


class ViewServer(LoopbackServer):
    """Serve the page of one painting to this machine.

    Parameters
    ----------
    contents
        What is shown.
    port
        To listen on; 0: a free one.

    Raises
    ------
    ArgumentError
        A port that is in use or not allowed.
    """

    def __init__(self, contents: Contents, port: int = 0) -> None:
        self.contents = contents
        super().__init__(_Handler, port)


class _Handler(LoopbackHandler):
    server: ViewServer
    policy = policy(embedded=False)
    one_at_a_time = False

    def do_GET(self) -> None:
        path = self.own_path()
        if path is None:
            return
        # A name is looked up, never opened.
        made = self.server.contents.file(path or "index.html")
        if made is None:
            self.refuse(HTTPStatus.NOT_FOUND, "there is nothing at this address")
            return
        kind = kind_of(path or "index.html")
        self.answer(lambda: (made(), kind))
