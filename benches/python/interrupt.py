"""How long Ctrl-C takes to stop every long call.

    python benches/python/interrupt.py [--record]

Each call runs in a process of its own on a painting of a megapixel or more, again and again, on one
thread and on two. What is not done within a minute is stopped and stands in the table without
numbers. SIGINT is sent at five moments; the time from there to ``KeyboardInterrupt``
counts: a heartbeat of 50 ms at most, and what the call is in the middle of. The promise is 200 ms.
Beside each wait stands the processor time that all threads of the process got meanwhile: a long
wait in which little was computed is that of a machine which others use. Every wait is recorded.
"""

from __future__ import annotations

import argparse
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from record import run_info, show, write

import impasto
from impasto import simulate

SIZE = (1024, 1024)
THREADS = (1, 2)
MOMENTS = (0.1, 0.3, 0.6, 1.0, 1.6)
"""Seconds from the call's beginning to the signal."""
LIMIT = 60.0
"""Seconds that one call may take with all that belongs to it: making ready takes some three, all
its moments eight."""


def painting(lights: int = 32) -> tuple[impasto.Stack, Any]:
    """A megapixel of a tiled small painting under many lights, and its normals."""
    rng = np.random.default_rng(1)
    directions = rng.normal((0.0, 0.0, 1.2), (0.6, 0.6, 0.1), (lights, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rig = impasto.Rig(directions)
    normal = np.concatenate([rng.normal(0.0, 0.15, (2, 64, 64)), np.ones((1, 64, 64))])
    normal = (normal / np.linalg.norm(normal, axis=0)).astype(np.float32)
    diffuse = rng.uniform(0.1, 0.6, (3, 64, 64)).astype(np.float32)
    small = impasto.Surface.torrance_sparrow(normal, diffuse, 10.0, 0.15).predict(rig)
    small += 0.003 * rng.standard_normal(small.shape).astype(np.float32)
    times = (SIZE[0] // 64, SIZE[1] // 64)
    stack = impasto.Stack(np.tile(small, (1, 1, *times)), lights=rig)
    return stack, np.tile(normal, (1, *times))


def views() -> impasto.Stack:
    """Two hundred photographs from as many views."""
    rig = simulate.rig("snel-lafortune").take(range(0, 770, 4))
    small = simulate.capture(simulate.painting(seed=4, size=(32, 32)), rig, "rgb").stack
    samples = np.tile(small.samples, (1, 1, 16, 16))
    return impasto.Stack(samples, lights=small.rig)


def surface() -> Any:
    """What is rendered: four megapixels with relief."""
    rows, columns = (2 * side for side in SIZE)
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    height = np.float32(0.3) * np.sin(x / 9.0) * np.cos(y / 13.0)
    slopes = np.gradient(height)
    normal = np.stack([-slopes[1], slopes[0], np.ones_like(height)])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = np.full((3, rows, columns), 0.4, np.float32)
    return normal.astype(np.float32), diffuse, height.astype(np.float32)


def calls() -> dict[str, Callable[[], Callable[..., Any]]]:
    """Name to a function that makes ready and returns the call, with ``threads=``."""

    def normals(method: Any) -> Callable[[], Callable[..., Any]]:
        def ready() -> Callable[..., Any]:
            stack = painting()[0]
            return lambda **o: impasto.fit_normals(stack, method=method, **o)

        return ready

    def sbrdf(**options: Any) -> Callable[[], Callable[..., Any]]:
        def ready() -> Callable[..., Any]:
            stack = painting()[0]
            if options.get("pooling") == "segment":
                options["segments"] = np.arange(SIZE[0])[:, None] // 256 * np.ones(SIZE[1], int)
            return lambda **o: impasto.fit_sbrdf(stack, **options, **o)

        return ready

    def lafortune() -> Callable[..., Any]:
        stack = views()
        return lambda **o: impasto.fit_sbrdf(stack, model="lafortune", **o)

    def lobe() -> Callable[..., Any]:
        rng = np.random.default_rng(2)
        phi = rng.uniform(0.0, 0.6, (16, 4 * SIZE[0] * SIZE[1])).astype(np.float32)
        samples = 100.0 * np.exp(-20.0 * phi**2)
        return lambda **o: impasto.fit_highlight(phi, samples, **o)

    def shown() -> Callable[..., Any]:
        normal, diffuse, _ = surface()
        lights = simulate.rig("tominaga-six-band-adaptation")
        glossy = impasto.Surface.torrance_sparrow(normal, diffuse, 10.0, 0.15)
        return lambda **o: glossy.predict(lights, **o)

    def rendered() -> Callable[..., Any]:
        normal, diffuse, height = surface()
        beta, gamma = (np.full(height.shape, v, np.float32) for v in (10.0, 0.15))
        thing = impasto.Surface.torrance_sparrow(normal, diffuse, beta, gamma, pitch_mm=0.1)
        scene = impasto.Scene(
            [impasto.DistantLight((0.7, 0.4, 0.3)), impasto.PointLight((30.0, 10.0, 40.0))],
            view=(0.3, -0.2, 1.0),
            shadows=True,
        )
        return lambda **o: impasto.render(thing, scene, height=height, **o)

    def heights() -> Callable[..., Any]:
        normal = surface()[0]
        return lambda **o: impasto.integrate_normals(normal, 0.1, **o)

    def suggested() -> Callable[..., Any]:
        stack = painting()[0]
        return lambda threads: impasto.suggest_effort(stack, error=0.02, threads=threads)

    def reflectance() -> Callable[..., Any]:
        _, diffuse, _ = surface()
        camera = simulate.camera("rgb")
        return lambda **o: impasto.fit_reflectance(None, diffuse, camera, **o)

    def saved() -> Callable[..., Any]:
        fit = impasto.fit_sbrdf(painting(4)[0], joint=False)
        folder = tempfile.TemporaryDirectory()
        return lambda threads: fit.save(f"{folder.name}/{threads}.npz")

    def read() -> Callable[..., Any]:
        folder = tempfile.TemporaryDirectory()
        picture = np.random.default_rng(3).uniform(size=surface()[1].shape).astype(np.float32)
        for name in "abcd":
            impasto.io.write_png16(f"{folder.name}/{name}.png", picture)
        lights = painting(4)[0].rig
        return lambda threads: impasto.read_stack(folder.name, lights=lights, encoding="srgb")

    return {
        "fit_normals, robust": normals("rank"),
        "fit_normals, tukey": normals("tukey"),
        "fit_sbrdf, painting": sbrdf(),
        "fit_sbrdf, segment": sbrdf(pooling="segment"),
        "fit_sbrdf, pixel": sbrdf(pooling="pixel"),
        "fit_sbrdf, lafortune": lafortune,
        "fit_highlight": lobe,
        "predict": shown,
        "render": rendered,
        "integrate_normals": heights,
        "fit_reflectance": reflectance,
        "suggest_effort": suggested,
        "save": saved,
        "read_stack": read,
    }


def child(name: str) -> None:
    """Runs the call again and again until it is interrupted; one line per interruption."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    call = calls()[name]()
    print("ready", flush=True)
    for line in sys.stdin:
        if line.strip() == "end":
            return
        try:
            print("begun", flush=True)
            while True:
                call(threads=int(line))
        except KeyboardInterrupt:
            print(time.monotonic(), time.process_time(), flush=True)


def measure(name: str) -> list[dict[str, Any]]:
    """The waits of one call, on each number of threads; of what did not end in time, none."""
    process = subprocess.Popen(
        [sys.executable, __file__, "--child", name],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    # Whatever hangs is killed: reading then meets the end of the pipe.
    watch = threading.Timer(LIMIT, process.kill)
    watch.start()
    found = {}
    try:
        expect(process, "ready")
        for threads in THREADS:
            found[threads] = [interrupted(process, threads, moment) for moment in MOMENTS]
        process.communicate("end\n", timeout=LIMIT)
    except (BrokenPipeError, TimeoutError, subprocess.TimeoutExpired):
        print(f"{name}: not done after {LIMIT} s", file=sys.stderr)
    finally:
        watch.cancel()
        process.kill()
        process.wait()
    return [row(name, threads, found.get(threads, [])) for threads in THREADS]


def row(name: str, threads: int, waits: list[tuple[float, float]]) -> dict[str, Any]:
    """A line of the table; what was computed at worst is what was computed in the longest wait."""
    worst = max(waits, default=(None, None))
    return {
        "call": name,
        "threads": threads,
        "median_ms": milliseconds(np.median([wait for wait, _ in waits])) if waits else None,
        "worst_ms": milliseconds(worst[0]),
        "worst_busy_ms": milliseconds(worst[1]),
        "waits_and_busy_ms": [[milliseconds(part) for part in wait] for wait in waits],
    }


def interrupted(process: subprocess.Popen[str], threads: int, moment: float) -> tuple[float, float]:
    """Seconds from the signal to the end, on the clock and of all threads together."""
    assert process.stdin is not None
    process.stdin.write(f"{threads}\n")
    process.stdin.flush()
    expect(process, "begun")
    time.sleep(moment)
    used = processor(process.pid)
    sent = time.monotonic()
    process.send_signal(signal.SIGINT)
    stopped, after = map(float, expect(process).split())
    return stopped - sent, after - used


def expect(process: subprocess.Popen[str], word: str = "") -> str:
    """The next line of the child, which begins with a word; TimeoutError if there is none."""
    assert process.stdout is not None
    line = process.stdout.readline()
    if not line:
        raise TimeoutError
    assert line.startswith(word), line
    return line


def milliseconds(seconds: Any) -> float | None:
    return None if seconds is None else round(1e3 * float(seconds), 1)


def processor(pid: int) -> float:
    """Seconds that all threads of a process have computed (Linux)."""
    # What clock_getcpuclockid(3) makes of a process; /proc counts in hundredths only.
    return time.clock_gettime(~pid << 3 | 2)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--record", action="store_true", help="write benches/results/interrupt.json"
    )
    parser.add_argument("--child", help=argparse.SUPPRESS)
    parser.add_argument("--only", help="names that contain this")
    arguments = parser.parse_args()
    if arguments.child:
        return child(arguments.child)
    names = [name for name in calls() if arguments.only is None or arguments.only in name]
    rows = [row for name in names for row in measure(name)]
    lines = [{key: row[key] for key in row if key != "waits_and_busy_ms"} for row in rows]
    show("From Ctrl-C to KeyboardInterrupt, milliseconds", lines)
    if arguments.record:
        content = {"run": run_info("python benches/python/interrupt.py --record"), "waits": rows}
        print(f"\nwrote {write('interrupt.json', content)}")
    if any(row["median_ms"] is None for row in rows):
        sys.exit(1)
    return None


if __name__ == "__main__":
    main()
