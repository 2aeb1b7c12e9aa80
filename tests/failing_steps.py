"""Disks that fail: ``python tests/failing_steps.py [--record]`` lets every step of a job fail once.

A step is a call of the system by which something gets onto the disk: an opening, a write, a flush,
a rename, a new folder, a removal, a link. The k-th of them raises ``OSError`` (the disk is full, or
its electronics fail), for every k, and all goes on as before. What must hold then:

* the call ends with this error, which names a file, or with a result, where the step was one that
  nothing depends on (what is left over is removed at the next call);
* the result has its old bytes, or its new ones, or it is not there;
* nothing else is left: no temporary file, no folder but that of a job, which can be resumed;
* the same call made once more gives the bytes of one that did not fail.
"""

from __future__ import annotations

import argparse
import builtins
import errno
import hashlib
import io
import os
import shutil
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import impasto
from impasto import jobs, simulate
from killed_jobs import tree
from recorded_faults import recorded

STEPS = ("open", "fsync", "replace", "rename", "mkdir", "unlink", "rmdir", "link", "truncate")
"""Functions of ``os``; writes come on top."""
LOCKS = {"job/lock", "merge/lock"}
FIRST = 3
"""Steps that make the folder of a store and that of its notes: the first try fails by itself."""
LAST = 4
"""Steps of a store from its last name on: rename, the end of its lock, two flushed folders."""
ERRORS = (errno.ENOSPC, errno.EIO)
NAMES = {
    "run .zarr": "a job",
    "resume .zarr": "a damaged job goes on",
    "merge .zarr": "a merge",
    "ingest .zarr": "ingest",
    "save .zarr": "save, a store",
    "save .npz": "save, `.npz`",
    "learned .npz": "a learned model",
    "export .crate": "export",
    "height .tif": "height of a store",
    "render .tif": "picture of a store",
}
"""What the record calls the calls."""
OPTIONS: dict[str, Any] = {"pooling": "none", "normals": "least-squares", "tile": 16, "threads": 1}


@dataclass
class Steps:
    """Counts steps below a folder; one of them fails.

    Attributes
    ----------
    folder
        Of other files no step is counted.
    failing
        The number of the step that fails, from 1 on; 0: none. Or what it is, and its number
        among those of its kind: threads that make the same folders take a step more or less.
    error
        Its error.
    taken
        Steps so far.
    failed
        Name of the step that failed, and what it was about.
    """

    folder: Path
    failing: int | tuple[str, int] = 0
    error: int = errno.EIO
    taken: list[str] = field(default_factory=list)
    failed: str = ""
    lock: threading.Lock = field(default_factory=threading.Lock)
    handles: dict[int, str] = field(default_factory=dict)

    def step(self, name: str, file: Any) -> None:
        """One more; raises if it is the one that fails."""
        named = self.handles.get(file) if isinstance(file, int) else os.fspath(file)
        if not isinstance(named, str) or not named.startswith(str(self.folder)):
            return
        with self.lock:
            path = Path(named).relative_to(self.folder)
            # Names of temporary files are random.
            parts = ("." if part.startswith(".") else part for part in path.parts)
            kind = f"{name} {'/'.join(parts)}"
            self.taken.append(kind)
            if self.failing not in (len(self.taken), (kind, self.taken.count(kind))):
                return
            self.failed = f"{name} {path}"
        # What is about a handle names no file, as in reality.
        about = () if isinstance(file, int) else (named,)
        raise OSError(self.error, os.strerror(self.error), *about)


@contextmanager
def counted(steps: Steps) -> Iterator[Steps]:
    """While the block runs, every step is counted."""
    own = {name: getattr(os, name) for name in STEPS}
    duplicate, opened = os.dup, io.open

    class File(io.FileIO):
        def write(self, data: Any) -> int:
            steps.step("write", os.fspath(self.name))
            return super().write(data)

    def instead(name: str) -> Callable[..., Any]:
        def call(file: Any, *given: Any, **options: Any) -> Any:
            reads = name == "open" and not given[0] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
            if not reads:
                steps.step(name, file)
            found = own[name](file, *given, **options)
            if name == "open":
                steps.handles[found] = os.fspath(file)
            return found

        return call

    def dup(handle: int) -> int:
        found = duplicate(handle)
        if handle in steps.handles:
            steps.handles[found] = steps.handles[handle]
        return found

    def open_file(
        file: Any, mode: str = "r", buffering: int = -1, *given: Any, **options: Any
    ) -> Any:
        if isinstance(file, int) or not set(mode) & set("wxa+"):
            return opened(file, mode, buffering, *given, **options)
        steps.step("open", file)
        raw = File(file, mode.replace("b", "").replace("t", ""))
        steps.handles[raw.fileno()] = os.fspath(file)
        if buffering == 0:
            return raw
        buffered = io.BufferedRandom(raw) if "+" in mode else io.BufferedWriter(raw)
        return buffered if "b" in mode else io.TextIOWrapper(buffered, encoding="utf-8")

    patched = {os: {n: instead(n) for n in STEPS} | {"dup": dup}, io: {"open": open_file}}
    patched[builtins] = {"open": open_file}
    kept = [(module, n, getattr(module, n)) for module, names in patched.items() for n in names]
    try:
        for module, names in patched.items():
            for name, function in names.items():
                setattr(module, name, function)
        yield steps
    finally:
        for module, name, function in kept:
            setattr(module, name, function)


