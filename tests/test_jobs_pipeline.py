"""Jobs on their way: what status says of them, and that what is made reaches the disk."""

from __future__ import annotations

import signal
import threading
from pathlib import Path
from typing import Any

import pytest

import impasto
from impasto import _core, jobs
from impasto.jobs import job
from impasto.jobs.pipeline import BEHIND, pipelined
from killed_jobs import OPTIONS, stack

pytest.importorskip("fcntl", reason="jobs need POSIX")

TILES = [(0, column) for column in range(BEHIND + 4)]


def test_tiles_come_in_their_order_through_every_step() -> None:
    found = list(
        pipelined(
            TILES,
            read=lambda tile: ("read", tile),
            work=lambda tile, read: ("made", read),
            encode=lambda tile, made: ("encoded", made),
            write=lambda tile, encoded: (tile, encoded),
        )
    )
    assert found == [(tile, ("encoded", ("made", ("read", tile)))) for tile in TILES]


def test_one_tile_is_written_while_another_is_flushed() -> None:
    """With two writers each of the first two waits for the other; results keep their order."""
    both = threading.Barrier(2, timeout=10)

    def write(tile: tuple[int, int], _: object) -> tuple[int, int]:
        if tile[1] < 2:
            both.wait()
        return tile

    steps = (lambda tile: tile, lambda tile, _: tile, lambda tile, _: tile)
    assert list(pipelined(TILES, *steps, write, writers=2)) == TILES


def test_ctrl_c_loses_no_tile_that_is_made() -> None:
    # The disk is slow: everything is made that may be before the first tile is written. Ctrl-C then
    # comes while the caller waits for the disk.
    main = threading.get_ident()
    made: list[tuple[int, int]] = []
    on_disk: list[tuple[int, int]] = []
    full = threading.Event()

    def work(tile: tuple[int, int], read: object) -> object:
        made.append(tile)
        if len(made) == BEHIND + 1:
            full.set()
        return read

    def write(tile: tuple[int, int], files: object) -> None:
        if not on_disk:
            assert full.wait(10)
            waiting = threading.Event()
            waiting.wait(0.1)  # for the caller to wait for this tile
            signal.pthread_kill(main, signal.SIGINT)
            waiting.wait(0.1)
        on_disk.append(tile)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores it
    try:
        with pytest.raises(KeyboardInterrupt):
            list(pipelined(TILES, lambda tile: tile, work, lambda tile, result: result, write))
    finally:
        signal.signal(signal.SIGINT, before)
    assert made == TILES[: BEHIND + 1]
    assert on_disk == made


def test_a_running_job_says_what_it_is_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "painting.zarr"
    seen: list[str | None] = []

    def watched(function: Any) -> Any:
        def call(*arguments: Any, **options: Any) -> Any:
            seen.append(jobs.status(out).phase)
            return function(*arguments, **options)

        return call

    for name in ("open_photographs", "load_learned", "fit_tiles", "finish"):
        monkeypatch.setattr(f"impasto.jobs.job.{name}", watched(getattr(job, name)))
    impasto.run(stack(), out, **OPTIONS)
    assert [*seen, jobs.status(out).phase] == [
        *("reading", "learning", "tiles", "scales"),
        None,
    ]


def test_smaller_scales_take_the_threads_of_the_job(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reduced, taken = _core.reduced_surface, set()

    def counted(surface: Any, height: Any, factor: int, threads: int) -> Any:
        taken.add((factor, threads))
        return reduced(surface, height, factor, threads)

    monkeypatch.setenv("IMPASTO_NUM_THREADS", "3")
    monkeypatch.setattr(_core, "reduced_surface", counted)
    out = impasto.run(stack(), tmp_path / "a.zarr", pooling="none", tile=32, threads=1)
    assert (out / "levels" / "4").is_dir()
    assert taken == {(2, 1)}
