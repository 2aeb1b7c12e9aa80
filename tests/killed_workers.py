"""Workers of a cluster that are killed at random while jobs run: the same bytes.

``python tests/killed_workers.py 20`` kills twenty and says what it saw.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

import impasto
from impasto import jobs
from impasto.io import write_stack
from killed_jobs import stack, tree

SIZE = (150, 170)
OPTIONS: dict[str, Any] = {"pooling": "none", "tile": 32}
"""Thirty tiles."""


def kill_at_random(cluster: Any, count: int, done: threading.Event, kills: list[int]) -> None:
    """Kill one of both workers when both work, whatever it is at."""
    rng = random.Random(20)
    while len(kills) < count and not done.wait(rng.uniform(0.1, 1.5)):
        if len(cluster.workers) < 2:
            cluster.scale(2)  # a nanny whose worker dies while it joins gives up
        if len(cluster.scheduler.workers) == len(cluster.workers) == 2 and not done.wait(0.5):
            process = rng.choice([nanny.pid for nanny in cluster.workers.values()])
            os.kill(process, signal.SIGKILL)
            kills.append(process)


def at_random(folder: Path, count: int) -> int:
    """Jobs until so many workers are killed; the number of stores that differ."""
    from distributed import Client, LocalCluster

    source, out = folder / "painting.npz", folder / "a.zarr"
    write_stack(source, stack(SIZE))
    expected = tree(impasto.run(source, folder / "whole.zarr", **OPTIONS))
    kills: list[int] = []
    made = different = again = 0
    with (
        LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        over = threading.Event()
        killer = threading.Thread(target=kill_at_random, args=(cluster, count, over, kills))
        killer.start()
        try:
            while len(kills) < count:
                while not out.exists():
                    try:
                        impasto.run(source, out, client=client, **OPTIONS)
                    except impasto.ClusterError:
                        again += 1  # a tile whose workers were all killed
                made += 1
                different += tree(out) != expected
                assert jobs.verify(out) == ()
                shutil.rmtree(out)
        finally:
            over.set()
            killer.join()
    sys.stdout.write(
        f"{len(kills)} workers killed in {made} jobs of {len(expected)} files: {different} stores "
        f"differ from that of a local job; {again} jobs had to be resumed\n"
    )
    return different


if __name__ == "__main__":
    import logging

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with tempfile.TemporaryDirectory() as place:
        sys.exit(at_random(Path(place), int(sys.argv[1])))
