"""Jobs: tile by tile, interrupted by anything, the result is that of the fit of the whole."""

from __future__ import annotations

import errno
import itertools
import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

import impasto
from impasto import ArgumentError, CorruptInputError, ResumeMismatchError, jobs
from impasto.io import write_lights, write_png8
from impasto.jobs.grid import Grid
from impasto.jobs.journal import read_journal
from impasto.jobs.lock import LOCK, holder, locked
from interrupted_jobs import interrupting
from job_photographs import PIXEL, interrupted, photographs, same
from killed_jobs import OPTIONS, stack, tree
from processes import run as run_program

pytest.importorskip("fcntl", reason="jobs need POSIX")


@pytest.fixture(scope="module")
def whole() -> impasto.Sbrdf:
    return impasto.fit_sbrdf(stack(), **PIXEL)


@pytest.mark.parametrize(("tile", "threads"), [(64, 1), (64, 2), (100, 1), (100, 2), (34, 2)])
def test_a_job_is_the_fit_of_the_whole(
    tile: int, threads: int, whole: impasto.Sbrdf, tmp_path: Path
) -> None:
    seen: list[tuple[int, int]] = []
    out = impasto.run(
        stack(),
        tmp_path / "painting.impasto.zarr",
        tile=tile,
        threads=threads,
        progress=lambda done, total: seen.append((done, total)),
        **PIXEL,
    )
    same(impasto.load_sbrdf(out), whole)
    count = len(Grid(70, 90, tile))
    assert seen == [(done, count) for done in range(count + 1)]
    assert jobs.verify(out) == ()
    found = zarr.open_group(out, mode="r")
    assert {name for name, _ in found.arrays()} >= {"normal", "diffuse", "specular", "status"}
    assert found["normal"].shards == (3, tile, tile)


def test_the_bytes_of_a_store_do_not_depend_on_threads(tmp_path: Path) -> None:
    one = impasto.run(stack(), tmp_path / "one.zarr", threads=1, **OPTIONS)
    two = impasto.run(stack(), tmp_path / "two.zarr", threads=2, **OPTIONS)
    assert tree(one) == tree(two)
    # A finished job has nothing to do.
    assert impasto.run(stack(), tmp_path / "two.zarr", **OPTIONS) == two


@pytest.mark.parametrize("fit", ["painting", "none", "lafortune"])
def test_every_fit_can_be_a_job(fit: str, tmp_path: Path) -> None:
    """What is no map is that of the whole, also where the first tile has no pixel."""
    mask = np.ones((70, 90), bool)
    mask[:64, :64] = False
    taken = stack()._replace(mask=mask)
    options: dict[str, Any] = {"pooling": fit}
    if fit == "lafortune":
        options = {"model": "lafortune", "lobes": 1, "effort": "draft"}
    out = impasto.run(taken, tmp_path / "painting.zarr", tile=64, **options)
    same(impasto.load_sbrdf(out), impasto.fit_sbrdf(taken, **options))


