"""The second pass of a job on the workers of a Dask cluster.

Dask schedules; nothing here does. The calling process hands out tiles, a bounded number at a time,
and alone writes the journal. A tile whose worker dies is handed to another one by Dask.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from impasto._internal.extras import need
from impasto.errors import ArgumentError, ClusterError
from impasto.jobs.grid import Tile
from impasto.jobs.photographs import Photographs
from impasto.jobs.tiles import TileLog
from impasto.jobs.worker import HELD, SharedJob, fit_tile, release
from impasto.stack import Stack

if TYPE_CHECKING:
    from distributed import Client

FEWEST = 8
"""Tiles handed out at least, so that a cluster that grows with its work has a reason to."""
REFRESH = 1.0
"""Seconds after which workers are counted again."""
LOST = (
    "client: the tiles were cancelled, or the scheduler is gone; resume the job with a new client"
)
PATIENCE = 20
"""Seconds that a scheduler has for its answer."""


def checked_client(client: Any, source: Any) -> Client | None:
    """The client of a job, or a refusal that says what is wrong with it.

    Raises
    ------
    ArgumentError
        No client, an asynchronous or a closed one, or photographs that workers cannot read.
    """
    if client is None:
        return None
    distributed = sys.modules.get("distributed")
    if distributed is None or not isinstance(client, distributed.Client):
        raise ArgumentError(
            "client: expected a dask.distributed.Client, as of Client(cluster), found "
            f"{type(client).__name__}"
        )
    if client.asynchronous:
        raise ArgumentError(
            "client: is asynchronous, and a job waits for its tiles; give one that was made "
            "without asynchronous=True"
        )
    if client.status != "running":
        raise ArgumentError(f"client: is {client.status}; make a new one")
    if isinstance(source, Stack | Photographs):
        raise ArgumentError(
            "source: the workers of a client read the photographs themselves, and this stack is in "
            "the memory of one process; write it by impasto.io.write_stack('painting.npz', stack) "
            "and give that path"
        )
    return client


@contextmanager
def connected(scheduler: str | None) -> Iterator[Client | None]:
    """A client of a running scheduler, by its address or by its file; None without.

    Raises
    ------
    ArgumentError
        Nobody answers there.
    MissingExtraError
        distributed is not installed.
    """
    if scheduler is None:
        yield None
        return
    need("distributed", "scale", "a scheduler")
    from distributed import Client

    by = {"address" if "://" in scheduler else "scheduler_file": scheduler}
    # The client would wait for a file to appear.
    if "scheduler_file" in by and not Path(scheduler).exists():
        raise ArgumentError(
            f"scheduler: {scheduler} does not exist; expected the file of dask scheduler "
            '--scheduler-file, or an address such as "tcp://10.0.0.5:8786"'
        )
    try:
        client = Client(**by, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ArgumentError(
            f"scheduler: no Dask scheduler answers at {scheduler} ({error}); expected an address "
            'such as "tcp://10.0.0.5:8786", or the file of dask scheduler --scheduler-file'
        ) from error
    with client:
        yield client


def has_workers(client: Client) -> bool:
    """Whether a scheduler has a worker now.

    Raises
    ------
    ClusterError
        It was lost.
    """
    from distributed.comm import CommClosedError

    try:
        return bool(client.nthreads())
    except (CancelledError, CommClosedError) as error:
        raise ClusterError(LOST) from error


def fit_tiles_on(client: Client, job: SharedJob, tiles: Sequence[Tile], log: TileLog) -> None:
    """Fit tiles on the workers of a client, in whatever order they are done.

    Raises
    ------
    ClusterError
        A tile ended every worker that it was given to, or the scheduler was lost.
    """
    from distributed import as_completed
    from distributed.comm import CommClosedError
    from distributed.scheduler import KilledWorker

    job = replace(job, run=uuid4().hex)
    left = iter(tiles)
    ahead: dict[Any, Tile] = {}
    done: Any = as_completed(loop=client.loop)
    limit = _HandedOut(client)

    def hand_out() -> None:
        for tile in left:
            # Names of its own: results of another run must not be taken for those of this one.
            key = f"impasto-tile-{job.run}-{tile[0]}-{tile[1]}"
            future = client.submit(fit_tile, job, tile, log.wants_numbers, key=key, pure=False)
            ahead[future] = tile
            done.add(future)
            if len(ahead) >= limit.tiles():
                return

    try:
        if tiles:
            hand_out()
        while ahead:
            future = next(done)
            tile = ahead.pop(future)
            written = future.result()
            # First of all: the scheduler, which all else asks, may be gone.
            log.add(tile, written)
            if len(ahead) < limit.tiles():
                hand_out()
            log.report()
    except KilledWorker as error:
        raise ClusterError(
            f"client: tile {tile} was given to {error.allowed_failures + 1} workers, and each of "
            "them died: most often of too little memory. Give the workers more, or the job less "
            "(memory=), and resume it"
        ) from error
    except (CancelledError, CommClosedError) as error:
        raise ClusterError(LOST) from error
    finally:
        # There is nobody to be told where the scheduler is gone.
        with suppress(CancelledError, OSError, ValueError):
            if ahead:
                client.cancel(list(ahead))
            if client.status == "running":
                client.run(release, job, on_error="ignore")


class _HandedOut:
    """How many tiles are handed out at a time: as many as the workers hold, eight at least."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._counted = float("-inf")
        self._tiles = FEWEST

    def tiles(self) -> int:
        now = time.monotonic()
        if now - self._counted > REFRESH:
            threads = self._client.nthreads().values()
            self._tiles = max(FEWEST, sum(min(count + 1, HELD) for count in threads))
            self._counted = now
        return self._tiles
