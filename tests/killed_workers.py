"""Workers and schedulers of a cluster that are killed at random while jobs run: the same bytes.

``python tests/killed_workers.py 20 [--record]`` kills twenty workers and says what it saw;
``python tests/killed_workers.py 5 --scheduler [--record]`` kills five schedulers, each with a job
that is then resumed on a new cluster.
"""

from __future__ import annotations

import argparse
import logging
import os
import random
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import DEVNULL, Popen
from typing import Any

import impasto
from impasto import jobs
from impasto.io import write_stack
from killed_jobs import stack, tree
from recorded_faults import recorded

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


def at_random(folder: Path, count: int) -> dict[str, Any]:
    """Jobs until so many workers are killed; what was seen."""
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
    return {"of": "workers", "kills": len(kills), "jobs": made, "different": different}


@contextmanager
def started(place: Path) -> Iterator[tuple[Any, Any]]:
    """A scheduler and two workers, each a process of its own; the scheduler's and a client."""
    from distributed import Client

    file, quiet = place / "scheduler.json", {"stdout": DEVNULL, "stderr": DEVNULL}
    file.unlink(missing_ok=True)
    common = ["--scheduler-file", str(file), "--no-dashboard"]
    local = ["--host", "127.0.0.1"]
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0", *local]
    scheduler = Popen([*command, *common], **quiet)  # type: ignore[call-overload]
    while not file.exists():
        time.sleep(0.1)
    command = [sys.executable, "-m", "distributed.cli.dask_worker", "--nworkers", "2", *local]
    workers = Popen([*command, "--nthreads", "1", *common], **quiet)  # type: ignore[call-overload]
    client = Client(scheduler_file=str(file), set_as_default=False)
    try:
        client.wait_for_workers(2, timeout=60)
        yield scheduler, client
    finally:
        for process in (workers, scheduler):
            process.terminate()
            process.wait()
        client.close(timeout=5)


def without_scheduler(folder: Path, count: int) -> dict[str, Any]:
    """Jobs whose scheduler is killed at a random tile; what was seen."""
    source, out = folder / "painting.npz", folder / "a.zarr"
    write_stack(source, stack(SIZE))
    expected = tree(impasto.run(source, folder / "whole.zarr", **OPTIONS))
    rng = random.Random(21)
    tiles = []
    different = 0
    waited = 0.0
    for _ in range(count):
        with started(folder) as (scheduler, client):
            tile = rng.randrange(1, 30)
            killed = []

            def kill(done: int, total: int, tile: int = tile, killed: list[float] = killed) -> None:
                if done == tile:
                    scheduler.kill()
                    killed.append(time.monotonic())

            try:
                impasto.run(source, out, client=client, progress=kill, **OPTIONS)
            except impasto.ClusterError:
                tiles.append(jobs.status(out).tiles_done)
                waited = max(waited, time.monotonic() - killed[0])
        if not out.exists():
            with started(folder) as (_, client):
                jobs.resume(out, client=client)
        different += tree(out) != expected
        assert jobs.verify(out) == ()
        shutil.rmtree(out)
    sys.stdout.write(
        f"{count} schedulers killed, {len(tiles)} jobs ended by it within {waited:.1f} s, with "
        f"{tiles} of 30 tiles, and resumed on a new cluster: {different} stores differ from that "
        "of a local job\n"
    )
    return {"of": "schedulers", "kills": len(tiles), "jobs": count, "different": different}


def main() -> int:
    """1 if a byte differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kills", type=int)
    parser.add_argument("--scheduler", action="store_true")
    parser.add_argument("--record", action="store_true")
    options = parser.parse_args()
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    kind = without_scheduler if options.scheduler else at_random
    with tempfile.TemporaryDirectory() as place:
        seen = kind(Path(place), options.kills)
    if options.record:
        command = f"python tests/killed_workers.py {options.kills}"
        recorded("cluster_kills", [seen], f"{command}{' --scheduler' * options.scheduler} --record")
    return int(bool(seen["different"]))


if __name__ == "__main__":
    raise SystemExit(main())
