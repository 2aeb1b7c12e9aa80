"""A job is seen, held and ended from its first moment: while its photographs are still hashed."""

from __future__ import annotations

import errno
import os
import signal
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import dask.array
import pytest

import impasto
from impasto import ArgumentError, CorruptInputError, GeometryError, ResumeMismatchError, jobs
from impasto.cli import main
from impasto.jobs import photographs as reading
from impasto.jobs.beginning import held
from interrupted_jobs import interrupting
from job_photographs import photographs
from killed_jobs import in_child, stack, tree

pytest.importorskip("fcntl", reason="jobs need POSIX")

OPTIONS: dict[str, Any] = {"pooling": "none", "tile": 32, "memory": "1MB", "sample": 1}
HELD = ("lock", "reading.jsonl")
"""Files of a job that has just begun."""
HASHES = reading.file_entries
"""What hashes the photographs of a job."""


def while_hashing(act: Callable[[int, int], object]) -> Callable[..., list[dict[str, Any]]]:
    """Hash files, and do this whenever some of them has been read."""

    def instead(
        paths: Sequence[Path], report: Callable[[int, int], object], *more: Any
    ) -> list[dict[str, Any]]:
        def told(done: int, total: int) -> None:
            report(done, total)
            act(done, total)

        return HASHES(paths, told, *more)

    return instead


def begun(path: Path, out: Path) -> Path:
    return impasto.run(path, out, **OPTIONS)


def test_a_job_is_seen_while_its_photographs_are_hashed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = photographs(tmp_path), tmp_path / "painting.zarr"
    seen: list[jobs.JobStatus] = []
    said: list[str] = []

    def look(done: int, total: int) -> None:
        seen.append(jobs.status(out))
        if done == 0:
            assert main(["job", "status", str(out)]) == 0
            said.append(capsys.readouterr().out)

    monkeypatch.setattr(reading, "file_entries", while_hashing(look))
    monkeypatch.setattr("impasto.jobs.beginning.OFTEN", -1.0)
    begun(path, out)
    size = sum(file.stat().st_size for file in [path, *tmp_path.glob("*.tif")])
    assert {(one.state, one.process, one.phase) for one in seen} == {
        ("running", os.getpid(), "reading")
    }
    # One line for each file, none of which is larger than what is hashed at a time.
    assert [one.bytes_read for one in seen] == sorted(one.bytes_read or 0 for one in seen)
    assert (seen[0].bytes_read, seen[-1].bytes_read, len(seen)) == (0, size, 14)
    assert {one.bytes_to_read for one in seen} == {size}
    assert "reading the photographs" in said[0]
    assert f"0 of {size / 1e9:.3g} GB, 0 %" in said[0]
    assert "tiles" not in said[0], "how many there are is not known yet"
    assert not (out / "job" / "reading.jsonl").exists()
    assert jobs.verify(out) == ()


def test_a_job_that_goes_on_is_seen_while_its_photographs_are_hashed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, out = photographs(tmp_path), tmp_path / "painting.zarr"
    with interrupting(2) as stop:
        impasto.run(path, out, progress=stop, **OPTIONS)
    seen: list[jobs.JobStatus] = []
    look = while_hashing(lambda done, total: seen.append(jobs.status(out)))
    monkeypatch.setattr(reading, "file_entries", look)
    jobs.resume(out, memory="4MB")
    assert {(one.state, one.phase, one.tiles_done) for one in seen} == {("running", "reading", 2)}


def test_a_second_run_is_refused_before_it_reads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, out = photographs(tmp_path), tmp_path / "painting.zarr"
    refused = []

    def second(done: int, total: int) -> None:
        if done == 0:
            with pytest.raises(ArgumentError, match="in use by another job") as told:
                begun(path, out)
            refused.append(str(told.value))
            for call in (jobs.verify, jobs.resume):
                with pytest.raises(ArgumentError, match="has just begun: process"):
                    call(out)

    monkeypatch.setattr(reading, "file_entries", while_hashing(second))
    begun(path, out)
    assert len(refused) == 1, "and the one that is refused hashes nothing"


