"""What commands that serve a page share."""

from __future__ import annotations

import webbrowser
from typing import TYPE_CHECKING

from rich.markup import escape

from impasto.cli.codes import Exit
from impasto.cli.console import Stages
from impasto.errors import ArgumentError

if TYPE_CHECKING:
    from impasto._internal.loopback import LoopbackServer


def check_port(port: int) -> None:
    """Refuse a number that is no port."""
    if not 0 <= port <= 65535:
        raise ArgumentError(f"--port: expected 0 to 65535, found {port}")


def serve(server: LoopbackServer, stages: Stages, hint: str, *, no_browser: bool) -> int:
    """Serve until Ctrl-C; the address is printed and, unless that is unwanted, opened."""

    def ready(url: str) -> None:
        stages.say(f"  {'':14}{escape(url)}")
        stages.say(f"  {'':14}[dim]{hint}[/]")
        # A machine without a screen has no browser that could be opened.
        if no_browser or not webbrowser.open(url):
            stages.say(f"  {'':14}[dim]open this address in a browser of this machine[/]")

    server.run(ready)
    return Exit.OK