@pytest.mark.parametrize("memory", ["1GiB", "1MB"])
def test_files_are_read_by_windows_where_they_do_not_fit(
    memory: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = photographs(tmp_path)
    reading = {"mask": "mask.png", "saturation": 65520}
    monkeypatch.chdir(tmp_path)
    out = impasto.run(
        path, "painting.zarr", memory=memory, tile=32, sample=1, reading=reading, pooling="none"
    )
    expected = impasto.fit_sbrdf(impasto.read_stack(path, **reading), pooling="none")
    same(impasto.load_sbrdf(out), expected)
    record = json.loads((out / "job" / "job.json").read_text())
    names = {Path(entry["file"]).name for entry in record["inputs"]}
    assert names == {"dirs.lp", "mask.png", *(f"light{index}.tif" for index in range(12))}
    assert jobs.rerun(out, tmp_path / "again.zarr", memory=memory) == ()


def test_lamps_near_a_window_of_files_are_where_they_are(tmp_path: Path) -> None:
    """A window knows where it lies: in light, among neighbours, and in the relief."""
    photographs(tmp_path)
    positions = 60.0 * stack().rig.directions
    lamps = {
        "lightConfiguration": "lights3d",
        "imageWidth": 45.0,
        "positions3d": positions.tolist(),
    }
    (tmp_path / "dirs.lp").unlink()
    (tmp_path / "rig.dome").write_text(json.dumps(lamps))
    taken = impasto.read_stack(tmp_path / "rig.dome")
    assert taken.rig.near.all()
    out = impasto.run(
        tmp_path / "rig.dome", tmp_path / "near.zarr", memory="1.6MB", tile=32, sample=1, **PIXEL
    )
    same(impasto.load_sbrdf(out), impasto.fit_sbrdf(taken, **PIXEL))


def test_pictures_that_are_decoded_whole_are_decoded_seldom(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A PNG is decoded for as many rows of tiles as fit into the memory, not for every tile."""
    taken = stack((70, 90))
    names = [f"light{index}.png" for index in range(len(taken.rig))]
    for name, codes in zip(names, taken.samples, strict=True):
        write_png8(tmp_path / name, np.moveaxis(codes >> 4, 0, -1).astype(np.uint8))
    path = tmp_path / "dirs.lp"
    write_lights(path, taken.rig, names)
    options: dict[str, Any] = {"pooling": "none", "normals": "least-squares"}
    whole = impasto.fit_sbrdf(impasto.read_stack(path, encoding="srgb"), **options)
    regions: list[Any] = []

    def counted(*args: Any, region: Any = None, **others: Any) -> impasto.Stack:
        regions.append(region)
        return impasto.read_stack(*args, region=region, **others)

    monkeypatch.setattr("impasto.jobs.photographs.read_stack", counted)
    out = impasto.run(
        path, tmp_path / "painting.zarr", memory="1.4MB", tile=32, sample=9,
        reading={"encoding": "srgb"}, **options,
    )  # fmt: skip
    same(impasto.load_sbrdf(out), whole)
    # Of 700 kB: 18,900 of a decoded picture, and rows of 90 x (12 x 3) x (4 + 1) bytes: 42. The
    # sample takes every ninth row from 3 on, those of a row of tiles at a time: rows 3 to 30 are in
    # the first band, rows 39 to 57 and 66 in a second one. Of nine tiles three begin in row 0, the
    # others in rows 32 and 64.
    assert regions[:2] == [(0, 0, 1, 1), (34, 44, 2, 2)]
    bands = [(3, 42), (39, 31), (0, 42), (32, 38)]
    assert [(top, height) for top, _, height, _ in regions[2:]] == bands
    assert {width for *_, width in regions[2:]} == {90}


def test_a_model_is_learned_from_as_many_pixels_as_fit(tmp_path: Path) -> None:
    """Every third row and column about the middle; the apply pass still fits every pixel."""
    path = photographs(tmp_path, (143, 160))
    impasto.io.write_stack(tmp_path / "stack.npz", impasto.read_stack(path))
    out = impasto.run(tmp_path / "stack.npz", tmp_path / "painting.zarr", memory="14.8MB", **PIXEL)
    record = json.loads((out / "job" / "job.json").read_text())
    assert (record["sample"], record["tile"]) == (3, 64)
    taken = impasto.read_stack(path)
    # As many pixels before the first as after the last: 2 and 2 of 143 rows, 0 and 0 of 160.
    few = impasto.Stack(
        taken.samples[..., 2::3, ::3], lights=taken.rig, saturation=taken.saturation
    )
    assert few.shape[2:] == (47, 54)
    learned = impasto.learn_sbrdf(few, **PIXEL)
    model = impasto.load_learned(out / "job" / "learned.npz")
    assert model.extent == (143, 160)
    assert isinstance(model.fit, type(learned.fit))
    for name, array in learned.fit.to_arrays().items():  # type: ignore[union-attr]
        if name != "extent":
            assert array.tobytes() == model.fit.to_arrays()[name].tobytes(), name  # type: ignore[union-attr]
    same(impasto.load_sbrdf(out), model.apply(taken))


@pytest.mark.slow
def test_a_killed_job_is_resumed_to_the_same_bytes(tmp_path: Path) -> None:
    """Killed before the first and last flushes and renames, and between; -2 gives it its name."""
    steps = [1, 7, 60, 61, 62, 150, -120, -2, -1]
    program = (
        "import sys, killed_jobs, pathlib\n"
        "killed_jobs.at_steps(pathlib.Path(sys.argv[1]), [int(n) for n in sys.argv[2:]])"
    )
    found = json.loads(run_program(program, str(tmp_path), *map(str, steps)))
    assert [one["step"] for one in found["seen"]] == steps
    assert all(one["same"] for one in found["seen"])
    done = [one["done"] for one in found["seen"]]
    assert done[0] == 0
    assert 0 < done[5] < done[-1]


def test_a_full_disk_leaves_a_job_that_can_be_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At one flush; ``test_failing_steps.py`` has others, and other steps."""
    step = 90
    out, steps, flush = tmp_path / "painting.zarr", itertools.count(1), os.fsync

    def full(handle: int) -> None:
        if next(steps) == step:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        flush(handle)

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        with pytest.raises(OSError, match="No space left") as error:
            impasto.run(stack(), out, **OPTIONS)
    assert error.value.filename is not None
    assert not out.exists()
    expected = impasto.run(stack(), tmp_path / "whole.zarr", **OPTIONS)
    assert tree(impasto.run(stack(), out, **OPTIONS)) == tree(expected)


def test_what_is_torn_or_lost_is_made_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    expected = tree(impasto.run(stack(), tmp_path / "whole.zarr", **OPTIONS))
    out = tmp_path / "painting.zarr"
    partial = tmp_path / "painting.zarr.partial"
    interrupted(out, 3)
    state = jobs.status(out)
    assert (state.state, state.tiles_done, state.tiles) == ("interrupted", 3, 4)
    assert state.pixels_done == 64 * 64 + 64 * 26 + 6 * 64
    assert state.pixels_per_second is not None
    assert state.seconds_left == pytest.approx(6 * 26 / state.pixels_per_second)
    journal = partial / "job" / "journal.jsonl"
    journal.write_bytes(journal.read_bytes() + b'{"estimated": 12, "sha')
    shard = partial / "normal" / "c" / "0" / "0" / "1"
    shard.write_bytes(shard.read_bytes()[:-9])
    (partial / "normal" / "c" / "0" / "0" / ".1-abc.tmp").write_bytes(b"half")
    assert [one.file for one in jobs.verify(out)] == [str(shard)]
    assert tree(jobs.resume(out, source=stack())) == expected
    assert "tile (0, 1) is fitted again" in caplog.text
    assert jobs.status(out).state == "finished"


def test_a_second_run_is_refused(tmp_path: Path) -> None:
    out = tmp_path / "painting.zarr"
    seen = []

    def second(done: int, total: int) -> None:
        if done == 2:
            seen.append(jobs.status(out))
            with pytest.raises(
                ArgumentError, match=f"in use by another job, process {os.getpid()}"
            ):
                impasto.run(stack(), out, **OPTIONS)

    impasto.run(stack(), out, progress=second, **OPTIONS)
    (found,) = seen
    assert (found.state, found.process) == ("running", os.getpid())
    assert found.tiles_done in {2, 3, 4}, "the next may be on the disk by now"
    assert jobs.verify(out) == ()


def test_a_job_on_another_machine_is_told(tmp_path: Path) -> None:
    with locked(tmp_path):
        (tmp_path / LOCK).write_text("77\nscanner-3\n")
        assert holder(tmp_path) == (77, "scanner-3")
        with (
            pytest.raises(ArgumentError, match="another job, process 77 on scanner-3; wait"),
            locked(tmp_path),
        ):
            pass


def test_a_job_goes_on_only_as_it_began(tmp_path: Path) -> None:
    out = tmp_path / "painting.zarr"
    interrupted(out, 2)
    with pytest.raises(ResumeMismatchError, match=r"; effort\.rounds: the job has 2, this call 1"):
        impasto.run(stack(), out, effort="draft", **OPTIONS)
    with pytest.raises(
        ResumeMismatchError, match=r"tile: the job has 64, this call 32.*begin anew \(resume=False"
    ):
        impasto.run(stack(), out, **OPTIONS | {"tile": 32})
    other = impasto.Stack(stack().samples[:, :, ::-1], lights=stack().rig)
    with pytest.raises(ResumeMismatchError, match="a stack in memory has changed since"):
        impasto.run(other, out, **OPTIONS)
    with pytest.raises(ArgumentError, match="give the stack"):
        jobs.resume(out)
    # The memory may be another, and the tile need not be said again.
    impasto.run(stack(), out, memory="50MB", pooling="none")
    with pytest.raises(ArgumentError, match="does not replace; give another name, or remove it"):
        impasto.run(stack(), out, resume=False, **OPTIONS)
    with pytest.raises(
        ResumeMismatchError, match=r"finished \(index: .*\); give another name, or remove it$"
    ):
        impasto.run(stack(), out, index=1.6, pooling="painting", tile=64)


def test_an_unfinished_job_can_be_begun_anew(tmp_path: Path) -> None:
    out = tmp_path / "painting.zarr"
    interrupted(out, 2)
    impasto.run(stack(), out, resume=False, **OPTIONS | {"tile": 32})
    assert json.loads((out / "job" / "job.json").read_text())["tile"] == 32


def test_a_call_that_fails_removes_no_job(tmp_path: Path) -> None:
    out = tmp_path / "painting.zarr"
    interrupted(out, 3)
    for source, memory in ((tmp_path / "typo.lp", "1GiB"), (stack(), "1KB")):
        with pytest.raises((ArgumentError, FileNotFoundError, CorruptInputError)):
            impasto.run(source, out, resume=False, memory=memory, pooling="none")
    assert jobs.status(out).tiles_done == 3


def test_an_unfinished_job_is_no_result_whatever_its_name(tmp_path: Path) -> None:
    out, partial = tmp_path / "painting.zarr", tmp_path / "painting.zarr.partial"
    interrupted(out, 2)
    # A shell completes the name of the folder that is there.
    assert jobs.status(partial).state == "interrupted"
    partial.rename(out)
    assert jobs.status(out).state == "interrupted"
    with pytest.raises(CorruptInputError, match="is not finished; rename it"):
        jobs.resume(out, source=stack())
    with pytest.raises(CorruptInputError):
        impasto.load_sbrdf(out)
    out.rename(partial)
    assert jobs.resume(partial, source=stack()) == out


def test_numbers_that_are_lost_are_found_again(tmp_path: Path) -> None:
    expected = tree(impasto.run(stack(), tmp_path / "whole.zarr", **OPTIONS))
    out = tmp_path / "painting.zarr"
    interrupted(out, 3)
    (tmp_path / "painting.zarr.partial" / "job" / "numbers.npz").unlink()
    assert tree(impasto.run(stack(), out, **OPTIONS)) == expected


def test_a_mask_counts_in_a_tile_of_one_pixel(tmp_path: Path) -> None:
    path = photographs(tmp_path, (33, 33))
    mask = np.full((33, 33, 3), 255, np.uint8)
    mask[32, 32] = 0
    write_png8(tmp_path / "mask.png", mask)
    options: dict[str, Any] = {"sample": 1, "pooling": "none", "tile": 16}
    reading = {"mask": tmp_path / "mask.png"}
    out = impasto.run(path, tmp_path / "a.zarr", memory="100kB", reading=reading, **options)
    assert impasto.load_sbrdf(out).status[32, 32] == impasto.Status.MASKED


def test_a_photograph_that_changes_ends_the_job(tmp_path: Path) -> None:
    path = photographs(tmp_path)

    def change(done: int, total: int) -> None:
        if done == 2:
            shutil.copy(tmp_path / "light3.tif", tmp_path / "light2.tif")

    out = tmp_path / "painting.zarr"
    with pytest.raises(ResumeMismatchError, match=r"light2\.tif has changed while the job ran"):
        impasto.run(path, out, tile=64, pooling="none", progress=change)
    assert not out.exists()


def test_links_to_photographs_are_followed_by_name(tmp_path: Path) -> None:
    """As data sets have them that keep their files under their hashes."""
    (tmp_path / "kept").mkdir()
    (tmp_path / "names").mkdir()
    path = photographs(tmp_path / "kept")
    for number, file in enumerate(sorted(path.parent.iterdir())):
        file.rename(path.parent / f"{number}{file.suffix}")
        (tmp_path / "names" / file.name).symlink_to(path.parent / f"{number}{file.suffix}")
    out = impasto.run(tmp_path / "names/dirs.lp", tmp_path / "a.zarr", tile=64, pooling="none")
    assert jobs.verify(out) == ()


def test_a_link_to_nothing_is_no_place_for_a_store(tmp_path: Path) -> None:
    (tmp_path / "a.zarr").symlink_to(tmp_path / "nowhere.zarr")
    with pytest.raises(ArgumentError, match="is a link to nothing"):
        impasto.run(stack(), tmp_path / "a.zarr", **OPTIONS)


def test_tiles_are_no_larger_than_the_painting(tmp_path: Path) -> None:
    out = impasto.run(stack((20, 20)), tmp_path / "a.zarr", tile=99992, pooling="none", sample=21)
    assert json.loads((out / "job" / "job.json").read_text())["tile"] == 64


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of photographs in files, and one of other options."""
    folder = tmp_path_factory.mktemp("stores")
    path = photographs(folder)
    for name, method in (("painting", None), ("other", "least-squares")):
        impasto.run(path, folder / f"{name}.zarr", tile=64, pooling="none", normals=method)
    return folder


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 16
    path.write_bytes(data)


def swap(folder: Path) -> None:
    one, two = folder / "diffuse/c/0/0/0", folder / "diffuse/c/0/0/1"
    one.rename(folder / "x")
    two.rename(one)
    (folder / "x").rename(two)


def shorten(path: Path) -> None:
    """A whole journal without one of its tiles."""
    entries = read_journal(path)
    del entries.tiles[0, 1]
    path.write_bytes(entries.to_bytes(Grid(70, 90, 64)))


def recount(path: Path) -> None:
    text = path.read_text()
    count = text.split('"estimated": ')[1].split(",")[0]
    path.write_text(text.replace(f'"estimated": {count}', f'"estimated": {int(count) - 1}', 1))


def link(path: Path) -> None:
    path.rename(path.with_suffix(".moved"))
    path.symlink_to(path.with_suffix(".moved").name)


CHANGES: dict[str, tuple[Any, str]] = {
    "a bit of a map": (lambda f, o: flip(f / "normal/c/0/1/0"), "normal/c/0/1/0: has changed"),
    "a map deleted": (lambda f, o: (f / "status/c/0/1").unlink(), "status/c/0/1: is missing"),
    "two tiles swapped": (lambda f, o: swap(f), "diffuse/c/0/0/1: has changed"),
    "a bit of a number": (lambda f, o: flip(f / "beta/c"), "beta/c: has changed"),
    "a bit of a description": (lambda f, o: flip(f / "normal/zarr.json"), "normal/zarr.json: has"),
    "a bit of the group": (lambda f, o: flip(f / "zarr.json"), "zarr.json: has changed"),
    "another journal": (
        lambda f, o: shutil.copy(o / "job/journal.jsonl", f / "job/journal.jsonl"),
        "job.json: is not what journal.jsonl beside it belongs to",
    ),
    "another record": (
        lambda f, o: shutil.copy(o / "job/job.json", f / "job/job.json"),
        "job/job.json: is not what journal.jsonl beside it belongs to",
    ),
    "a bit of the model": (
        lambda f, o: flip(f / "job/learned.npz"),
        "job/learned.npz: is not what journal.jsonl beside it belongs to",
    ),
    "no journal": (lambda f, o: (f / "job/journal.jsonl").unlink(), "journal.jsonl: is missing"),
    "a line less": (lambda f, o: shorten(f / "job/journal.jsonl"), "has no tile 0, 1"),
    "another count": (lambda f, o: recount(f / "job/journal.jsonl"), "is damaged in line 2"),
    "a link": (lambda f, o: link(f / "status/c/0/1"), "status/c/0/1: is a link"),
    "a file more": (lambda f, o: (f / "normal/c/0/0/2").touch(), "does not belong to the store"),
    "a broken record": (
        lambda f, o: (f / "job/job.json").write_text("{"),
        "job/job.json: is no record of a job (Expecting property name",
    ),
}
ALONE = ("another record", "a bit of the model", "a broken record")
"""Those of which nothing else is said: all other files are as the journal has them."""


@pytest.mark.parametrize("change", CHANGES)
def test_every_change_is_found(change: str, stores: Path, tmp_path: Path) -> None:
    act, words = CHANGES[change]
    folder = tmp_path / "painting.zarr"
    shutil.copytree(stores / "painting.zarr", folder)
    assert jobs.verify(folder) == ()
    act(folder, stores / "other.zarr")
    found = [str(one) for one in jobs.verify(folder, inputs=False)]
    if change in ALONE:
        (alone,) = found
        assert alone.startswith(f"{folder}/{words}")
    else:
        assert any(words in one for one in found), found


def test_a_repetition_goes_on_and_is_compared(stores: Path, tmp_path: Path) -> None:
    out, again = stores / "painting.zarr", tmp_path / "again.zarr"
    with interrupting(2) as stop:
        jobs.rerun(out, again, progress=stop)
    assert jobs.status(again).tiles_done == 2
    assert jobs.rerun(out, again) == ()
    flip(again / "normal/c/0/1/0")
    assert jobs.rerun(out, again) == ("normal/c/0/1/0",)
    with pytest.raises(ArgumentError, match="is the store itself"):
        jobs.rerun(out, out)
    with pytest.raises(
        ResumeMismatchError, match=r"\(normals: the job has 'least-squares', this call noth"
    ):
        jobs.rerun(out, stores / "other.zarr")


def test_a_mask_that_is_black_everywhere_ends_a_job_before_it_begins(tmp_path: Path) -> None:
    path = photographs(tmp_path)
    mask = tmp_path / "mask.png"
    write_png8(mask, np.zeros((1, 70, 90), np.uint8))
    for memory in ("1GiB", "3MB"):  # read whole, and by windows
        with pytest.raises(ArgumentError, match="mask: is empty, no pixel"):
            impasto.run(path, tmp_path / "a.zarr", memory=memory, reading={"mask": mask})
    assert not list(tmp_path.glob("a.zarr*"))


def test_changed_photographs_are_found(tmp_path: Path) -> None:
    path = photographs(tmp_path)
    out = impasto.run(path, tmp_path / "painting.zarr", tile=64, pooling="none")
    shutil.copy(tmp_path / "light2.tif", tmp_path / "light3.tif")
    (found,) = jobs.verify(out)
    assert str(found).endswith("light3.tif: has changed since the job read it")
    with pytest.raises(
        ResumeMismatchError, match=r"cannot be made .*light3\.tif has changed since the job"
    ):
        jobs.rerun(out, tmp_path / "again.zarr")
    assert jobs.verify(out, inputs=False) == ()
    (tmp_path / "light3.tif").unlink()
    assert "is missing" in str(jobs.verify(out)[0])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"out": "painting.npz"}, r"out: expected a name ending in \.zarr"),
        ({"out": "nowhere/painting.zarr"}, "does not exist"),
        ({"memory": "much"}, "memory: expected bytes"),
        ({"memory": "9" * 400 + "TB"}, "memory: expected 1 B to 8 EiB"),
        ({"memory": "100B", "tile": 64}, "memory: to learn from one pixel takes"),
        ({"reading": "srgb"}, "reading: expected options by name"),
        ({"memory": "100kB"}, "memory: tiles of 64 x 64 pixels of these photographs need"),
        ({"tile": 4}, "tile: expected an even number from 16 on, found 4"),
        ({"tile": 65}, "tile: expected an even number from 16 on, found 65"),
        ({"sample": 2}, "sample: expected an odd number"),
        ({"pooling": "segment"}, 'pooling: "segment" cannot be learned'),
        ({"pooling": "none", "lobes": 2}, "lobes: .*has no such option"),
        ({"lobe": 2}, "lobe: a job has no such option; did you mean 'lobes'"),
        ({"normals": "robst"}, "normals: expected .*did you mean 'robust'"),
        ({"reading": {"encoding": "srgb"}}, "reading: a stack is read already"),
        ({"reading": {"region": (0, 0, 9, 9)}}, "reading: a job has no option 'region'"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_what_cannot_be_a_job_is_refused_at_once(
    options: dict[str, Any], words: str, tmp_path: Path
) -> None:
    out = tmp_path / options.pop("out", "painting.zarr")
    with pytest.raises(ArgumentError, match=words):
        impasto.run(stack(), out, **options)
    assert list(tmp_path.iterdir()) == []


def test_a_store_in_another_is_refused(tmp_path: Path) -> None:
    """Its files would not belong to the other, as that one's check would say ever after."""
    out = impasto.run(stack(), tmp_path / "painting.zarr", **OPTIONS)
    before = tree(tmp_path)
    with pytest.raises(ArgumentError, match=r"would lie in the store .*painting\.zarr, to which"):
        impasto.run(stack(), out / "detail.zarr", **OPTIONS)
    assert tree(tmp_path) == before
    (tmp_path / "archive.zarr").mkdir()  # a group of others
    assert impasto.run(stack(), tmp_path / "archive.zarr" / "a.zarr", **OPTIONS).is_dir()


def test_other_folders_are_left_alone(tmp_path: Path) -> None:
    for name in ("a.zarr", "b.zarr.partial"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "precious").touch()
        with pytest.raises(ArgumentError, match="exists and is no job of impasto"):
            impasto.run(stack(), tmp_path / name.removesuffix(".partial"), **OPTIONS)
        assert (tmp_path / name / "precious").exists()
    with pytest.raises(ArgumentError, match="is no job"):
        jobs.status(tmp_path / "a.zarr")


def test_a_damaged_journal_is_named(tmp_path: Path) -> None:
    out = tmp_path / "painting.zarr"
    interrupted(out, 2)
    journal = tmp_path / "painting.zarr.partial" / "job" / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(lines[0] + b"{}\n" + lines[2])
    with pytest.raises(CorruptInputError, match=r"journal\.jsonl: is damaged in line 2"):
        impasto.run(stack(), out, **OPTIONS)


def test_a_job_without_zarr_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(impasto.MissingExtraError, match=r"pip install 'impasto\[scale\]'"):
        impasto.run(stack(), tmp_path / "painting.zarr", **OPTIONS)
    assert list(tmp_path.iterdir()) == []
