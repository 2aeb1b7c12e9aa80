"""Hypotheses about a rig that are tried side by side."""

from __future__ import annotations

import _thread
import threading
from typing import Any

import pytest

import impasto
from impasto.fit import rig_search
from impasto.fit.bundle_adjustment import RigNumbers
from test_rig_refinement import photographs
from test_waiting import gone, heard  # noqa: F401


@pytest.mark.usefixtures("heard")
def test_what_is_still_tried_ends_with_the_call(monkeypatch: pytest.MonkeyPatch) -> None:
    """After Ctrl-C each thread looks at no more than the one rig that it was about to."""
    looked: list[bool] = []
    asked = threading.Event()
    at = rig_search.RigSearch.at

    def watched(self: Any, state: RigNumbers) -> impasto.Rig:
        looked.append(self.left)
        beside = threading.current_thread() is not threading.main_thread()
        if beside and len(looked) > 20 and not asked.is_set():
            asked.set()
            _thread.interrupt_main()
        return at(self, state)

    monkeypatch.setattr(rig_search.RigSearch, "at", watched)
    _, stack, _ = photographs(3.0, 4.0)
    with pytest.raises(KeyboardInterrupt):
        impasto.refine_rig(stack, threads=2)
    before = len(looked)
    assert gone()
    assert asked.is_set()
    assert len(looked) - before <= 2
    assert all(looked[before:])


def test_progress_is_heard_while_others_work() -> None:
    _, stack, _ = photographs(3.0, 4.0)
    calls = list[tuple[int, int]]()
    threads = set[int]()

    def report(done: int, total: int) -> None:
        calls.append((done, total))
        threads.add(threading.get_ident())

    impasto.refine_rig(stack, threads=2, progress=report)
    assert threads == {threading.get_ident()}
    assert len(calls) > 36  # the places where the search begins
    done = [done for done, _ in calls]
    assert done == sorted(done)
    assert calls[-1][0] == calls[-1][1]
