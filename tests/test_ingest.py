"""Photographs as one store: what is read from it is what was read from the photographs."""

from __future__ import annotations

import errno
import json
import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import dask.array
import numpy as np
import pytest
import zarr

import impasto
from command_line import complaint
from impasto import ArgumentError, CorruptInputError, PointLight, Rig
from impasto.cli import main
from impasto.io import open_source, write_lights, write_png8, write_stack
from impasto.jobs import photographs as reading
from job_photographs import PIXEL, photographs, same
from killed_jobs import stack

pytest.importorskip("fcntl", reason="jobs need POSIX")


def assert_same(found: impasto.Stack, wanted: impasto.Stack) -> None:
    for name in ("samples", "scale", "black", "saturation", "mask"):
        one, two = getattr(found, name), getattr(wanted, name)
        if two is None:
            assert one is None, name
            continue
        assert one.dtype == two.dtype, name
        assert one.tobytes() == two.tobytes(), name
    assert (found.bands, found.names, found.encoding) == (
        wanted.bands,
        wanted.names,
        wanted.encoding,
    )
    for name in ("vectors", "near", "falloff", "intensities", "views"):
        assert getattr(found.rig, name).tobytes() == getattr(wanted.rig, name).tobytes(), name
    assert (found.rig.origin, found.rig.pitch_mm) == (wanted.rig.origin, wanted.rig.pitch_mm)


@pytest.mark.parametrize("memory", ["4GiB", "4MB"])
def test_a_store_is_the_photographs(memory: str, tmp_path: Path) -> None:
    path = photographs(tmp_path, (150, 90))
    reading = {"mask": str(tmp_path / "mask.png"), "saturation": 65520}
    seen: list[tuple[int, int]] = []
    out = impasto.ingest(
        path,
        tmp_path / "stack.zarr",
        memory=memory,
        tile=64,
        reading=reading,
        progress=lambda done, total: seen.append((done, total)),
    )
    assert seen == [(count, 6) for count in range(1, 7)]
    whole = impasto.read_stack(path, **reading)
    assert_same(impasto.read_stack(out), whole)
    for top, left, height, width in [(0, 0, 1, 1), (60, 30, 70, 60), (149, 89, 1, 1)]:
        part = whole[top : top + height, left : left + width]
        assert_same(impasto.read_stack(out, region=(top, left, height, width)), part)
    with open_source(out, index=7) as source:
        assert (
            source.read(slice(10, 140), slice(0, 90)).tobytes()
            == whole.samples[7, :, 10:140].tobytes()
        )
        assert source.shape == (3, 150, 90)
    # All observations of a tile in one file, for any reader of Zarr.
    group = zarr.open_group(out, mode="r")
    assert group["samples"].shards == (12, 3, 64, 64)
    assert len([p for p in (out / "samples").rglob("*") if p.is_file()]) == 7
    found = json.loads((out / "zarr.json").read_text())["attributes"]["impasto"]["text"]["inputs"]
    assert {Path(name).name for name, *_ in found} >= {"dirs.lp", "mask.png", "light0.tif"}


def test_near_lamps_keep_their_places(tmp_path: Path) -> None:
    lamps = [PointLight((*(80.0 * one).tolist(),)) for one in stack().rig.directions]
    near = stack()._replace(rig=Rig(lamps, pitch_mm=0.5))
    out = impasto.ingest(near, tmp_path / "stack.zarr", tile=64)
    assert_same(impasto.read_stack(out), near)
    assert_same(impasto.read_stack(out, region=(3, 5, 40, 50)), near[3:43, 5:55])


def test_a_job_of_a_store_is_that_of_the_photographs(tmp_path: Path) -> None:
    out = impasto.ingest(stack(), tmp_path / "stack.zarr", tile=64)
    fitted = impasto.run(
        out, tmp_path / "painting.zarr", memory="1.5MB", tile=32, sample=1, **PIXEL
    )
    same(impasto.load_sbrdf(fitted), impasto.fit_sbrdf(stack(), **PIXEL))
    assert impasto.jobs.verify(fitted) == ()
    file = next(p for p in (out / "samples" / "c").rglob("*") if p.is_file())
    content = bytearray(file.read_bytes())
    content[100] ^= 1
    file.write_bytes(content)
    assert [finding.file for finding in impasto.jobs.verify(fitted)] == [str(file)]


