"""A pipe, a device or a folder in the place of a file of a job: no call waits for its other end."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import impasto
from failing_steps import OPTIONS, stack
from impasto import CorruptInputError, jobs
from impasto.io.json_lines import read_lines
from impasto.jobs.beginning import bytes_read
from impasto.jobs.checksums import read_checksums
from impasto.jobs.folder import NOTE_FILES
from impasto.jobs.journal import read_journal
from impasto.jobs.learning import digest_of
from impasto.jobs.lock import LOCK, holder, locked
from impasto.jobs.memory import kept_memory
from impasto.jobs.record import JobRecord
from interrupted_jobs import interrupting

pytest.importorskip("fcntl", reason="jobs need POSIX")
pytestmark = pytest.mark.timeout(60)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished store, and beside it an unfinished job of two tiles, ``half.zarr``."""
    folder = tmp_path_factory.mktemp("stores")
    with interrupting(2) as stop:
        impasto.run(stack(), folder / "half.zarr", progress=stop, **OPTIONS)
    return impasto.run(stack(), folder / "a.zarr", **OPTIONS)


def pipe(path: Path) -> None:
    path.unlink(missing_ok=True)
    os.mkfifo(path)


def folder(path: Path) -> None:
    path.unlink(missing_ok=True)
    path.mkdir()


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("make", [pipe, folder])
@pytest.mark.parametrize("name", NOTE_FILES)
def test_every_call_names_a_note_that_is_no_file(
    name: str, make: Callable[[Path], None], whole: bool, store: Path, tmp_path: Path
) -> None:
    out = tmp_path / "a.zarr"
    inside = out if whole else tmp_path / "a.zarr.partial"
    shutil.copytree(store if whole else store.with_name("half.zarr.partial"), inside)
    note = inside / "job" / name
    make(note)
    words = f"{name}: is a {make.__name__}, not a file"
    for call in (
        jobs.status,
        lambda out: jobs.resume(out, source=stack()),
        lambda out: impasto.run(stack(), out, **OPTIONS),
    ):
        with pytest.raises(CorruptInputError, match=words):
            call(out)
    (found,) = (one for one in jobs.verify(out) if one.file == str(note))
    assert words in str(found)


def test_files_of_maps_are_compared_beside_a_pipe(store: Path, tmp_path: Path) -> None:
    """In the place of each file in turn."""
    out = tmp_path / "a.zarr"
    shutil.copytree(store, out)
    for path in sorted(path for path in out.rglob("*") if path.is_file()):
        kept = path.rename(tmp_path / "kept")
        os.mkfifo(path)
        assert str(path) in {one.file for one in jobs.verify(out)}
        path.unlink()
        kept.rename(path)
    assert jobs.verify(out) == ()


def test_a_lock_that_is_a_pipe_ends_a_run_that_begins(tmp_path: Path) -> None:
    notes = tmp_path / "a.zarr.partial" / "job"
    notes.mkdir(parents=True)
    os.mkfifo(notes / LOCK)
    for call in (jobs.status, jobs.verify, jobs.resume, lambda out: impasto.run(stack(), out)):
        with pytest.raises(CorruptInputError, match="lock: is a pipe, not a file; remove it"):
            call(tmp_path / "a.zarr")


def hold(path: Path) -> None:
    with locked(path.parent):
        pass


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("job.json", JobRecord.read),
        ("journal.jsonl", read_journal),
        ("a.jsonl", lambda path: read_lines(path, lambda content, line: None)),
        ("checksums.json", read_checksums),
        ("learned.npz", digest_of),
        ("reading.jsonl", lambda path: bytes_read(path.parent)),
        (LOCK, lambda path: holder(path.parent)),
        (LOCK, hold),
    ],
)
def test_no_reader_waits_for_a_pipe(name: str, read: Any, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(CorruptInputError, match=f"{name}: is a pipe, not a file; remove it"):
        read(tmp_path / name)


def test_a_memory_that_is_a_pipe_is_not_known(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "memory.json")
    assert kept_memory(tmp_path) is None
