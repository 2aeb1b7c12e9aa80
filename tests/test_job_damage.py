"""Every change of a file of a job is found: by ``verify``, and where it goes on, by the job."""

from __future__ import annotations

import json
import os
import shutil
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from failing_steps import OPTIONS
from failing_steps import stack as small_stack
from impasto import ArgumentError, CorruptInputError, ResumeMismatchError, jobs
from impasto.io import write_stack
from impasto.io.json_lines import sealed_line
from impasto.jobs import journal, lookup
from impasto.jobs.record import JobRecord
from interrupted_jobs import interrupting
from job_photographs import photographs
from killed_jobs import tree

pytest.importorskip("fcntl", reason="jobs need POSIX")


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return impasto.run(small_stack(), tmp_path_factory.mktemp("whole") / "a.zarr", **OPTIONS)


@pytest.fixture(scope="module")
def unfinished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two of four tiles."""
    out = tmp_path_factory.mktemp("half") / "a.zarr"
    with interrupting(2) as stop:
        impasto.run(small_stack(), out, progress=stop, **OPTIONS)
    assert jobs.status(out).tiles_done == 2
    return out


def flip(path: Path, place: str, rng: np.random.Generator) -> None:
    """One bit of the first byte of a file, of the last one, or of any."""
    data = bytearray(path.read_bytes())
    at = {"first": 0, "last": len(data) - 1, "any": int(rng.integers(len(data)))}[place]
    data[at] ^= 1 << int(rng.integers(8))
    path.write_bytes(data)


ALONE = ("job/job.json", "job/journal.jsonl")
"""What is compared with these files cannot be compared where they are damaged."""
NO_RESULT = ("job/pace.jsonl", "job/lock", "job/memory.json")


@pytest.mark.parametrize("place", ["first", "last", "any"])
@pytest.mark.parametrize("whole", [True, False])
def test_a_bit_of_any_file_is_found(
    whole: bool, place: str, finished: Path, unfinished: Path, tmp_path: Path
) -> None:
    rng = np.random.default_rng(5)
    folder = tmp_path / ("a.zarr" if whole else "a.zarr.partial")
    shutil.copytree(finished if whole else unfinished.with_name(folder.name), folder)
    out = tmp_path / "a.zarr"
    assert jobs.verify(out) == ()
    everything = (path for path in folder.rglob("*") if path.is_file())
    files = {path.relative_to(folder).as_posix(): path for path in everything}
    assert files.keys() > {*ALONE, "job/learned.npz", "job/numbers.npz", "normal/c/0/0/1"}
    others = {path for name, path in files.items() if name not in {*ALONE, *NO_RESULT}}
    for name in ALONE:
        before = files[name].read_bytes()
        flip(files[name], place, rng)
        if not whole and name.endswith("journal.jsonl") and place == "last":
            # A line without its end is one that was torn off: its tile is not done.
            assert jobs.status(out).tiles_done == 1
        else:
            assert jobs.verify(out), name
        files[name].write_bytes(before)
    assert jobs.verify(out) == ()
    for path in others:
        flip(path, place, rng)
    found = {Path(one.file) for one in jobs.verify(out)}
    assert others <= found


@pytest.mark.parametrize("name", [*ALONE, "job/learned.npz", "normal/c/0/0/1"])
def test_a_job_does_not_go_on_with_a_changed_bit(
    name: str, unfinished: Path, finished: Path, tmp_path: Path
) -> None:
    """It refuses the file, or makes it again."""
    partial, out = tmp_path / "a.zarr.partial", tmp_path / "a.zarr"
    shutil.copytree(unfinished.with_name(partial.name), partial)
    flip(partial / name, "any", np.random.default_rng(len(name)))
    if name == "normal/c/0/0/1":
        assert tree(jobs.resume(out, source=small_stack())) == tree(finished)
    else:
        with pytest.raises((CorruptInputError, ResumeMismatchError), match=str(tmp_path)):
            jobs.resume(out, source=small_stack())
        assert not out.exists()


@pytest.mark.parametrize(
    "more",
    [
        b"torn off",
        sealed_line({"numbers": "00000000"}),
        None,
        sealed_line({"tile": [5, 5], "estimated": 1, "shards": {}}),
    ],
    ids=["torn", "numbers", "a tile again", "a tile beyond"],
)
def test_nothing_follows_the_last_line_of_a_finished_journal(
    more: bytes | None, finished: Path, tmp_path: Path
) -> None:
    out = tmp_path / "a.zarr"
    shutil.copytree(finished, out)
    journal = out / "job" / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join([*lines, lines[1] if more is None else more]))
    assert f"{journal}: has more than the lines of a finished job" in map(str, jobs.verify(out))
    with pytest.raises(CorruptInputError, match="is not finished; rename it to"):
        jobs.resume(out, source=small_stack())
    out.rename(tmp_path / "a.zarr.partial")
    assert tree(jobs.resume(out, source=small_stack())) == tree(finished)


def test_numbers_of_an_unfinished_job_are_made_again(
    unfinished: Path, finished: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """One tile is fitted for them, not all."""
    partial = tmp_path / "a.zarr.partial"
    shutil.copytree(unfinished.with_name(partial.name), partial)
    numbers = partial / "job" / "numbers.npz"
    flip(numbers, "any", np.random.default_rng(7))
    (found,) = jobs.verify(tmp_path / "a.zarr")
    assert str(found) == f"{numbers}: is not as it was written"
    done: list[int] = []
    jobs.resume(tmp_path / "a.zarr", source=small_stack(), progress=lambda n, _: done.append(n))
    assert done == [1, 2, 3, 4]
    assert "numbers.npz is not as it was written" in caplog.text
    assert tree(tmp_path / "a.zarr") == tree(finished)


@pytest.mark.parametrize(
    "name",
    [
        *("x", "job/x", "normal/c/0/0/0x", "normal/c/0/0/7", "a/b.txt"),
        *("levels/2/normal/c/0/0/7", "levels/4/normal/c/0/1/1"),
    ],
)
def test_a_file_more_in_an_unfinished_job_is_found(
    name: str, unfinished: Path, tmp_path: Path
) -> None:
    partial = tmp_path / "a.zarr.partial"
    shutil.copytree(unfinished.with_name(partial.name), partial)
    (partial / name).parent.mkdir(exist_ok=True, parents=True)
    (partial / name).touch()
    # What a tile that is not finished has written is none: its maps at both scales, statistics.
    for own in ("normal/c/0", "levels/2/normal/c/0", "levels/2/lobe1.gamma/c", "statistics/c/0"):
        file = partial / own / "1" / "1"
        file.parent.mkdir(exist_ok=True, parents=True)
        file.write_bytes(b"half")
    assert [str(one) for one in jobs.verify(tmp_path / "a.zarr")] == [
        f"{partial / name}: does not belong to the store"
    ]


def test_a_model_that_no_journal_knows_is_learned_again(
    unfinished: Path, finished: Path, tmp_path: Path
) -> None:
    """Killed between the model and the first line of the journal."""
    partial = tmp_path / "a.zarr.partial"
    (partial / "job").mkdir(parents=True)
    shutil.copy(unfinished.with_name(partial.name) / "job" / "job.json", partial / "job")
    (partial / "job" / "learned.npz").write_bytes(b"half a model")
    assert tree(jobs.resume(tmp_path / "a.zarr", source=small_stack())) == tree(finished)


def test_a_line_of_a_journal_is_no_other(unfinished: Path, tmp_path: Path) -> None:
    """The number of pixels is in no checksum of a file."""
    partial = tmp_path / "a.zarr.partial"
    shutil.copytree(unfinished.with_name(partial.name), partial)
    journal = partial / "job" / "journal.jsonl"
    lines = journal.read_text().splitlines()
    content = json.loads(lines[-1])
    content["estimated"] -= 1
    journal.write_text("\n".join([*lines[:-1], json.dumps(content)]) + "\n")
    (found,) = jobs.verify(tmp_path / "a.zarr")
    assert str(found) == f"{journal}: is damaged in line {len(lines)}"


def test_dates_of_files_do_not_matter(unfinished: Path, finished: Path, tmp_path: Path) -> None:
    """Files come back from a copy or an archive, with a date before that of their making."""
    partial = tmp_path / "a.zarr.partial"
    shutil.copytree(unfinished.with_name(partial.name), partial)
    for number, path in enumerate(sorted(partial.rglob("*"))):
        os.utime(path, (10.0 * number, 4e9 if number % 2 else 1.0))
    assert jobs.verify(tmp_path / "a.zarr") == ()
    done: list[int] = []
    out = jobs.resume(
        tmp_path / "a.zarr", source=small_stack(), progress=lambda n, _: done.append(n)
    )
    assert done[0] == 2, "no tile is fitted again"
    assert tree(out) == tree(finished)


def another_date(path: Path) -> None:
    """As a backup program leaves a file: the same content, another date and another number."""
    copy = path.with_name("copy")
    shutil.copyfile(path, copy)
    os.utime(copy, (10.0, 10.0))
    copy.replace(path)


@pytest.mark.parametrize("suffix", [".npz", ".zarr"])
def test_dates_of_photographs_do_not_matter(suffix: str, tmp_path: Path, finished: Path) -> None:
    """Not while the job runs; a content that is another one does, whatever its date."""
    source, copy = tmp_path / f"stack{suffix}", tmp_path / "kept"
    write_stack(tmp_path / "stack.npz", small_stack())
    impasto.ingest(small_stack(), tmp_path / "stack.zarr", tile=16)
    file = source if suffix == ".npz" else source / "samples/c/0/0/0/1"
    shutil.copy2(file, copy)

    def touch(done: int, total: int) -> None:
        if done == 1:
            another_date(file)

    out = impasto.run(source, tmp_path / "a.zarr", progress=touch, **OPTIONS)
    assert jobs.verify(out) == ()
    assert (out / "normal/c/0/0/1").read_bytes() == (finished / "normal/c/0/0/1").read_bytes()

    def change(done: int, total: int) -> None:
        if done == total:
            flip(file, "any", np.random.default_rng(3))

    with pytest.raises(ResumeMismatchError, match=f"{file.name} has changed while the job ran"):
        impasto.run(source, tmp_path / "b.zarr", progress=change, **OPTIONS)
    shutil.copy(copy, file)
    assert tree(jobs.resume(tmp_path / "b.zarr")) == tree(out)


def test_no_tile_of_a_photograph_that_was_exchanged_for_a_while_is_kept(tmp_path: Path) -> None:
    """It is put back before the job ends, with the content that it had."""
    path, kept = photographs(tmp_path), (tmp_path / "light2.tif").read_bytes()
    expected = tree(impasto.run(path, tmp_path / "whole.zarr", tile=16, pooling="none"))

    def change(done: int, total: int) -> None:
        if done == 2:
            shutil.copy(tmp_path / "light3.tif", tmp_path / "light2.tif")
        elif done == 8:
            (tmp_path / "light2.tif").write_bytes(kept)

    out = tmp_path / "painting.zarr"
    with pytest.raises(ResumeMismatchError, match=r"light2\.tif has changed while the job ran"):
        impasto.run(path, out, memory="1MB", tile=16, pooling="none", progress=change)
    (tmp_path / "light2.tif").write_bytes(kept)
    found = tree(jobs.resume(out))
    assert {name for name in found if name.startswith("normal/c")}
    assert all(found[n] == expected[n] for n in found if n.startswith(("normal/c", "diffuse/c")))


def test_a_journal_that_is_begun_while_it_is_read_is_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file is empty at first, and a moment later it has a line."""
    out = impasto.run(small_stack(), tmp_path / "a.zarr", **OPTIONS)
    own, calls = lookup.read_journal, []

    def read(path: Path) -> journal.Entries:
        calls.append(path)
        if len(calls) == 1:
            raise CorruptInputError(path, "is no journal of a job")
        return own(path)

    monkeypatch.setattr(lookup, "read_journal", read)
    assert jobs.verify(out) == ()
    assert len(calls) == 2


