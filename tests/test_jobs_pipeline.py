"""Tiles on their way through a job: what is made reaches the disk, whatever ends the call."""

from __future__ import annotations

import signal
import threading

import pytest

from impasto.jobs.pipeline import BEHIND, pipelined

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


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="needs signals of POSIX")
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

    with pytest.raises(KeyboardInterrupt):
        list(pipelined(TILES, lambda tile: tile, work, lambda tile, result: result, write))
    assert made == TILES[: BEHIND + 1]
    assert on_disk == made
