"""The journal of a study: a file with one line per run, so that an interrupted study continues.

A journal has sections. Each begins with a head: what its runs have in common. A study that goes on
under what changes its times (another machine, other threads) opens a section of its own and times
everything anew; back on the first machine it goes on in the sections of that one. The first line of
a run says all of it, each of the others what one more timing took.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from impasto import _core
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.files import atomic_bytes
from study.timing import Timing, pace, steadiness, uncertain, unit

SCHEMA = 5
RUNS = "runs.jsonl"

TERMS = ("commit", "impasto", "seed", "quick", "sizes")
"""What errors depend on; a folder holds runs with one value of each."""
CLOCKS = ("processor", "cores", "simd", "python", "numpy", "threads", "repeats", "data")
"""What times depend on, and the data."""


def run_info() -> dict[str, Any]:
    """Machine and versions; the commit where the package runs from a checkout."""
    return {
        "commit": _commit(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "simd": _core.build_info()["simd"],
        "python": sys.version.split()[0],
        "numpy": np.__version__,
        "impasto": _core.build_info()["version"],
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _commit() -> str | None:
    here = Path(__file__).resolve().parent

    def git(*arguments: str) -> str:
        done = subprocess.run(
            ["git", *arguments], cwd=here, capture_output=True, text=True, check=False
        )
        return done.stdout.strip() if done.returncode == 0 else ""

    try:
        top = git("rev-parse", "--show-toplevel")
        # An installed package may lie inside somebody else's repository.
        if not top or not (Path(top) / "crates" / "impasto").is_dir():
            return None
        measured = ("--", f"{top}/crates", f"{top}/python")
        changed = "+" if git("status", "-s", "-uno", *measured) else ""
        return git("log", "-1", "--format=%h", *measured) + changed
    except OSError:
        return None


def check_folder(folder: Path) -> None:
    """Refuse a folder with other files; a study's folder has a journal.

    Raises
    ------
    ArgumentError
        It holds files and no journal, or is a file itself.
    """
    if folder.is_dir():
        if any(folder.iterdir()) and not (folder / RUNS).is_file():
            raise ArgumentError(
                f"out: {folder} holds files that no study made; name another folder"
            )
    elif folder.exists():
        raise ArgumentError(f"out: {folder} is a file; name a folder")


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Lock a folder for one study; it is created if necessary.

    A process that ends, even killed, lets go of it. Windows and some file systems lock no folders:
    there nobody is kept out.

    Raises
    ------
    ArgumentError
        Another study is at work there.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if sys.platform == "win32":
        yield
        return
    import fcntl

    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ArgumentError(
                f"out: another study is at work in {folder}; wait for it or choose another folder"
            ) from None
        except OSError:
            pass
        yield
    finally:
        os.close(handle)


class Journal:
    """The runs of one study in a folder, one JSON object a line.

    Parameters
    ----------
    folder
        Made if it is not there.
    head
        What the runs have in common: under ``run`` what ran where.
    terms
        Names of what must be the same under ``run`` for a study to go on.
    clocks
        Names of what must be the same for two runs' times to be compared; runs under others stay in
        the file, and are left out. Without a ``head`` the folder holds a study, which is only read:
        its last section and those like it.
    """

    def __init__(
        self,
        folder: Path,
        head: dict[str, Any] | None = None,
        terms: Sequence[str] = (),
        clocks: Sequence[str] = CLOCKS,
    ) -> None:
        self.path = folder / RUNS
        lines = list(self._lines()) if head is None or self.path.exists() else []
        heads = [line for line in lines if "schema" in line]
        known = all(
            head["schema"] == SCHEMA
            and isinstance(head.get("run"), dict)
            and isinstance(head.get("missing"), dict)
            for head in heads
        )
        if lines and (lines[0] not in heads or not known):
            raise CorruptInputError(self.path, "is no journal of a study that this version knows")
        if head is not None:
            head = {"schema": SCHEMA} | head
            for was in heads[:1]:
                self._check(was["run"], head["run"], terms)
            folder.mkdir(parents=True, exist_ok=True)
            if not heads or _under(heads[-1], clocks) != _under(head, clocks):
                lines.append(head)
            # A last line that was cut off by an interruption is written anew.
            whole = "".join(json.dumps(line) + "\n" for line in lines)
            atomic_bytes(self.path, whole.encode("utf-8"))
        if head is None and not heads:
            raise CorruptInputError(self.path, "is no journal of a study that this version knows")
        self.head = head or heads[-1]
        self.runs: dict[tuple[str, str, str], dict[str, Any]] = {}
        self._timings: dict[tuple[str, str, str], list[Timing]] = {}
        alike = False
        for number, line in enumerate(lines):
            try:
                if "schema" in line:
                    alike = _under(line, clocks) == _under(self.head, clocks)
                elif alike:
                    self._note(line)
            except (KeyError, TypeError) as error:
                raise self._no_run(number) from error

    def _check(self, was: dict[str, Any], now: dict[str, Any], terms: Sequence[str]) -> None:
        for term in terms:
            if was.get(term) != now[term]:
                raise ArgumentError(
                    f"out: {self.path} holds runs of another study ({term} {was.get(term)!r}, now "
                    f"{now[term]!r}); choose another folder or remove that file"
                )

    def found(self) -> dict[str, Any]:
        """``run``, ``missing``, ``skipped`` and ``failed`` (settings and why), ``rows``."""
        rows = list(self.runs.values())
        every = [timing for timings in self._timings.values() for timing in timings]
        seconds = unit(every) if every else {}
        return {
            "run": self.head["run"] | ({"reference fit": steadiness(every)} if every else {}),
            "missing": self.head["missing"],
            "skipped": sorted({f"{r['setting']}: {r['skipped']}" for r in rows if "skipped" in r}),
            "failed": sorted(
                {f"{r['setting']} on {r['data']}: {r['failed']}" for r in rows if "failed" in r}
            ),
            "rows": [self._row(row, seconds) for row in rows if "timing" in row],
        }

    def _row(self, run: dict[str, Any], seconds: dict[str, float]) -> dict[str, Any]:
        """A run with its cost, the error of the cost, and the number of timings."""
        timings = self._timings[key_of(run)]
        paces = {kind: pace(timings, kind) for kind in seconds}
        cost = {kind: paces[kind][0] * seconds[kind] for kind in seconds}
        doubt = paces["cpu"][1] if len(timings) > 1 else None
        row = {"cost": cost, "doubt": doubt, "timings": len(timings)}
        return {name: run[name] for name in run if name != "timing"} | row

    def timings(self, run: dict[str, Any]) -> int:
        """How often a run was timed; for a skipped one a very large number."""
        key = key_of(run)
        return (
            sys.maxsize if "skipped" in self.runs.get(key, {}) else len(self._timings.get(key, ()))
        )

    def wants(self, run: dict[str, Any], repeats: int, *, surely: bool) -> bool:
        """Whether a run needs another timing: until its cost is certain, else ``repeats`` times."""
        taken = self._timings.get(key_of(run), [])
        more = uncertain(taken, repeats) if surely else len(taken) < repeats
        return more and self.timings(run) < sys.maxsize

    def _lines(self) -> Iterator[dict[str, Any]]:
        lines = self.path.read_text(encoding="utf-8", errors="replace").splitlines()
        for number, line in enumerate(lines):
            try:
                found = json.loads(line)
            except json.JSONDecodeError as error:
                # A line that was cut off by an interruption; not so the first, which is written
                # whole.
                if number and number == len(lines) - 1:
                    return
                raise CorruptInputError(self.path, f"line {number + 1} is no JSON") from error
            if not isinstance(found, dict):
                raise self._no_run(number)
            yield found

    def _no_run(self, number: int) -> CorruptInputError:
        return CorruptInputError(self.path, f"line {number + 1} is no run of a study")

    def add(self, run: dict[str, Any]) -> None:
        """Record a run; it is on the disk when this returns."""
        self._note(run)
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(run, allow_nan=False) + "\n")

    def _note(self, run: dict[str, Any]) -> None:
        key = key_of(run)
        if "again" in run:
            self._timings[key].append(Timing(**run["again"]))
        else:
            self.runs[key] = run
            self._timings[key] = [Timing(**run["timing"])] if "timing" in run else []


def _under(head: dict[str, Any], terms: Sequence[str]) -> list[Any]:
    return [head["run"].get(term) for term in terms]


def digest(path: Path) -> str:
    """The first 16 digits of the SHA-256 of a file, or of all files of a folder."""
    found = hashlib.sha256()
    for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
        if file.is_file():
            found.update(file.name.encode())
            found.update(file.read_bytes())
    return found.hexdigest()[:16]


def key_of(run: dict[str, Any]) -> tuple[str, str, str]:
    """Data set, knob and setting."""
    return run["data"], run["knob"], run["setting"]
