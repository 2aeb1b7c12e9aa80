"""``job.json`` has a checksum of its own: until the journal begins, nothing else vouches for it."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import impasto
from failing_steps import OPTIONS
from impasto import CorruptInputError, ResumeMismatchError, jobs
from impasto.jobs.record import UNSEALED, JobRecord
from job_photographs import photographs
from killed_jobs import tree

pytest.importorskip("fcntl", reason="jobs need POSIX")


@pytest.fixture(scope="module")
def learning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a job that was interrupted while it learned: there is no journal yet."""
    folder = tmp_path_factory.mktemp("learning")
    path = photographs(folder)
    reading = {"mask": folder / "mask.png"}
    whole = impasto.run(path, folder / "whole.zarr", reading=reading, **OPTIONS)
    notes = folder / "a.zarr.partial" / "job"
    notes.mkdir(parents=True)
    shutil.copy(whole / "job" / "job.json", notes)
    return folder


def changed(record: Path, old: str, new: str) -> None:
    text = record.read_text()
    assert text.count(old) == 1, old
    record.write_text(text.replace(old, new))


@pytest.fixture
def copy(learning: Path, tmp_path: Path) -> Path:
    """The record of a copy of that job."""
    shutil.copytree(learning / "a.zarr.partial", tmp_path / "a.zarr.partial")
    return tmp_path / "a.zarr.partial" / "job" / "job.json"


def test_a_job_that_was_interrupted_while_it_learned_goes_on(copy: Path, learning: Path) -> None:
    assert jobs.verify(copy.parents[1]) == ()
    assert tree(jobs.resume(copy.parents[1])) == tree(learning / "whole.zarr")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"tile": 16', '"tile": 18'),
        ('"sample": 1', '"sample": 3'),
        ('"precision": "single",\n  "reading"', '"precision": "half",\n  "reading"'),
        ('"rounds": 2', '"rounds": 3'),
        ('mask.png"\n  }', 'nask.png"\n  }'),
        ('"tile": 16', '"tile":  16'),
        ('"format": 2', '"format": 1'),
    ],
)
def test_a_changed_record_is_found_before_there_is_a_journal(
    old: str, new: str, copy: Path
) -> None:
    changed(copy, old, new)
    (found,) = jobs.verify(copy.parents[1])
    assert str(found).startswith(f"{copy}: is not as it was written")
    for call in (jobs.status, jobs.resume):
        with pytest.raises(CorruptInputError, match=r"job\.json: is not as it was written; bring"):
            call(copy.parents[1])


def sealed(record: Path, **entries: Any) -> None:
    """Other entries, with the right checksum: somebody made it so."""
    content = replace(JobRecord.read(record), **entries)
    record.write_bytes(content.to_bytes())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("version", 1),
        ("source", 5),
        ("source", "a\0b"),
        ("reading", [1]),
        ("reading", {"mask": [[[[[[[[[1]]]]]]]]]}),
        ("encoding", ["srgb", "255"]),
        ("encoding", ["9.0", 255.0]),
        ("encoding", "srgb"),
        ("inputs", [{"file": "a", "sha256": "0"}]),
        ("inputs", [{"file": "a", "sha256": "0", "bytes": "7"}]),
        ("inputs", [{"file": 1, "sha256": "0", "bytes": 7}]),
        ("inputs", [{"file": "a", "bytes": 7}]),
        ("fit", [1]),
        ("shape", [12, 3, 26, True]),
        ("shape", [12, 3, 26]),
        ("tile", 0),
        ("sample", 2**40),
        ("precision", "double"),
        ("notes", [["a"]]),
    ],
)
def test_a_record_with_an_entry_that_no_job_writes_is_refused(
    name: str, value: Any, copy: Path
) -> None:
    sealed(copy, **{name: value})
    words = rf"job\.json: is no record of a job \({name}: found .*, which no job writes\)"
    for call in (jobs.status, jobs.resume):
        with pytest.raises(CorruptInputError, match=words):
            call(copy.parents[1])
    assert [one.file for one in jobs.verify(copy.parents[1])] == [str(copy)]


@pytest.mark.parametrize(
    ("entry", "change", "words"),
    [
        ("fit", None, r"fit: it has no 'effort'"),
        ("fit", {"effort": "x"}, "fit: "),
        ("fit", {"effort": {"rounds": -1}}, r"fit: rounds: expected 0"),
        ("fit", {"model": "phong"}, r"fit: model: expected"),
        ("fit", {"more": 1}, r"fit: more: a job has no such option"),
        ("reading", {"mask": 5}, r"reading: mask: found 5"),
        ("reading", {"region": [1, 1, 4, 4]}, r"reading: .* no option 'region'"),
        ("reading", {"strict": False}, r"reading: one is not given"),
    ],
)
def test_a_job_does_not_go_on_with_options_that_no_job_has(
    entry: str, change: dict[str, Any] | None, words: str, copy: Path
) -> None:
    """They are those of this version; a finished store of another one may have others."""
    before = getattr(JobRecord.read(copy), entry)
    sealed(copy, **{entry: {} if change is None else {**before, **change}})
    assert jobs.status(copy.parents[1]).state == "interrupted"
    with pytest.raises(CorruptInputError, match=rf"job\.json: has options that .* \({words}"):
        jobs.resume(copy.parents[1])


def test_another_version_is_refused_before_anything_is_read(copy: Path) -> None:
    sealed(copy, version="0.0.9", source="/nowhere/dirs.lp", fit={}, reading={"new": 1})
    with pytest.raises(ResumeMismatchError, match=r"cannot be made .*'0\.0\.9'"):
        jobs.resume(copy.parents[1])


def test_a_record_without_a_checksum_is_read(copy: Path) -> None:
    """That of a store which was finished before records had one."""
    before = JobRecord.read(copy)
    sealed(copy, format=UNSEALED)
    assert "crc" not in json.loads(copy.read_text())
    assert JobRecord.read(copy) == replace(before, format=UNSEALED)
    assert JobRecord.read(copy).differences(before) == []
    assert jobs.status(copy.parents[1]).tiles == len(before.grid)
    changed(copy, f'"format": {UNSEALED}', f'"format": {UNSEALED + 1}')
    with pytest.raises(CorruptInputError, match="is not as it was written"):
        jobs.status(copy.parents[1])
