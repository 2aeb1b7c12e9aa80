"""What Dask costs per tile, and what a second worker brings.

    python benches/python/cluster.py [--record]

Wrapper: a painting of 256 tiles of 32 x 32 pixels, of which photometric stereo takes a few
milliseconds each, is fitted tile by tile by ``LearnedModel.apply``, and lazily with all maps
computed together, by dask on one thread of this process and by distributed on one worker of one
thread. The difference of processor times (of this process, in which the scheduler runs, and of the
worker) over the number of tiles is what dask costs; wall-clock times stand beside it. Rounds
alternate; the median counts. ``tasks`` is how many there are for a tile, those that read not
counted: small tiles share the chunks of the maps. *Apart*: every tile has chunks of its own, as
tiles of more than 512 x 512 pixels have.

Workers: the second pass of a job with lobes per pixel, some seconds per tile, on a cluster of one
worker and on one of two, of one thread each. Rounds alternate; the median of the ratios of
wall-clock times counts. ``load`` is the load of the machine before that, in cores.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any
from unittest.mock import patch

os.environ["OPENBLAS_NUM_THREADS"] = "1"

from record import run_info, show, write
from scaling import second_pass

import impasto
from impasto import simulate
from impasto.fit import lazy as lazy_stacks
from impasto.io import write_stack

SMALL, TILES = 32, 16
AIM = 5.0
"""Milliseconds beyond its fit that a tile should cost at most."""
ROUNDS = 3
LARGE: dict[str, Any] = {"pooling": "pixel", "tile": 128, "threads": 1}
SIZE = (512, 512)
"""Sixteen tiles of 128 x 128 pixels."""


def photographs(size: tuple[int, int]) -> impasto.Stack:
    return simulate.default_capture("tominaga-six-band-adaptation", size=size).stack


def seconds(work: Callable[[], object]) -> tuple[float, float]:
    """Of the wall clock, and of the processors in this process and those that it has started."""
    import psutil

    def used() -> float:
        own = psutil.Process()
        times = [one.cpu_times() for one in [own, *own.children(recursive=True)]]
        return float(sum(each.user + each.system for each in times))

    start, before = time.perf_counter(), used()
    work()
    return time.perf_counter() - start, used() - before


def workers(count: int) -> Any:
    from distributed import LocalCluster

    return LocalCluster(
        n_workers=count, threads_per_worker=1, processes=True, dashboard_address=None
    )


def tasks_of(lazy: impasto.LazyStack, model: impasto.LearnedModel, chunk: int | None) -> float:
    """Per tile, less the one that reads its samples."""
    with patch.object(lazy_stacks, "CHUNK", chunk or lazy_stacks.CHUNK):
        graph = dict(model.apply(lazy).__dask_graph__())
    return len(graph) / TILES**2 - 1.0


def wrapper() -> list[dict[str, Any]]:
    """Milliseconds per tile beyond those of the fit alone."""
    import dask.array
    from distributed import Client, wait

    side = SMALL * TILES
    stack = photographs((side, side))
    model = impasto.learn_sbrdf(stack, pooling="none")
    samples = dask.array.from_array(stack.samples, chunks=(-1, -1, SMALL, SMALL))
    about = {"scale": stack.scale, "black": stack.black, "saturation": stack.saturation}
    lazy = impasto.LazyStack(samples, lights=stack.rig, **about)
    starts = range(0, side, SMALL)

    def alone() -> None:
        for top in starts:
            for left in starts:
                part = slice(top, top + SMALL), slice(left, left + SMALL)
                model.apply(stack, *part, threads=1)

    with workers(1) as cluster, Client(cluster, set_as_default=False) as client:
        # Samples lie in the worker's memory, as they would come from its files.
        near = impasto.LazyStack(client.persist(samples), lights=stack.rig, **about)

        def on_worker() -> None:
            with client.as_current():
                wait(client.persist(model.apply(near)))

        def apart() -> None:
            with patch.object(lazy_stacks, "CHUNK", SMALL):
                on_worker()

        ways: dict[str, Callable[[], object]] = {
            "apply": alone,
            "building the graph": lambda: model.apply(lazy),
            "dask, one thread": lambda: model.apply(lazy).compute(
                scheduler="threads", num_workers=1
            ),
            "distributed, one worker": on_worker,
            "distributed, apart": apart,
        }
        times: dict[str, list[tuple[float, float]]] = {name: [] for name in ways}
        for _ in range(ROUNDS):
            for name, work in ways.items():
                times[name].append(seconds(work))
        tasks = {name: tasks_of(near, model, SMALL if "apart" in name else None) for name in times}
    count, fit = TILES**2, times.pop("apply")
    rows = []
    for name, found in times.items():
        beyond = [(a - c, b - d) for (a, b), (c, d) in zip(found, fit, strict=True)]
        if "graph" in name:
            beyond = found
        rows.append(
            {
                "way": name,
                "tasks": tasks[name],
                "ms per tile": 1e3 * median(one[0] for one in found) / count,
                "beyond the fit, ms": 1e3 * median(one[0] for one in beyond) / count,
                "processor ms": 1e3 * median(one[1] for one in beyond) / count,
            }
        )
    return rows


def two_workers() -> list[dict[str, Any]]:
    """Seconds of a job on one worker and on two."""
    from distributed import Client

    found: dict[int, list[float]] = {1: [], 2: []}
    loads: list[float] = []
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        write_stack(folder / "painting.npz", photographs(SIZE))
        with (
            workers(1) as single,
            Client(single, set_as_default=False) as one,
            workers(2) as double,
            Client(double, set_as_default=False) as two,
        ):
            # The first job imports and opens.
            for count, client in ((1, one), (2, two)):
                second_pass(folder, client, f"warm-{count}", **LARGE)
            for index in range(ROUNDS):
                for count, client in ((1, one), (2, two)):
                    loads.append(os.getloadavg()[0])
                    found[count].append(second_pass(folder, client, f"{index}-{count}", **LARGE))
    ratios = [a / b for a, b in zip(found[1], found[2], strict=True)]
    return [
        {
            "tiles": 16,
            "one worker, s": median(found[1]),
            "two workers, s": median(found[2]),
            "one / two": median(ratios),
            "from": min(ratios),
            "to": max(ratios),
            "load": median(loads),
        }
    ]


def sentences(costs: list[dict[str, Any]]) -> dict[str, str]:
    """What the numbers say of tiles with chunks of their own, for documentation."""
    apart = next(row for row in costs if row["way"] == "distributed, apart")
    beyond = apart["beyond the fit, ms"]
    return {
        "apart": (
            "Tiles with chunks of their own, those of "
            f"{lazy_stacks.CHUNK} x {lazy_stacks.CHUNK} pixels or more, cost {beyond:.1f} ms each, "
            f"{'more than' if beyond > AIM else 'within'} the {AIM:g} ms that are aimed at: each "
            f"has {apart['tasks']:.0f} tasks. A job has one task per tile."
        )
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--record", action="store_true")
    record = parser.parse_args().record
    costs = wrapper()
    show("What dask costs per tile", costs)
    jobs = two_workers()
    show("A second worker", jobs)
    if record:
        info = run_info("python benches/python/cluster.py --record")
        found = {"wrapper": costs, "workers": jobs, "sentences": sentences(costs)}
        write("cluster.json", {"run": info} | found)


if __name__ == "__main__":
    main()
