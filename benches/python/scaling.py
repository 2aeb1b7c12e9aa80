"""What more cores bring: workers of one thread to a job, threads to a fit in memory.

    python benches/python/scaling.py [--most 8] [--rounds 5] [--record FILE]

A simulated relief of 512 x 512 pixels under 16 lamps in six bands (``tests/oracles/forward.py``,
plain numpy from the papers), with noise of 0.2 %, and lobes per pixel. Workers: the second pass of
a job of 16 tiles, on clusters of one, two, four ... workers, of one thread each. Threads:
``fit_sbrdf`` of the whole. Rounds alternate; times are medians, and ratios are those of each round.

More workers than half of the cores measure the machine: scheduler and client work, too. The script
needs no package beyond impasto's and Dask, so that it runs where there are cores.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from record import ROOT, run_info, show

import impasto
from impasto.io import write_stack

sys.path.insert(0, str(ROOT / "tests"))

from oracles import forward, rigs

SIZE, TILE, BANDS, LAMPS = 512, 128, 6, 16
NOISE = 0.002
FIT: dict[str, Any] = {"pooling": "pixel"}
JOB: dict[str, Any] = {"tile": TILE, "threads": 1, **FIT}


def photographs() -> impasto.Stack:
    """Waves of slope and colour, some ten pixels long, under one gloss."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:SIZE, :SIZE] / 64.0
    slope = [0.1 * np.sin(8 * x + 5 * y), 0.1 * np.sin(8 * y - 5 * x)]
    normal = np.stack([*slope, np.ones_like(x)])
    normal /= np.linalg.norm(normal, axis=0)
    waves = [np.sin((4 + k) * x + (6 - k) * y) for k in range(BANDS)]
    diffuse = 0.3 + 0.2 * np.array(waves)
    lamps, view = rigs.spiral(LAMPS), np.array([0.0, 0.0, 1.0])
    light = np.array([forward.radiance(normal, diffuse, 8.0, 0.12, lamp, view) for lamp in lamps])
    light += rng.normal(0.0, NOISE, light.shape)
    return impasto.Stack(light.astype(np.float32), lights=lamps)


def doubled(most: int) -> list[int]:
    """1, 2, 4 ... up to ``most``."""
    return [1 << k for k in range(most.bit_length()) if 1 << k <= most]


def rows(what: str, times: dict[int, list[float]]) -> list[dict[str, Any]]:
    """Medians, and how many times as fast as one."""
    found = []
    for count, seconds in times.items():
        ratios = [one / more for one, more in zip(times[1], seconds, strict=True)]
        found.append(
            {
                what: count,
                "seconds": median(seconds),
                "times as fast": median(ratios),
                "from": min(ratios),
                "to": max(ratios),
            }
        )
    return found


def second_pass(folder: Path, client: Any, name: str, **options: Any) -> float:
    """Seconds of a job from the first tile handed out to the last one written."""
    times: list[float] = []
    impasto.run(
        folder / "painting.npz",
        folder / f"{name}.zarr",
        client=client,
        progress=lambda done, total: times.append(time.perf_counter()),
        **options,
    )
    return times[-1] - times[0]


def by_workers(stack: impasto.Stack, most: int, rounds: int) -> list[dict[str, Any]]:
    """Jobs on clusters of more and more workers."""
    from distributed import Client, LocalCluster

    times: dict[int, list[float]] = {count: [] for count in doubled(most)}
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        write_stack(folder / "painting.npz", stack)
        clients = {}
        for count in times:
            cluster = LocalCluster(
                n_workers=count, threads_per_worker=1, processes=True, dashboard_address=None
            )
            clients[count] = cluster, Client(cluster, set_as_default=False)
        # The first job imports and opens.
        for count, (_, client) in clients.items():
            second_pass(folder, client, f"warm-{count}", **JOB)
        for index in range(rounds):
            for count, (_, client) in clients.items():
                times[count].append(second_pass(folder, client, f"{index}-{count}", **JOB))
        for cluster, client in clients.values():
            client.close()
            cluster.close()
    return rows("workers", times)


def by_threads(stack: impasto.Stack, most: int, rounds: int) -> list[dict[str, Any]]:
    """The fit in memory on more and more threads."""
    times: dict[int, list[float]] = {count: [] for count in doubled(most)}
    for _ in range(rounds):
        for count, seconds in times.items():
            start = time.perf_counter()
            impasto.fit_sbrdf(stack, refine=False, threads=count, **FIT)
            seconds.append(time.perf_counter() - start)
    return rows("threads", times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    cores = os.cpu_count() or 1
    parser.add_argument("--most", type=int, default=max(cores // 2, 2), help="workers")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--record", metavar="FILE", help="write a record of the run")
    parser.add_argument("--commit", help="for the record, where git does not know it")
    options = parser.parse_args()
    stack = photographs()
    workers = by_workers(stack, options.most, options.rounds)
    threads = by_threads(stack, cores, options.rounds)
    show("second pass of a job, workers of one thread", workers)
    show("fit in memory", threads)
    if options.record:
        run = run_info("python benches/python/scaling.py --record FILE")
        run["commit"] = options.commit or run["commit"]
        content = {"run": run, "workers": workers, "threads": threads}
        Path(options.record).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
