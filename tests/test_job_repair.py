"""Finished jobs, damaged, foreign or of another version: what is made again, what refused."""

from __future__ import annotations

import errno
import hashlib
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import impasto
from impasto import CorruptInputError, ResumeMismatchError, jobs
from impasto.fit.learning import LearnedModel
from impasto.io import write_stack
from impasto.io.json_lines import JournalFile, opened_line, read_lines, sealed_line
from impasto.jobs.record import JobRecord
from killed_jobs import OPTIONS, stack, tree

pytest.importorskip("fcntl", reason="jobs need POSIX")


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished job of photographs in a file."""
    folder = tmp_path_factory.mktemp("store")
    write_stack(folder / "painting.npz", stack())
    return impasto.run(folder / "painting.npz", folder / "painting.zarr", **OPTIONS)


def test_lost_files_of_a_finished_store_are_made_again(store: Path, tmp_path: Path) -> None:
    # What the hint of ``impasto job verify`` says: under the name of an unfinished job.
    partial, out = tmp_path / "painting.zarr.partial", tmp_path / "painting.zarr"
    shutil.copytree(store, partial)
    expected = tree(partial)
    (partial / "normal/c/0/1/0").unlink()
    for name in ("diffuse/c/0/0/1", "zarr.json"):
        data = bytearray((partial / name).read_bytes())
        data[7] ^= 1
        (partial / name).write_bytes(data)
    shutil.rmtree(partial / "levels")
    jobs.resume(out)
    assert tree(out) == expected


def test_a_defect_in_one_tile_keeps_the_others(
    store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The numerics panic at the third tile; after it is mended, the job goes on."""
    source, out = store.with_name("painting.npz"), tmp_path / "painting.zarr"
    apply, fitted = LearnedModel.apply, 0

    def panics(*given: Any, **options: Any) -> Any:
        nonlocal fitted
        fitted += 1
        if fitted == 3:
            raise impasto.InternalError("a defect in impasto, please report it: tile")
        return apply(*given, **options)

    with monkeypatch.context() as patched:
        patched.setattr(LearnedModel, "apply", panics)
        with pytest.raises(impasto.InternalError, match="please report it: tile"):
            impasto.run(source, out, **OPTIONS)
    assert jobs.status(out).state == "interrupted"
    assert jobs.status(out).tiles_done == 2
    assert jobs.verify(out) == ()
    jobs.resume(out)
    assert {name for name in tree(out) if tree(out)[name] != tree(store)[name]} <= {"job/job.json"}


def test_a_foreign_journal_is_named_by_every_call(store: Path, tmp_path: Path) -> None:
    out = tmp_path / "painting.zarr"
    shutil.copytree(store, out)
    other = impasto.run(stack(), tmp_path / "other.zarr", tile=32, pooling="none")
    shutil.copy(other / "job/journal.jsonl", out / "job")
    for call in (
        jobs.status,
        jobs.resume,
        lambda out: jobs.export_ro_crate(out, tmp_path / "crate"),
    ):
        with pytest.raises(CorruptInputError, match=r"journal\.jsonl: is the journal of another"):
            call(out)
    assert not (tmp_path / "crate").exists()


def test_another_version_does_not_repeat_a_store(store: Path, tmp_path: Path) -> None:
    out = tmp_path / "painting.zarr"
    shutil.copytree(store, out)
    record = out / "job/job.json"
    record.write_bytes(replace(JobRecord.read(record), version="0.0.9").to_bytes())
    journal = out / "job/journal.jsonl"
    first, *others = journal.read_bytes().splitlines(keepends=True)
    content = opened_line(first) | {"job": hashlib.sha256(record.read_bytes()).hexdigest()}
    journal.write_bytes(sealed_line(content) + b"".join(others))
    with pytest.raises(ResumeMismatchError, match=r"painting\.zarr cannot be made .*'0\.0\.9'"):
        jobs.rerun(out, tmp_path / "again.zarr")
    assert not list(tmp_path.glob("again*"))


def test_a_crate_has_no_damaged_tile(store: Path, tmp_path: Path) -> None:
    """Lost or changed, of a tile or beside them: no crate is made, and the tile is named."""
    out = tmp_path / "painting.zarr"
    shutil.copytree(store, out)
    tile = r"is not whole \(the tile in row 1 and column 0\)"
    shard = out / "normal/c/0/1/0"
    data = bytearray(shard.read_bytes())
    data[len(data) // 2] ^= 4
    shard.write_bytes(data)
    with pytest.raises(CorruptInputError, match=rf"normal/c/0/1/0: {tile}: has changed: .*; impa"):
        jobs.export_ro_crate(out, tmp_path / "crate")
    shard.unlink()
    with pytest.raises(CorruptInputError, match=rf"normal/c/0/1/0: {tile}: is missing; impasto"):
        jobs.export_ro_crate(out, tmp_path / "crate")
    (out / "beta/zarr.json").write_text("{}")
    with pytest.raises(CorruptInputError, match=r"zarr.json: is not whole: .*; so is 1 more file"):
        jobs.export_ro_crate(out, tmp_path / "crate")
    assert not (tmp_path / "crate").exists()


def test_a_crate_has_no_file_of_others(store: Path, tmp_path: Path) -> None:
    out = tmp_path / "painting.zarr"
    shutil.copytree(store, out)
    foreign = [out / ".DS_Store", out / "normal" / "notes.txt"]
    for path in foreign:
        path.write_bytes(b"of somebody else")
    with pytest.raises(CorruptInputError, match=r"\.DS_Store: does not .*; nor does 1 more file"):
        jobs.export_ro_crate(out, tmp_path / "crate")
    assert not (tmp_path / "crate").exists()
    for path in foreign:
        path.unlink()
    # What a process leaves that is killed in its last step is no part of the result.
    (out / "job" / "lock").touch()
    crate = jobs.export_ro_crate(out, tmp_path / "crate")
    assert tree(crate / "painting.zarr") == tree(store)


def test_a_job_of_another_format_says_what_to_do(store: Path, tmp_path: Path) -> None:
    out = tmp_path / "painting.zarr"
    shutil.copytree(store, out)
    record = out / "job/job.json"
    record.write_text(record.read_text().replace('"format": 2', '"format": 0'))
    with pytest.raises(CorruptInputError, match=r"has the format 0, .* use the version that made"):
        jobs.status(out)


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """No file of this process grows further: a disk that is full, and stays so."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_journal_on_a_disk_that_stays_full_names_its_file_and_can_go_on(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    journal = JournalFile(path, 0, {"job": "a"})
    journal.append({"tile": 1})
    whole = path.read_bytes()
    with files_of_at_most(len(whole) + 5):
        # Half a line fits.
        with pytest.raises(OSError, match=re.escape(str(path))) as error:
            journal.append({"tile": 2})
        assert error.value.errno == errno.EFBIG
        other = JournalFile(path, len(whole), {})
        with pytest.raises(OSError, match=re.escape(str(path))):
            other.append({"tile": 2})
        other.close()
    journal.append({"tile": 3})
    journal.close()
    found: list[object] = []
    read_lines(path, lambda content, _: found.append(content))
    assert found == [{"job": "a"}, {"tile": 1}, {"tile": 3}]
