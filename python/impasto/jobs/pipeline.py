"""Tiles in their order: one is worked on while others are read, encoded and written."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future
from typing import TypeVar

from impasto._internal.pools import Pool
from impasto.jobs.grid import Tile

BEHIND = 2
"""Tiles that are encoded or written while the next one is made."""

Read = TypeVar("Read")
Made = TypeVar("Made")
Files = TypeVar("Files")
Written = TypeVar("Written")


def pipelined(
    tiles: Sequence[Tile],
    read: Callable[[Tile], Read],
    work: Callable[[Tile, Read], Made],
    encode: Callable[[Tile, Made], Files],
    write: Callable[[Tile, Files], Written],
    *,
    writers: int = 1,
) -> Generator[Written, None, None]:
    """What ``write`` returns of every tile.

    ``work`` runs in the calling thread, each of the others in one of its own; all take the tiles in
    their order. At a time one tile is read, one is worked on, one is encoded and one is written,
    or as many as there are ``writers``: a disk takes one while another is flushed.

    Whoever leaves before the end closes this, which waits for what is being done, as an error and
    Ctrl-C do: a tile that ``work`` has made is written.
    """
    with (
        Pool(1) as reader,
        Pool(1) as encoder,
        Pool(writers) as writer,
    ):

        def written(tile: Tile, files: Future[Files]) -> Written:
            return write(tile, files.result())

        ahead = reader.submit(read, tiles[0]) if tiles else None
        behind: deque[Future[Written]] = deque()
        for index, tile in enumerate(tiles):
            assert ahead is not None
            found = ahead.result()
            ahead = reader.submit(read, tiles[index + 1]) if index + 1 < len(tiles) else None
            made = work(tile, found)
            del found
            # Before anything is waited for: Ctrl-C, which ends a wait, loses no tile that is made.
            behind.append(writer.submit(written, tile, encoder.submit(encode, tile, made)))
            del made
            if len(behind) > BEHIND:
                yield behind.popleft().result()
        while behind:
            yield behind.popleft().result()