@pytest.mark.parametrize("fault", ["cut", "gone", "mask", "memory"])
def test_a_call_that_is_refused_leaves_nothing(fault: str, tmp_path: Path) -> None:
    path, out = photographs(tmp_path), tmp_path / "painting.zarr"
    options = dict(OPTIONS)
    if fault == "cut":
        (tmp_path / "light3.tif").write_bytes((tmp_path / "light3.tif").read_bytes()[:5000])
    elif fault == "gone":
        for photograph in tmp_path.glob("*.tif"):
            photograph.unlink()
    elif fault == "mask":
        options["reading"] = {"mask": "nowhere.png"}
    else:
        options |= {"memory": "1KB", "tile": None}
    before = tree(tmp_path)
    with pytest.raises((ArgumentError, CorruptInputError, OSError)):
        impasto.run(path, out, **options)
    assert tree(tmp_path) == before
    assert not out.with_name("painting.zarr.partial").exists()


def test_ctrl_c_while_photographs_are_hashed_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread that hashes ends at once, wherever the first pass is interrupted."""
    path, out = photographs(tmp_path), tmp_path / "painting.zarr"
    before = tree(tmp_path)

    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("impasto.jobs.learning.learn_sbrdf", interrupted)
    # Hashing would not end by itself: it waits until it is told that nobody waits for it.
    monkeypatch.setattr(reading, "file_entries", _for_ever)
    with pytest.raises(KeyboardInterrupt):
        begun(path, out)
    assert tree(tmp_path) == before
    assert not out.with_name("painting.zarr.partial").exists()


def _for_ever(
    paths: Sequence[Path], report: Callable[[int, int], object], *_: Any
) -> list[dict[str, Any]]:
    while True:
        report(0, 1)


@pytest.mark.parametrize("when", ["before", "while"])
def test_photographs_that_cannot_be_hashed_end_the_learning(
    when: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The model is learned for hours, and nothing can come of it."""
    path, out = photographs(tmp_path), tmp_path / "painting.zarr"
    before = tree(tmp_path)
    learning = threading.Event()

    def unplugged(*_: Any) -> list[dict[str, Any]]:
        if when == "while":
            assert learning.wait(60.0)
        raise OSError(errno.EIO, os.strerror(errno.EIO), str(path))

    def learn(*_: Any, progress: bool | Callable[[int, int], object], **__: Any) -> None:
        learning.set()
        for _step in range(600):
            if callable(progress):
                progress(0, 1)
            time.sleep(0.01)
        pytest.fail("the model is learned to the end")

    monkeypatch.setattr("impasto.jobs.learning.learn_sbrdf", learn)
    monkeypatch.setattr(reading, "file_entries", unplugged)
    with pytest.raises(OSError, match=r"Input/output error: '.*dirs\.lp'"):
        begun(path, out)
    assert tree(tmp_path) == before


def test_a_job_that_is_killed_while_it_hashes_can_be_begun_again(tmp_path: Path) -> None:
    path, out = photographs(tmp_path), tmp_path / "painting.zarr"
    expected = tree(begun(path, tmp_path / "whole.zarr"))

    def kill(done: int, total: int) -> None:
        if done:
            os.kill(os.getpid(), signal.SIGKILL)

    def work() -> None:
        reading.file_entries = while_hashing(kill)  # type: ignore[assignment]  # in a child
        begun(path, out)

    assert in_child(work) == signal.SIGKILL
    for call in (jobs.status, jobs.resume, jobs.verify):
        with pytest.raises(ArgumentError, match="ended while its photographs were read"):
            call(out)
    # A call that is refused clears what the killed one left.
    with pytest.raises(ArgumentError, match="memory"):
        impasto.run(path, out, **OPTIONS | {"memory": "1KB", "tile": None})
    with pytest.raises(ArgumentError, match="does not exist"):
        jobs.status(out)
    assert in_child(work) == signal.SIGKILL
    assert tree(begun(path, out)) == expected


