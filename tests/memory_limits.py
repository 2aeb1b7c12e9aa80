"""Memory that runs out, everywhere: ``python tests/memory_limits.py --limits 60 --record``.

Each call is made in children whose memory is limited (``RLIMIT_AS``) to more and more beside what
the program has: from nothing to more than the call needs. A child must end with a result or with
``MemoryError``. What ends a process (an allocation of Rust that fails, a thread that has no stack),
another exception, or a wait without end is a fault.

The least memory with which a call gives its result is found by bisection first. Three quarters of
the limits lie below it, where every one stops the call at another of its allocations; the rest lie
between it and what the call takes where nothing limits it, which may be more.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import resource
import select
import shutil
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import zarr  # noqa: F401  # not in every child

import impasto
from impasto import io
from recorded_faults import recorded

RESULT, REFUSED, FAULT = 0, 1, 2
"""Exit codes of a child."""
PAGE = 4096
LIBC = ctypes.CDLL(None)
MMAP_THRESHOLD, ARENA_MAX = -3, -8
"""Parameters of glibc's ``mallopt``."""
WAIT = 30.0
"""Seconds that no call takes; a child that says nothing for so long is ended by a signal."""
SPARE = 48 << 20
"""Bytes that the last limit is above what the call took: what must stay free beside a map."""


def calls(size: int, folder: Path) -> dict[str, Callable[[], Any]]:
    """Calls on square pictures of so many rows, whose inputs are made here."""
    keep_no_room()
    directions = [(0.5, 0, 0.9), (0, 0.5, 0.9), (-0.5, 0, 0.9), (0, -0.5, 0.9), (0, 0, 1)]
    lights = [*directions, (0.3, 0.3, 1)]
    random = np.random.default_rng(1)
    samples = random.uniform(0.2, 0.9, (len(lights), 3, size, size)).astype(np.float32)
    stack = impasto.Stack(samples, lights=lights)
    normals = impasto.fit_normals(stack, method="least-squares", threads=1)
    sbrdf = impasto.fit_sbrdf(stack, pooling="painting", check=False, threads=1)
    height = random.uniform(0.0, 0.3, (size, size)).astype(np.float32)
    scene = impasto.Scene(lights=[impasto.DistantLight((0.5, 0, 0.9))])
    large = random.uniform(0.0, 1.0, (3, 4 * size, 4 * size)).astype(np.float32)
    io.write_tiff16(folder / "a.tif", large)
    io.write_exr(folder / "a.exr", {"Y": large[0]})
    part = stack[: size // 4, : size // 4]
    return {
        "integrate_normals": lambda: impasto.integrate_normals(
            normals.normal, pitch_mm=0.1, threads=2
        ),
        "fit_normals": lambda: impasto.fit_normals(stack, threads=2),
        "fit_sbrdf": lambda: impasto.fit_sbrdf(stack, pooling="painting", check=False, threads=2),
        "fit_lobes": lambda: impasto.fit_sbrdf(part, pooling="pixel", check=False, threads=2),
        "render": lambda: impasto.render(sbrdf, scene, threads=2),
        "render_smaller": lambda: impasto.render(sbrdf, scene, reduce=2, threads=2),
        "cast_shadows": lambda: impasto.cast_shadows(height, 0.1, (0.8, 0.1, 0.3), threads=2),
        "predict": lambda: sbrdf.predict(scene.lights, threads=2),
        "run": lambda: job(stack, folder / "job.zarr"),
        "read_image": lambda: (io.read_image(folder / "a.tif"), io.read_image(folder / "a.exr")),
    }


def keep_no_room() -> None:
    """Let arrays come from the system and go back to it, and threads reserve no heaps of their own.

    Else a call finds room in those of an earlier one.
    """
    LIBC.mallopt(MMAP_THRESHOLD, 1 << 18)
    LIBC.mallopt(ARENA_MAX, 1)


def job(stack: impasto.Stack, out: Path) -> None:
    """A job from its beginning, whatever an earlier one has left."""
    partial = out.with_name(out.name + ".partial")
    for left in (out, partial):
        shutil.rmtree(left, ignore_errors=True)
    impasto.run(stack, out, pooling="none", normals="least-squares", tile=128, threads=2)


def limited(call: Callable[[], Any], room: int | None) -> tuple[int, int]:
    """How a call ends in a child with so many bytes to spare, and how many it took at most."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        _child(call, room, writing)
    os.close(writing)
    with os.fdopen(reading) as told:
        if not select.select([told], [], [], WAIT)[0]:
            os.kill(child, signal.SIGALRM)  # it waits for ever
        taken = told.read()
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status), int(taken or 0)


def _child(call: Callable[[], Any], room: int | None, writing: int) -> None:
    ending = FAULT
    try:
        LIBC.malloc_trim(0)
        before = _bytes("VmSize")
        if room is not None:
            resource.setrlimit(resource.RLIMIT_AS, (before + room, resource.RLIM_INFINITY))
        try:
            call()
            ending = RESULT
        except MemoryError:
            ending = REFUSED
        except BaseException as error:
            os.write(2, f"  {type(error).__name__}: {error}\n".encode()[:400])
        resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY,) * 2)
        os.write(writing, str(_bytes("VmPeak") - before).encode())
    finally:
        os._exit(ending)


def _bytes(name: str) -> int:
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    (found,) = (line.split()[1] for line in lines if line.startswith(f"{name}:"))
    return 1024 * int(found)


def enough(call: Callable[[], Any], most: int) -> int:
    """The least room with which a call gives its result, to a hundredth of it or a page."""
    least = 0
    while most - least > max(PAGE, most // 100):
        middle = (least + most) // 2
        if limited(call, middle)[0] == RESULT:
            most = middle
        else:
            least = middle
    return most


def sweep(call: Callable[[], Any], limits: int) -> Counter[int]:
    """How a call ends under so many limits."""
    ending, taken = limited(call, None)
    if ending != RESULT:
        raise RuntimeError(f"it ends with {ending} where memory is not limited")
    most = taken + SPARE
    needed = enough(call, most)
    below = 3 * limits // 4
    rooms = [needed * step // below for step in range(below)]
    beyond = limits - below
    rooms += [needed + (most - needed) * (step + 1) // beyond for step in range(beyond)]
    found: Counter[int] = Counter()
    for room in rooms:
        ending, _ = limited(call, room)
        if ending not in {RESULT, REFUSED}:
            os.write(2, f"  {ending} with {room} of {needed} bytes\n".encode())
        found[ending] += 1
    return found


def main() -> int:
    """Try all calls, or those that are named; 1 if there is a fault."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("calls", nargs="*", help="default: all")
    options.add_argument("--limits", type=int, default=60)
    options.add_argument("--size", type=int, default=320)
    options.add_argument("--record", action="store_true")
    chosen = options.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as name:
        known = calls(chosen.size, Path(name))
        for one in chosen.calls or known:
            found = sweep(known[one], chosen.limits)
            wrong = sum(count for ending, count in found.items() if ending not in {RESULT, REFUSED})
            row = {"results": found[RESULT], "refused": found[REFUSED], "faults": wrong}
            rows.append({"call": one, "limits": chosen.limits, **row})
            sys.stdout.write(
                f"{one}: {found[RESULT]} results, {found[REFUSED]} MemoryError, {wrong} faults\n"
            )
            sys.stdout.flush()
    if chosen.record:
        recorded("memory", rows, f"python tests/memory_limits.py --limits {chosen.limits} --record")
    return int(any(row["faults"] for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