def test_a_job_that_runs_and_ends_meanwhile_is_well(tmp_path: Path) -> None:
    """Files that are being written, and the folder that gets its name, are no findings."""
    out, ended = tmp_path / "a.zarr", threading.Event()
    seen: list[str] = []

    def watched() -> list[object]:
        found: list[object] = []
        while not ended.is_set():
            with nullcontext() if seen else suppress(ArgumentError):
                state = jobs.status(out)
                if state.tiles:  # it has a record, and from now on always one
                    seen.append(state.state)
                    found += jobs.verify(out)
        return found

    with ThreadPoolExecutor(1) as pool:
        watching = pool.submit(watched)
        try:
            impasto.run(small_stack(), out, **OPTIONS)
        finally:
            ended.set()
        assert watching.result() == []
    assert set(seen) <= {"running", "finished"}


@pytest.mark.parametrize("call", [jobs.status, jobs.verify, jobs.resume])
def test_a_job_that_ends_while_it_is_looked_at_is_finished(
    call: Callable[[Path], object], finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its folder gets its name between being found and being read."""
    out, partial = tmp_path / "a.zarr", tmp_path / "a.zarr.partial"
    shutil.copytree(finished, partial)
    find = lookup.folder_of

    def ends(name: str | os.PathLike[str]) -> tuple[Path, bool]:
        found = find(name)
        if partial.exists():
            partial.rename(out)
        return found

    with monkeypatch.context() as patched:
        patched.setattr(lookup, "folder_of", ends)
        seen = call(out)
    assert seen == call(out)
    assert jobs.status(out).state == "finished"


def test_a_job_that_ends_while_it_is_looked_for_is_found(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its folder gets its name after that was looked for."""
    out, partial = tmp_path / "a.zarr", tmp_path / "a.zarr.partial"
    shutil.copytree(finished, partial)
    exists = Path.exists

    def ends(path: Path, **options: Any) -> bool:
        found = exists(path, **options)
        if path == out / "job" / "job.json" and partial.is_dir():
            partial.rename(out)
        return found

    with monkeypatch.context() as patched:
        patched.setattr(Path, "exists", ends)
        assert lookup.folder_of(out) == (out, True)


@pytest.mark.parametrize("entries", [{"tile": 2}, {"tile": 1, "shape": (12, 3, 2**30, 2**30)}])
@pytest.mark.parametrize("whole", [True, False])
def test_the_tiles_of_a_foreign_record_are_not_looked_for(
    whole: bool, entries: dict[str, Any], finished: Path, unfinished: Path, tmp_path: Path
) -> None:
    """Those in the journal are, and what is too much."""
    folder = tmp_path / ("a.zarr" if whole else "a.zarr.partial")
    shutil.copytree(finished if whole else unfinished.with_name(folder.name), folder)
    record, shard, more = folder / "job/job.json", folder / "normal/c/0/0/1", folder / "normal/more"
    record.write_bytes(replace(JobRecord.read(record), **entries).to_bytes())
    flip(shard, "any", np.random.default_rng(3))
    more.touch()
    foreign, changed, added = map(str, jobs.verify(tmp_path / "a.zarr"))
    assert foreign == f"{record}: is not what journal.jsonl beside it belongs to"
    assert changed.startswith(f"{shard}: has changed: its checksum is")
    assert added == f"{more}: does not belong to the store"


def test_hidden_files_of_others_are_left_alone(unfinished: Path, tmp_path: Path) -> None:
    out, partial = tmp_path / "a.zarr", tmp_path / "a.zarr.partial"
    shutil.copytree(unfinished.with_name(partial.name), partial)
    foreign = (".DS_Store", "job/.notes-2026.txt", "normal/c/0/0/.nfs0012ab", ".a-b.tmp.png")
    left = ("normal/c/0/0/.1-0123456789ab.tmp", "job/.learned-a_b0c1d2.partial.npz")
    left += ("job/.journal-abcdefgh.partial.jsonl",)
    for name in foreign + left:
        (partial / name).write_bytes(b"half")
    jobs.resume(out, source=small_stack())
    assert all((out / name).read_bytes() == b"half" for name in foreign)
    assert not any((out / name).exists() for name in left)


def test_a_finished_store_is_read_where_there_are_no_locks(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "a.zarr"
    shutil.copytree(finished, out)
    (out / "job" / "lock").touch()
    monkeypatch.setitem(sys.modules, "fcntl", None)
    assert jobs.status(out).state == "finished"
    assert [Path(one.file).name for one in jobs.verify(out)] == ["lock"]