def test_a_store_of_photographs_is_verified(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every bit of its numbers, files that are missing and files of others."""
    mask = np.ones((70, 90), bool)
    mask[3, 4] = False
    out = impasto.ingest(stack()._replace(mask=mask), tmp_path / "stack.zarr", tile=32)
    verify = ["job", "verify", str(out)]
    assert main(verify) == 0
    assert f"{out}: all files are as written" in capsys.readouterr().out
    numbers = [path for path in out.rglob("*") if "c" in path.parts and path.is_file()]
    assert {path.relative_to(out).parts[0] for path in numbers} >= {"samples", "mask", "scale"}
    for path in numbers:
        before = path.read_bytes()
        path.write_bytes(bytes([*before[:-9], before[-9] ^ 4, *before[-8:]]))
        (found,) = impasto.jobs.verify(out)
        assert Path(found.file) in {path, *path.parents}, found
        path.write_bytes(before)
    numbers[0].unlink()
    (out / "more").touch()
    assert main(verify) == 3
    said = capsys.readouterr()
    lines = said.out.splitlines()
    assert len(lines) == 2
    assert f"{out / 'more'}: does not belong to the store" in lines
    assert "made again from these by impasto ingest" in said.err
    assert "holds photographs, not a job" in complaint(["job", "status", str(out)], 1, capsys)


def test_a_job_knows_the_tiles_of_a_store_by_the_checksums_in_them(tmp_path: Path) -> None:
    """Numbers that change with the checksum of their chunk are found, and those without it."""
    taken = stack()
    out = impasto.ingest(taken, tmp_path / "stack.zarr", tile=64)
    options = {"memory": "1.5MB", "tile": 32, "sample": 1, **PIXEL}
    fitted = impasto.run(out, tmp_path / "painting.zarr", **options)
    record = json.loads((fitted / "job" / "job.json").read_text())
    tiles = [one for one in record["inputs"] if "/samples/c/" in one["file"]]
    assert tiles
    assert all(set(one) == {"file", "bytes", "crc32c"} for one in tiles)
    file = Path(tiles[0]["file"])
    assert tiles[0]["bytes"] == file.stat().st_size
    crate = impasto.jobs.export_ro_crate(fitted, tmp_path / "crate")
    graph = json.loads((crate / "ro-crate-metadata.json").read_text())["@graph"]
    (described,) = (one for one in graph if one["@id"] == file.as_uri())
    assert described["identifier"] == f"crc32c:{tiles[0]['crc32c']}"
    assert "sha256" not in described
    before = file.read_bytes()
    bright = taken._replace(samples=taken.samples // 2)
    other = impasto.ingest(bright, tmp_path / "other.zarr", tile=64)
    file.write_bytes((other / file.relative_to(out)).read_bytes())
    assert [f.problem for f in impasto.jobs.verify(fitted)] == ["has changed since the job read it"]
    with pytest.raises(impasto.ResumeMismatchError, match="has changed since the job read it"):
        impasto.run(out, tmp_path / "painting.zarr", **options)
    changed = bytearray(before)
    changed[7] ^= 16
    file.write_bytes(changed)
    # Who goes on learns of it from whoever reads the tile.
    with pytest.raises(CorruptInputError, match="the checksum of a chunk is another"):
        impasto.run(out, tmp_path / "again.zarr", **options)
    assert [f.problem for f in impasto.jobs.verify(fitted)] == ["has changed since the job read it"]
    file.write_bytes(before)
    assert impasto.jobs.verify(fitted) == ()


def test_what_a_window_costs_does_not_grow_with_the_store(tmp_path: Path) -> None:
    """A window names the files that it is read from, and only these are looked at after it."""
    out = impasto.ingest(stack(), tmp_path / "stack.zarr", tile=32)
    whole = impasto.read_stack(out)
    part = impasto.read_stack(out, region=(0, 0, 30, 40))
    tiles = [one for one in whole.sources if one.parent.parent.name == "0"]
    own = [one for one in part.sources if one in tiles]
    assert {one.relative_to(out).parts[-2:] for one in own} == {("0", "0"), ("0", "1")}
    assert set(whole.sources) - set(part.sources) == set(tiles) - set(own)
    opened = reading.open_photographs(out, {}, 1, None)
    opened.inputs()
    window = slice(0, 30), slice(0, 40)
    (far,) = (one for one in tiles if one.parts[-2:] == ("2", "2") and "samples" in one.parts)
    far.write_bytes(far.read_bytes() + b"more")
    assert opened.changed(window) == []
    assert opened.changed((slice(60, 70), slice(60, 70))) == opened.changed() == [far]


def test_pictures_that_are_decoded_whole_are_decoded_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = stack()
    names = [f"light{index}.png" for index in range(len(taken.rig))]
    for name, codes in zip(names, taken.samples, strict=True):
        write_png8(tmp_path / name, np.moveaxis(codes >> 4, 0, -1).astype(np.uint8))
    write_lights(tmp_path / "dirs.lp", taken.rig, names)
    regions: list[Any] = []

    def counted(*args: Any, region: Any = None, **others: Any) -> impasto.Stack:
        regions.append(region)
        return impasto.read_stack(*args, region=region, **others)

    monkeypatch.setattr("impasto.jobs.photographs.read_stack", counted)
    out = impasto.ingest(tmp_path / "dirs.lp", tmp_path / "stack.zarr", tile=16)
    assert regions == [(0, 0, 1, 1), (34, 44, 2, 2), None]
    assert_same(impasto.read_stack(out), impasto.read_stack(tmp_path / "dirs.lp"))


def test_damage_is_found(tmp_path: Path) -> None:
    out = impasto.ingest(stack(), tmp_path / "stack.zarr", tile=64)
    whole = impasto.read_stack(out)
    for file in [p for p in sorted(out.rglob("*")) if p.is_file()]:
        content = file.read_bytes()
        changed = bytearray(content)
        changed[len(content) // 2] ^= 1
        for bad in (bytes(changed), content[: len(content) // 2], b"", None):
            file.unlink()
            if bad is not None:
                file.write_bytes(bad)
            with suppress(CorruptInputError):
                found = impasto.read_stack(out)
                # A digit in a description may say the same; numbers have checksums.
                assert found.samples.tobytes() == whole.samples.tobytes()
                assert file.name == "zarr.json"
            file.unlink(missing_ok=True)
            file.write_bytes(content)


def test_an_interrupted_call_leaves_nothing(tmp_path: Path) -> None:
    def stop(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        impasto.ingest(stack(), tmp_path / "stack.zarr", tile=32, progress=stop)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("content", ["same", "other"])
def test_a_photograph_that_changes_ends_the_call_and_one_of_another_date_does_not(
    content: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, out = photographs(tmp_path), tmp_path / "stack.zarr"
    file = tmp_path / "light3.tif"
    entries, hashed = reading.file_entries, threading.Event()

    def told(*given: Any) -> list[dict[str, Any]]:
        found = entries(*given)
        hashed.set()
        return found

    def change(done: int, total: int) -> None:
        if done == total:
            assert hashed.wait(60.0), "before, nobody can know what the file held"
            data = bytearray(file.read_bytes())
            data[-1] ^= content == "other"
            file.write_bytes(data)
            os.utime(file, (10.0, 10.0))

    monkeypatch.setattr(reading, "file_entries", told)
    if content == "same":
        impasto.ingest(path, out, tile=64, progress=change)
        assert_same(impasto.read_stack(out), impasto.read_stack(path))
        return
    with pytest.raises(impasto.ResumeMismatchError, match=r"light3\.tif has changed while it was"):
        impasto.ingest(path, out, tile=64, progress=change)
    assert not out.exists()


def test_an_interrupted_call_does_not_wait_for_the_hashes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = photographs(tmp_path)
    before = sorted(tmp_path.iterdir())
    to_the_end: list[bool] = []

    def slow(paths: object, report: Callable[[int, int], object], *_: Any) -> list[dict[str, Any]]:
        for step in range(500):
            report(step, 500)
            time.sleep(0.01)
        to_the_end.append(True)
        return []

    def stop(done: int, total: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(reading, "file_entries", slow)
    with pytest.raises(KeyboardInterrupt):
        impasto.ingest(path, tmp_path / "stack.zarr", tile=32, progress=stop)
    assert not to_the_end
    assert sorted(tmp_path.iterdir()) == before


def test_photographs_that_cannot_be_hashed_are_not_written_to_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, failing = photographs(tmp_path), threading.Event()
    before = sorted(tmp_path.iterdir())
    seen: list[int] = []

    def unplugged(*_: Any) -> list[dict[str, Any]]:
        failing.set()
        raise OSError(errno.EIO, os.strerror(errno.EIO), str(path))

    def wait(done: int, total: int) -> None:
        assert failing.wait(60.0)
        time.sleep(0.1)
        seen.append(total - done)

    monkeypatch.setattr(reading, "file_entries", unplugged)
    with pytest.raises(OSError, match="Input/output error"):
        impasto.ingest(path, tmp_path / "stack.zarr", tile=32, progress=wait)
    assert min(seen, default=1) > 0
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"out": "stack.npz"}, r"out: expected a name ending in \.zarr, found 'stack\.npz'"),
        ({"out": "none/stack.zarr"}, "out: the folder .* does not exist"),
        ({"out": "a\0.zarr"}, "out: .* is no name of a file"),
        ({"out": "a.zarr.partial"}, r"out: expected a name ending in \.zarr"),
        ({"memory": "1kB"}, r"memory: a tile of 64 x 64 pixels of .* needs [\d.]+ MiB, found"),
        ({"tile": 3}, "tile: expected an even number from 16 on"),
        ({"reading": {"encoding": "srgb"}}, "reading: a stack is read already"),
    ],
    ids=["suffix", "folder", "zero", "job", "memory", "tile", "reading"],
)
def test_what_cannot_be_is_refused(options: dict[str, Any], words: str, tmp_path: Path) -> None:
    out = tmp_path / options.pop("out", "stack.zarr")
    with pytest.raises(ArgumentError, match=words):
        impasto.ingest(stack(), out, **options)
    assert list(tmp_path.iterdir()) == []


def test_what_has_no_windows_is_refused(tmp_path: Path) -> None:
    """A lazy stack, or an array: with what to do instead."""
    samples = dask.array.from_array(stack().samples)
    lazy = impasto.LazyStack(samples, lights=stack().rig, scale=1 / 4095)
    with pytest.raises(
        ArgumentError, match=r"source: impasto.ingest cannot .*LazyStack; .*the files"
    ):
        impasto.ingest(lazy, tmp_path / "a.zarr")  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match=r"source: impasto.ingest cannot read a nd"):
        impasto.ingest(stack().samples, tmp_path / "a.zarr")  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_is_not_replaced(tmp_path: Path) -> None:
    out = impasto.ingest(stack(), tmp_path / "stack.zarr")
    with pytest.raises(ArgumentError, match=r"out: .*stack\.zarr exists"):
        impasto.ingest(stack(), out)
    with pytest.raises(CorruptInputError, match=r"holds impasto\.Stack: photographs, not"):
        impasto.load_sbrdf(out)
    sbrdf = impasto.fit_sbrdf(stack(), pooling="none", normals="least-squares")
    sbrdf.save(tmp_path / "sbrdf.zarr")
    sbrdf.save(tmp_path / "sbrdf.npz")
    for name in ("sbrdf.zarr", "sbrdf.npz"):
        words = r"holds the result of a fit \(impasto\.PooledSbrdf\), .*; impasto render, view"
        with pytest.raises(CorruptInputError, match=words):
            impasto.read_stack(tmp_path / name)
    write_stack(tmp_path / "stack.npz", stack())
    with pytest.raises(CorruptInputError, match=r"npz: holds impasto\.Stack: photographs, not"):
        impasto.load_sbrdf(tmp_path / "stack.npz")
    with pytest.raises(ArgumentError, match=r"encoding: .* holds a finished stack"):
        impasto.read_stack(out, encoding="srgb")


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_stack(tmp_path / "stack.npz", stack())
    words = ["ingest", str(tmp_path / "stack.npz"), "--out", str(tmp_path / "stack.zarr")]
    assert main(words) == 0
    assert capsys.readouterr().out == ""
    assert_same(impasto.read_stack(tmp_path / "stack.zarr"), stack())
    assert "--out: " in complaint(words, 1, capsys)
    fit = ["fit", str(tmp_path / "stack.zarr"), "--out", str(tmp_path / "fit"), "--pooling", "none"]
    assert main([*fit, "--method", "least-squares"]) == 0
    assert (tmp_path / "fit" / "sbrdf.npz").exists()