def test_a_photograph_that_changes_while_it_is_hashed_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The hash may be that of the new file, and what was learned that of the old one."""
    path, out = photographs(tmp_path), tmp_path / "painting.zarr"
    (tmp_path / "new.tif").write_bytes((tmp_path / "light4.tif").read_bytes())

    def change(done: int, total: int) -> None:
        if done == 0:  # at once: the photographs are read by another thread meanwhile
            (tmp_path / "new.tif").replace(tmp_path / "light3.tif")

    monkeypatch.setattr(reading, "file_entries", while_hashing(change))
    with pytest.raises(ResumeMismatchError, match=r"light3\.tif has changed while the job ran"):
        begun(path, out)
    assert not out.exists()


def test_a_photograph_that_is_edited_and_keeps_its_date_has_changed(tmp_path: Path) -> None:
    path = photographs(tmp_path)
    opened = reading.open_photographs(path, {}, 1, None)
    opened.inputs()
    file = tmp_path / "light3.tif"
    before = file.stat()
    with file.open("r+b") as content:
        content.seek(-8, os.SEEK_END)
        content.write(bytes(8))
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert opened.changed() == [file]


def test_a_disk_that_is_full_from_the_first_byte_on_is_left_without_traces(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There is room for the name of the lock, and none for what stands in it."""
    path = photographs(tmp_path)
    before = tree(tmp_path)

    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "pwrite", full)
    with pytest.raises(OSError, match="No space left"):
        begun(path, tmp_path / "painting.zarr")
    assert tree(tmp_path) == before
    assert not (tmp_path / "painting.zarr.partial").exists()


def test_what_is_no_progress_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="progress: expected True, False or a callable"):
        impasto.run(stack(), tmp_path / "a.zarr", **OPTIONS | {"progress": "yes"})
    assert list(tmp_path.iterdir()) == []


def discarded(out: Path, then: Callable[[], object]) -> None:
    """A job of lights that determine no normal; another process comes before it ends."""
    with held(out) as own:
        own.discard()
        then()
        raise GeometryError("lights: lie in one plane")


def test_a_folder_that_was_discarded_is_left_to_another_process(tmp_path: Path) -> None:
    out, notes = tmp_path / "painting.zarr", tmp_path / "b.zarr.partial" / "job"
    with ExitStack() as second:
        with pytest.raises(GeometryError):
            discarded(out, lambda: second.enter_context(held(out)))
        assert jobs.status(out).phase == "reading"
        assert set(tree(tmp_path)) == {f"{out.name}.partial/job/{n}" for n in HELD}
        with pytest.raises(ArgumentError, match="in use by another job"), held(out):
            pass
    with pytest.raises(GeometryError):
        discarded(tmp_path / "b.zarr", lambda: notes.mkdir(parents=True))
    assert notes.is_dir(), "the other one is about to lock it"


def test_what_is_no_job_is_not_written_into(tmp_path: Path) -> None:
    path, foreign = photographs(tmp_path), tmp_path / "painting.zarr.partial"
    foreign.mkdir()
    (foreign / "letter.txt").write_text("mine")
    before = tree(tmp_path)
    with pytest.raises(ArgumentError, match="is no job of impasto"):
        begun(path, tmp_path / "painting.zarr")
    assert tree(tmp_path) == before
    assert [one.name for one in foreign.iterdir()] == ["letter.txt"]


def test_what_is_no_photographs_is_refused_with_what_to_do(tmp_path: Path) -> None:
    samples = dask.array.from_array(stack().samples)
    lazy = impasto.LazyStack(samples, lights=stack().rig, scale=1 / 4095)
    with pytest.raises(ArgumentError, match=r"source: .*LazyStack; fit it by .*impasto ingest"):
        impasto.run(lazy, tmp_path / "a.zarr", pooling="none")  # type: ignore[arg-type]
    for other in (samples, stack().samples, None):
        with pytest.raises(ArgumentError, match=r"source: a job cannot read a .*; expected the"):
            impasto.run(other, tmp_path / "a.zarr", pooling="none")  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_a_process_that_was_forked_does_not_hold_a_job_that_has_ended(tmp_path: Path) -> None:
    """As ``multiprocessing`` forks one, which lives on where a job is interrupted."""
    path, out = photographs(tmp_path), tmp_path / "painting.zarr"
    children: list[int] = []

    def interrupt(done: int, _: int) -> None:
        if done and not children:
            child = os.fork()
            if child == 0:
                time.sleep(60.0)
                os._exit(0)
            children.append(child)
            raise KeyboardInterrupt

    try:
        with pytest.raises(KeyboardInterrupt):
            impasto.run(path, out, **OPTIONS | {"progress": interrupt})
        assert jobs.status(out).state == "interrupted"
        assert begun(path, out).is_dir()
    finally:
        for child in children:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
