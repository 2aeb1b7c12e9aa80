"""What every call into the numerics checks first, and how it reports."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import impasto
from impasto._internal.calls import MOST_THREADS, reporting, thread_count


@pytest.mark.parametrize("fit", [impasto.fit_normals, impasto.fit_sbrdf])
def test_arrays_in_the_place_of_a_stack_are_told_what_to_do(fit: object) -> None:
    with pytest.raises(
        ValueError, match=r"expected an impasto\.Stack, as of .*lights=directions\), found ndarray"
    ):
        fit(np.zeros((4, 3, 8, 8)))  # type: ignore[operator]


def test_more_threads_than_help_are_not_started(monkeypatch: pytest.MonkeyPatch) -> None:
    assert thread_count(10**9) == max(MOST_THREADS, os.cpu_count() or 1)
    monkeypatch.setenv("IMPASTO_NUM_THREADS", "100000")
    assert thread_count(None) == max(MOST_THREADS, os.cpu_count() or 1)


def test_a_digit_that_is_no_number_of_threads_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMPASTO_NUM_THREADS", "²")
    with pytest.raises(impasto.ArgumentError, match="IMPASTO_NUM_THREADS: expected"):
        thread_count(None)


def test_a_bar_is_gone_after_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    from rich.live import Live

    shown: list[Live] = []
    start = Live.start

    def remember(self: Live, refresh: bool = False) -> None:
        shown.append(self)
        start(self, refresh)

    def interrupted() -> None:
        with reporting(True, "fitting") as callback:
            assert callback is not None
            callback(1, 2)
            raise KeyboardInterrupt

    monkeypatch.setattr(Live, "start", remember)
    monkeypatch.setenv("FORCE_COLOR", "1")  # to rich, a terminal: elsewhere there is no bar
    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert shown
    assert not any(live.is_started for live in shown)


def test_an_unknown_light_is_not_the_camera_files_fault(tmp_path: Path) -> None:
    path = tmp_path / "camera.csv"
    path.write_text("wavelength,red\n400,0.1\n500,0.5\n600,0.9\n", encoding="utf-8")
    with pytest.raises(impasto.ArgumentError, match="illuminant"):
        impasto.io.read_camera(path, illuminant="moonshine")
