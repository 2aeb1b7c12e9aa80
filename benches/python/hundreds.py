"""Lafortune lobes of a painting seen from hundreds of views: what a user waits for.

    python benches/python/hundreds.py [--size 512] [--threads 2] [--interrupt 20]

Simulates the third paper's 770 photographs, interrupts a fit after some seconds as Ctrl-C does,
then fits with a progress bar. Prints how long the interrupt took to stop it, processor seconds per
megapixel, the largest memory, and how far normals and numbers of lobes are from the truth.
"""

from __future__ import annotations

import argparse
import os
import resource
import signal
import threading
import time

import numpy as np
from record import show

import impasto
from impasto import simulate
from impasto.simulate.score import normal_error


def interrupted(
    stack: impasto.Stack, normals: impasto.Normals, after: float, threads: int
) -> float:
    """Seconds from a SIGINT, ``after`` seconds into the fit, to its end."""
    sent = []

    def send() -> None:
        sent.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(after, send)
    timer.start()
    try:
        impasto.fit_sbrdf(stack, model="lafortune", normals=normals, threads=threads)
    except KeyboardInterrupt:
        return time.perf_counter() - sent[0]
    timer.cancel()
    return float("nan")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--interrupt", type=float, default=20.0, help="seconds")
    options = parser.parse_args()
    painting = simulate.painting(seed=2, size=(options.size, options.size), varnish="patches")
    capture = simulate.capture(painting, "snel-lafortune")
    normals = impasto.fit_normals(capture.stack, method="huber", threads=options.threads)
    stop = interrupted(capture.stack, normals, options.interrupt, options.threads)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    wall, cpu = time.perf_counter(), time.process_time()
    fit = impasto.fit_sbrdf(
        capture.stack, model="lafortune", normals=normals, threads=options.threads, progress=True
    )
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    error = normal_error(fit.normal, capture.truth.normal)
    lobes = capture.truth.lobes
    assert lobes is not None
    true = (lobes.specular > 0).all(axis=1).sum(axis=0)
    megapixels = 1e-6 * options.size**2
    rows = {
        "stack, GB": 1e-9 * capture.stack.samples.nbytes,
        "from Ctrl-C to the end, ms": 1e3 * stop,
        "processor seconds per megapixel": cpu / megapixels,
        "seconds": wall,
        "memory before the fit, GB": 1e-6 * before,
        "largest memory, GB": 1e-6 * peak,
        "normals, median of degrees": float(np.nanmedian(error)),
        "normals, 95 % within degrees": float(np.nanpercentile(error, 95)),
        "lobes as true, %": 100.0 * float((fit.lobes == true).mean()),
        "more lobes than true, %": 100.0 * float((fit.lobes > true).mean()),
    }
    print(fit)
    show(
        f"{options.size} x {options.size}, 770 views",
        [{"": k, "found": v} for k, v in rows.items()],
    )


if __name__ == "__main__":
    main()