# --- what is done


def stack() -> impasto.Stack:
    """Five photographs of 24 x 26 pixels: two by two tiles, three of them cut off."""
    lights = [(0.5, 0, 0.9), (0, 0.5, 0.9), (-0.5, 0, 0.9), (0, -0.5, 0.9), (0, 0, 1)]
    samples = np.random.default_rng(1).uniform(0.2, 0.9, (5, 1, 24, 26)).astype(np.float32)
    return impasto.Stack(samples, lights=lights)


class Call(NamedTuple):
    """What writes a file or a folder of a name, and what must be there before."""

    write: Callable[[Path], object]
    prepare: Callable[[Path], object] = lambda out: None


def unfinished(out: Path) -> None:
    """A job of three tiles of four; a file, the numbers and the end of its journal are damaged."""

    def stop(done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with suppress(KeyboardInterrupt):
        impasto.run(stack(), out, progress=stop, **OPTIONS)
    partial = out.with_name(f"{out.name}.partial")
    for name in ("normal/c/0/0/1", "job/numbers.npz"):
        data = bytearray((partial / name).read_bytes())
        data[len(data) // 2] ^= 1
        (partial / name).write_bytes(data)
    with (partial / "job" / "journal.jsonl").open("ab") as journal:
        journal.write(b'{"estimated": 1')
    (partial / "normal" / "c" / "0" / "0" / ".1-1ef7.tmp").write_bytes(b"half")


def calls(folder: Path) -> dict[str, Call]:
    """Calls by kind and suffix; what they need is made in ``folder``."""
    taken = stack()
    result = impasto.fit_sbrdf(taken, pooling="painting", check=False)
    job = impasto.run(taken, folder / "job.zarr", **OPTIONS)
    opened = impasto.open_sbrdf(job)
    scene = impasto.Scene(lights=[impasto.DistantLight((0.5, 0, 0.9))])
    model = impasto.learn_sbrdf(taken, pooling="painting")
    painting = simulate.default_capture("tominaga-rgb-camera", size=(64, 112)).stack
    whole = impasto.fit_sbrdf(painting, pooling="painting", check=False)
    frames = [whole[:, :72], whole[:, 40:]]

    return {
        "run .zarr": Call(lambda out: impasto.run(taken, out, **OPTIONS)),
        "resume .zarr": Call(lambda out: impasto.run(taken, out, **OPTIONS), unfinished),
        "merge .zarr": Call(lambda out: impasto.merge(frames, out, tile=64)),
        "ingest .zarr": Call(lambda out: jobs.ingest(taken, out, tile=16)),
        "save .zarr": Call(result.save),
        "save .npz": Call(result.save),
        "learned .npz": Call(model.save),
        "export .crate": Call(lambda out: jobs.export_ro_crate(job, out)),
        "height .tif": Call(lambda out: opened.height(out, threads=1)),
        "render .tif": Call(lambda out: opened.render(scene, out, threads=1)),
    }


# --- what is seen


@dataclass
class Seen:
    """What came of the steps of a call.

    Attributes
    ----------
    steps
        How many the call takes.
    endings
        How often a failed step ended the call, and how often not.
    ignored
        Steps whose failure did not matter, by their names.
    faults
        What must not be.
    """

    steps: int = 0
    endings: Counter[str] = field(default_factory=Counter)
    ignored: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)


def tried(call: Call, suffix: str, folder: Path, every: int = 1) -> Seen:
    """Let every step of a call fail, or every n-th, and the first and last ones."""
    seen = Seen()
    one = folder / "one"
    out = one / f"a{suffix}"
    one.mkdir()
    call.prepare(out)
    with counted(Steps(one)) as steps:
        call.write(out)
    taken = steps.taken
    seen.steps = len(taken)
    expected = content(out)
    early = sorted({*range(1, FIRST + 1), *range(1, max(seen.steps - LAST, 0) + 1, every)})
    last = range(max(seen.steps - LAST, 0), seen.steps)
    chosen = [*early, *((taken[k], taken[: k + 1].count(taken[k])) for k in last)]
    for k, failing in enumerate(chosen):
        shutil.rmtree(one)
        one.mkdir()
        call.prepare(out)
        _one(call.write, out, Steps(one, failing, ERRORS[k % 2]), expected, seen)
    shutil.rmtree(one)
    return seen


def row_of(call: str, seen: Seen) -> dict[str, Any]:
    """A row of the record."""
    return {
        "call": call,
        "tried": sum(seen.endings.values()),
        "steps": seen.steps,
        "errors": seen.endings["the error"],
        "results": seen.endings["a result"],
        "unreached": seen.endings["not reached"],
        "faults": len(seen.faults),
    }


def content(path: Path) -> dict[str, str]:
    """The bytes of a file, or of all files of a folder."""
    if path.is_dir():
        return tree(path)
    return {"": hashlib.sha256(path.read_bytes()).hexdigest()}


def _one(
    call: Callable[[Path], object],
    out: Path,
    steps: Steps,
    expected: dict[str, str],
    seen: Seen,
) -> None:
    def wrong(words: str) -> None:
        seen.faults.append(f"{steps.failed}: {words}")

    ended: BaseException | None = None
    earlier = _hidden(out.parent)
    try:
        with counted(steps):
            call(out)
    except OSError as error:
        ended = error
        if error.errno != steps.error or not str(error.filename or "").startswith(str(out.parent)):
            wrong(f"the error is {error!r} about {error.filename}")
        elif Path(error.filename) not in earlier and any(
            part.startswith(".") for part in Path(error.filename).relative_to(out.parent).parts
        ):
            wrong(f"the error names a temporary file, {error.filename}")
    except Exception as error:
        ended = error
        wrong(f"the error is {error!r}")
    if not steps.failed:
        seen.endings["not reached"] += 1  # threads: another call may take a step less
    elif ended is None:
        seen.endings["a result"] += 1
        seen.ignored[steps.failed.split()[0]] += 1
    else:
        seen.endings["the error"] += 1
    # A finished store loses its lock after it got its name; the next call takes it away.
    if out.exists() and {n: c for n, c in content(out).items() if n not in LOCKS} != expected:
        wrong("something is there that is not whole")
    if ended is None and not out.exists():
        wrong("there is no error, and no result")
    left = _hidden(out.parent) - earlier
    left |= {path for path in out.parent.iterdir() if not _named(path, out)}
    litter = sorted(path.relative_to(out.parent).as_posix() for path in left)
    if litter:
        wrong(f"is left: {litter}")
    try:
        with suppress(impasto.ArgumentError) if out.exists() else nullcontext():
            call(out)  # a store that is there may be refused: only its last flush failed
        if content(out) != expected:
            wrong("the next call gives other bytes")
    except Exception as error:
        wrong(f"the next call ends with {error!r}")
    if others := [path.name for path in out.parent.iterdir() if path != out]:
        wrong(f"is left by the next call: {others}")


def _hidden(folder: Path) -> set[Path]:
    """Temporary files and folders."""
    return {path for path in folder.rglob("*") if path.name.startswith(".")}


def _named(path: Path, out: Path) -> bool:
    return path.name in {out.name, out.name + ".partial"}


def main() -> int:
    """Try all calls, or those that are named; 1 if there is a fault."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("calls", nargs="*", help="default: all")
    options.add_argument("--every", type=int, default=1, help="every n-th step")
    options.add_argument("--record", action="store_true")
    chosen = options.parse_args()
    faults = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        known = calls(folder)
        for one, call in known.items():
            kind, suffix = one.split()
            if chosen.calls and one not in chosen.calls and kind not in chosen.calls:
                continue
            began = time.monotonic()
            (folder / kind).mkdir(exist_ok=True)
            seen = tried(call, suffix, folder / kind, chosen.every)
            faults += len(seen.faults)
            endings = ", ".join(f"{count} x {what}" for what, count in seen.endings.items())
            ignored = ", ".join(f"{count} x {what}" for what, count in seen.ignored.items())
            sys.stdout.write(
                f"{one}: {seen.steps} steps, {time.monotonic() - began:.0f} s: {endings}"
                f"{f' (of {ignored})' if ignored else ''}, {len(seen.faults)} faults\n"
            )
            if chosen.record:
                command = " ".join(["python tests/failing_steps.py", *sys.argv[1:]])
                recorded("steps", [row_of(NAMES[one], seen)], command)
            for fault in seen.faults[:20]:
                sys.stdout.write(f"  {fault}\n")
            sys.stdout.flush()
    return int(faults > 0)


if __name__ == "__main__":
    raise SystemExit(main())
