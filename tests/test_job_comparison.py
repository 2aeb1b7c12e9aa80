"""How much of a comparison of files is done, as a job and its crate tell it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import impasto
from impasto import jobs
from impasto.cli import main
from impasto.io import write_stack
from impasto.jobs import meter, verification
from impasto.jobs.journal import JOURNAL
from interrupted_jobs import interrupting
from killed_jobs import stack

pytest.importorskip("fcntl", reason="jobs need POSIX")


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("compared")
    write_stack(folder / "painting.npz", stack((40, 50)))
    return impasto.run(folder / "painting.npz", folder / "a.zarr", pooling="none", tile=32)


def reported(work: Callable[[Any], object]) -> list[tuple[int, int]]:
    """What a call reports, which begins with nothing, grows and ends with all."""
    seen: list[tuple[int, int]] = []
    work(lambda done, total: seen.append((done, total)))
    done = [one for one, _ in seen]
    assert done[0] == 0
    assert done == sorted(set(done))
    assert {total for _, total in seen} == {done[-1]}
    return seen


def size(folder: Path) -> int:
    """Bytes of the files of a store that have a checksum in its journal."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    return sum(path.stat().st_size for path in files if path.name != JOURNAL)


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every file is told, however soon it follows the one before."""
    monkeypatch.setattr(meter, "OFTEN", 0.0)


def test_a_comparison_tells_how_many_bytes_are_read(job: Path, tmp_path: Path) -> None:
    photographs = (job.parent / "painting.npz").stat().st_size
    seen = reported(lambda progress: jobs.verify(job, progress=progress))
    assert seen[1] == (photographs, photographs + size(job))
    assert seen[-1][0] == photographs + size(job)
    seen = reported(lambda progress: jobs.verify(job, inputs=False, progress=progress))
    assert seen[-1][0] == size(job)
    assert len(seen) > 20
    crate = tmp_path / "crate"
    seen = reported(lambda progress: jobs.export_ro_crate(job, crate, progress=progress))
    assert seen[-1][0] == size(job)


def test_missing_files_count_nothing_and_changed_ones_once(job: Path, tmp_path: Path) -> None:
    copy = tmp_path / "b.zarr"
    shutil.copytree(job, copy)
    shards = (path for path in (copy / "normal" / "c").rglob("*") if path.is_file())
    first, second = sorted(shards)[:2]
    first.unlink()
    second.write_bytes(second.read_bytes() + b"!")
    seen = reported(lambda progress: jobs.verify(copy, inputs=False, progress=progress))
    assert seen[-1][0] == size(copy)


def test_a_crate_that_exists_is_named_by_its_option(
    job: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "crate").mkdir()
    assert main(["job", "export", str(job), "--ro-crate", str(tmp_path / "crate")]) == 1
    assert f"--ro-crate: {tmp_path / 'crate'} already exists" in capsys.readouterr().err


def test_photographs_that_nobody_asked_for_are_not_opened(
    job: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They may lie on a disk that is not there any more."""

    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(verification, "_entries_of", refuse)
    assert jobs.verify(job, inputs=False) == ()
    with pytest.raises(PermissionError):
        jobs.verify(job)


@pytest.fixture
def unfinished(job: Path, tmp_path: Path) -> Path:
    """A job of which three of four tiles are done, on what is taken for a terminal."""
    with interrupting(3) as stop:
        impasto.run(
            job.parent / "painting.npz", tmp_path / "b.zarr", pooling="none", tile=32, progress=stop
        )
    return tmp_path / "b.zarr"


def test_a_job_that_goes_on_shows_that_it_compares_its_tiles(
    unfinished: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    jobs.resume(unfinished, progress=True)
    assert "comparing finished tiles" in capsys.readouterr().err


def test_the_command_shows_that_it_compares_the_tiles_of_a_job(
    unfinished: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert main(["job", "resume", str(unfinished)]) == 0
    assert "comparing finished tiles" in capsys.readouterr().err


def test_what_counts_tiles_is_not_told_of_bytes(unfinished: Path) -> None:
    seen: list[tuple[int, int]] = []
    jobs.resume(unfinished, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(3, 4), (4, 4)]
