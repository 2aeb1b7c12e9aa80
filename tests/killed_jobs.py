"""Jobs that are killed on the way, and resumed: the same bytes as if nothing had happened.

``python tests/killed_jobs.py 100 [--record]`` kills a hundred at random times, and says what it
saw: stores of other bytes, and files of finished tiles that were lost or written again.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import impasto
from impasto import jobs
from recorded_faults import recorded

SIZE = (70, 90)
"""Two by two tiles of 64 pixels, three of them cut off by the border."""
OPTIONS: dict[str, Any] = {"pooling": "none", "tile": 64}
LARGE = (330, 390)
"""Six by seven tiles, many more than are in flight when a job is killed."""


@cache
def stack(size: tuple[int, int] = SIZE) -> impasto.Stack:
    """Twelve photographs of waves with a highlight and noise, three bands of 12 bits."""
    height, width = size
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:height, :width] / 7.0
    normal = np.stack([0.3 * np.sin(x), 0.3 * np.cos(x + y), np.ones(size)])
    normal /= np.linalg.norm(normal, axis=0)
    albedo = rng.uniform(0.2, 0.6, (3, 1, 1)) * (1.0 + 0.3 * np.sin(2.0 * x - y))
    around = np.arange(12) * (2.0 * np.pi / 12)
    across = np.where(np.arange(12) % 2, 0.5, 0.8)
    lights = np.stack([across * np.cos(around), across * np.sin(around), np.sqrt(1 - across**2)], 1)
    half = lights + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    facing, gloss = (np.maximum(np.tensordot(d, normal, 1), 0.0) for d in (lights, half))
    light = albedo * facing[:, None] + 0.4 * gloss[:, None] ** 40
    codes = 3000.0 * light + rng.normal(0.0, 4.0, light.shape)
    samples = np.clip(np.rint(codes), 0, 4095).astype(np.uint16)
    return impasto.Stack(samples, lights=lights, scale=1 / 4095, saturation=4095)


def tree(folder: Path) -> dict[str, str]:
    """The bytes of every file."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def count_steps(until: int, act: Callable[[], object]) -> list[int]:
    """From now on, ``act`` before one of the flushes and renames; they are listed by number."""
    steps: list[int] = []
    numbers = itertools.count(1)  # flushes come from several threads

    def counted(step: Any) -> Any:
        def instead(*args: Any, **options: Any) -> Any:
            number = next(numbers)
            steps.append(number)
            if number == until:
                act()
            return step(*args, **options)

        return instead

    for name in ("fsync", "replace", "rename"):
        setattr(os, name, counted(getattr(os, name)))
    return steps


def kill() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def in_child(work: Callable[[], object]) -> int:
    """Do something in a process of its own; the number of the signal that ended it, or 0."""
    process = os.fork()
    if process == 0:
        try:
            work()
            os._exit(0)
        except BaseException as error:
            sys.stderr.write(f"in the child: {error!r}\n")
            sys.stderr.flush()
            os._exit(1)
    _, state = os.waitpid(process, 0)
    if os.WIFSIGNALED(state):
        return os.WTERMSIG(state)
    assert os.WEXITSTATUS(state) == 0
    return 0


def written(partial: Path) -> dict[str, tuple[int, int]]:
    """Which files the journal of an interrupted job has, and when each was written."""
    journal = partial / "job" / "journal.jsonl"
    found: dict[str, tuple[int, int]] = {}
    for line in journal.read_bytes().splitlines() if journal.exists() else ():
        try:
            names = json.loads(line).get("shards", {})
        except ValueError:
            continue  # torn
        for name in names:
            about = (partial / name).stat()
            found[name] = about.st_ino, about.st_mtime_ns
    return found


def killed_and_resumed(out: Path, end: Callable[[], int]) -> tuple[int, dict[str, str]]:
    """The number of files that the killed job had finished, and the bytes of the resumed one.

    No finished file is written again.
    """
    assert end() == signal.SIGKILL
    partial = out.with_name(out.name + ".partial")
    # Killed after it had its name, a store is whole.
    before = written(out if out.exists() else partial)
    assert in_child(lambda: impasto.run(stack(), out, **OPTIONS)) == 0
    assert not partial.exists()
    for name, about in before.items():
        now = (out / name).stat()
        assert (now.st_ino, now.st_mtime_ns) == about, name
    return len(before), tree(out)


def at_steps(folder: Path, steps: list[int]) -> None:
    """Kill a job before each of these steps; prints what was seen."""
    stack()
    whole = folder / "whole.zarr"
    total = folder / "steps"

    def counted() -> None:
        found = count_steps(0, kill)
        impasto.run(stack(), whole, **OPTIONS)
        total.write_text(str(len(found)))

    assert in_child(counted) == 0
    expected, count = tree(whole), int(total.read_text())
    seen = []
    for step in steps:
        out = folder / f"killed-{step}.zarr"
        # The last ones are counted from the end.
        at = step if step > 0 else count + step

        def killed(at: int = at, out: Path = out) -> int:
            def work() -> None:
                count_steps(at, kill)
                impasto.run(stack(), out, **OPTIONS)

            return in_child(work)

        done, found = killed_and_resumed(out, killed)
        seen.append({"step": step, "done": done, "same": found == expected})
        shutil.rmtree(out)
    sys.stdout.write(json.dumps({"steps": count, "seen": seen}))


def at_random(folder: Path, count: int, seed: int) -> dict[str, Any]:
    """Kill a job at random times, again and again until it ends; what was seen."""

    def job(out: Path) -> object:
        return impasto.run(stack(LARGE), out, **OPTIONS)

    stack(LARGE)
    whole, out, rng = folder / "whole.zarr", folder / "killed.zarr", random.Random(seed)
    start = time.monotonic()
    assert in_child(lambda: job(whole)) == 0
    seconds = time.monotonic() - start
    expected, files = tree(whole), len(written(whole))
    kills = stores = different = again = 0
    shares: list[float] = []
    while kills < count:
        finished: dict[str, tuple[int, int]] = {}
        while not out.exists():
            killed = False
            if kills < count:
                process = os.fork()
                if process == 0:
                    job(out)
                    os._exit(0)
                time.sleep(rng.uniform(0.0, seconds))
                os.kill(process, signal.SIGKILL)
                _, state = os.waitpid(process, 0)
                killed = os.WIFSIGNALED(state)
            else:
                assert in_child(lambda: job(out)) == 0
            now = written(out if out.exists() else out.with_name(out.name + ".partial"))
            again += sum(now.get(name) != about for name, about in finished.items())
            finished = now
            if killed:
                kills += 1
                shares.append(len(now) / files)
        stores += 1
        different += tree(out) != expected
        assert jobs.verify(out) == ()
        shutil.rmtree(out)
    return {
        "jobs": stores, "kills": kills, "files": files, "different": different, "again": again,
        "share": float(np.mean(shares)),
    }  # fmt: skip


def main() -> int:
    """1 if a byte differs or a finished tile was made again."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kills", type=int)
    parser.add_argument("--record", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        seen = at_random(Path(made), options.kills, seed=20)
    sys.stdout.write(
        f"{seen['kills']} kills in {seen['jobs']} jobs: {seen['different']} stores differ, "
        f"{seen['again']} files of finished tiles were lost or written again; "
        f"{seen['share']:.0%} of {seen['files']} files were there after a kill, on average\n"
    )
    if options.record:
        command = f"python tests/killed_jobs.py {options.kills} --record"
        recorded("kills", [{"of": "jobs"} | seen], command)
    return int(bool(seen["different"] or seen["again"]))


if __name__ == "__main__":
    raise SystemExit(main())
