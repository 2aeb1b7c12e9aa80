"""Bars of commands, as a terminal shows them."""

from __future__ import annotations

import io

from rich.console import Console

from impasto.cli.console import Stages


def test_a_stage_says_what_it_does_until_there_is_progress() -> None:
    stages = Stages()
    screen = io.StringIO()
    stages._console = Console(file=screen, force_terminal=True, width=120, color_system=None)
    seen: list[str] = []

    def shown() -> str:
        """What is new on the screen."""
        text = screen.getvalue()
        seen.append(text)
        return text[len(seen[-2]) if len(seen) > 1 else 0 :]

    with stages.stage("merge", "registering") as stage:
        stage.advance(0, 4)
        stage.refresh()
        assert "registering" in shown()
        stage.advance(1, 4)
        stage.refresh()
        assert "registering" not in shown()
        stage.show("1 of 4")
        stage.refresh()
        assert "1 of 4" in shown()
        stage.advance(2, 4)
        stage.refresh()
        assert "1 of 4" in shown(), "words of a command stay until it says others"
        stage.note = "painting.zarr"
    assert "painting.zarr" in shown()
