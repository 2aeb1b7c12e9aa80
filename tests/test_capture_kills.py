"""A capture that is killed loses at most the shot that it was at; ``killed_captures.py``."""

from __future__ import annotations

from pathlib import Path

import captures
from killed_captures import killed_and_resumed


def test_killed_captures_lose_at_most_one_shot(tmp_path: Path) -> None:
    """Killed before the journal begins, and before three of the four steps of a later shot.

    These are: the file is flushed, renamed, its folder is flushed, the journal is flushed.
    """
    shots = captures.plan(6, darks=1)
    seen = killed_and_resumed(tmp_path, shots, [1, 13, 14, 16])
    assert seen.kills == 4
    assert max(seen.lost) <= 1
    assert (seen.shots, seen.wrong) == (len(shots), 0)
