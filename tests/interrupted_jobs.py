"""Jobs that Ctrl-C ends after a known number of tiles."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from unittest.mock import patch

import pytest

from impasto.jobs import pipeline


@contextmanager
def interrupting(after: int) -> Iterator[Callable[[int, int], None]]:
    """``progress=`` of a call that is interrupted with ``after`` tiles, two or more, on the disk.

    A job tells of a tile when the next ones are on their way to the disk, which they reach; here
    that is one, so that every number from two on can be had.
    """

    def stop(done: int, total: int) -> None:
        if done == after - 1:
            raise KeyboardInterrupt

    with patch.object(pipeline, "BEHIND", 1), pytest.raises(KeyboardInterrupt):
        yield stop
