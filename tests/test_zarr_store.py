"""Results as Zarr stores: what was saved is loaded bit for bit, or a damaged file is named."""

from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

import impasto
from impasto import ArgumentError, CorruptInputError
from impasto.io.results.zarr_arrays import ZarrArray, inner_of
from impasto.io.results.zarr_store import is_usual, read_window
from killed_jobs import stack, tree

FITS: dict[str, dict[str, Any]] = {
    "none": {"pooling": "none"},
    "painting": {"pooling": "painting", "residuals": True},
    "pixel": {"pooling": "pixel", "effort": "draft"},
    "segment": {"pooling": "segment", "segments": np.arange(70 * 90).reshape(70, 90) // 3200},
    "lafortune": {"model": "lafortune", "lobes": 1, "effort": "draft"},
}


SAME = ("albedo", "normal", "residual", "sigma", "status")
"""Maps of photometric stereo that are those of a result without a lobe."""


@pytest.fixture(scope="module")
def result() -> impasto.Sbrdf:
    return impasto.fit_sbrdf(stack(), pooling="none")


@pytest.fixture(scope="module")
def saved(result: impasto.Sbrdf, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("saved") / "painting.impasto.zarr"
    result.save(path)
    return path


@pytest.fixture
def store(saved: Path, tmp_path: Path) -> Path:
    """A copy to be damaged."""
    path = tmp_path / saved.name
    shutil.copytree(saved, path)
    return path


def arrays(result: Any) -> dict[str, tuple[Any, ...]]:
    return {
        name: (array.dtype.kind, array.shape, array.tobytes())
        for name, array in result.arrays().items()
    }


@pytest.mark.parametrize("fit", FITS)
def test_a_store_holds_what_a_file_holds(fit: str, tmp_path: Path) -> None:
    found: Any = impasto.fit_sbrdf(stack(), **FITS[fit])
    found.save(tmp_path / "fit.npz")
    found.save(tmp_path / "fit.zarr")
    one = impasto.load_sbrdf(tmp_path / "fit.npz")
    two = impasto.load_sbrdf(tmp_path / "fit.zarr")
    assert type(one) is type(two) is type(found)
    assert arrays(one) == arrays(two) == arrays(found)


def test_any_zarr_reads_the_maps(result: impasto.Sbrdf, saved: Path) -> None:
    group = zarr.open_group(saved, mode="r")
    assert group["normal"][...].tobytes() == result.normal.tobytes()
    assert group["status"][3, 4] == result.status[3, 4]
    assert np.isnan(group["normal"].fill_value)
    assert group["status"].fill_value == 255
    assert group["normal"].shards == (3, 128, 128)
    listed = json.loads((saved / "zarr.json").read_text())["attributes"]["impasto"]["arrays"]
    own = {name for name, entry in listed.items() if "same_as" not in entry}
    assert {name for name, _ in group.arrays()} == own
    # Without a lobe the result is that of photometric stereo, and is there once.
    assert listed.keys() - own == {f"normals.{n}" for n in SAME}


def test_maps_that_are_others_are_stored_once(result: impasto.Sbrdf, saved: Path) -> None:
    found = impasto.load_sbrdf(saved)
    assert found.normals.albedo.tobytes() == result.normals.albedo.tobytes() != b""
    part = impasto.open_sbrdf(saved)[3:20, 5:60]
    assert part.normals.normal.tobytes() == result.normals.normal[:, 3:20, 5:60].tobytes()
    # Only what is the same array: like numbers may be a coincidence.
    alike = replace(result, diffuse=result.diffuse.copy())
    alike.save(saved.with_name("alike.zarr"))
    assert (saved.with_name("alike.zarr") / "normals.albedo").is_dir()


def chunks_of(file: bytes, across: int) -> list[bytes | None]:
    """Inner chunks of a shard by its index, as the specification of sharding_indexed has it."""
    index = np.frombuffer(file[-16 * across * across - 4 : -4], "<u8").reshape(-1, 2)
    absent = 2**64 - 1
    return [
        None if place == absent else file[place : place + length]
        for place, length in index.tolist()
    ]


@pytest.mark.parametrize("size", [(256, 256), (100, 130), (1, 256)])
@pytest.mark.parametrize("dtype", ["float32", "uint8", "float64"])
def test_shards_hold_what_the_zarr_library_puts_into_them(
    size: tuple[int, int], dtype: str, tmp_path: Path
) -> None:
    values = (np.arange(17 * 256 * 256) % 199).reshape(17, 256, 256)[:, : size[0], : size[1]]
    values = values.astype(dtype)
    array = ZarrArray("map", values.shape, values.dtype, 256)
    (tmp_path / "map").mkdir()
    (tmp_path / "map" / "zarr.json").write_bytes(array.metadata)
    zarr.open_array(tmp_path / "map", mode="r+", config={"write_empty_chunks": True})[...] = values
    theirs = chunks_of((tmp_path / array.path(0, 0)).read_bytes(), 256 // array.inner)
    ours = chunks_of(bytes(array.encoded(values)), 256 // array.inner)
    assert ours == theirs
    assert ours[0] is not None


def test_saving_twice_gives_the_same_bytes(
    result: impasto.Sbrdf, saved: Path, tmp_path: Path
) -> None:
    result.save(tmp_path / "again.zarr")
    assert tree(tmp_path / "again.zarr") == tree(saved)
    # An older result is replaced, and nothing is left beside it.
    replace(result, diffuse=2.0 * result.diffuse).save(tmp_path / "again.zarr")
    assert tree(tmp_path / "again.zarr") != tree(saved)
    result.save(tmp_path / "again.zarr")
    assert tree(tmp_path / "again.zarr") == tree(saved)
    assert [path.name for path in tmp_path.iterdir()] == ["again.zarr"]


def flip(path: Path, at: int = -1) -> None:
    data = bytearray(path.read_bytes())
    data[at if at >= 0 else len(data) // 2] ^= 1
    path.write_bytes(data)


def without_a_chunk(path: Path) -> None:
    """The shard says that it does not hold its first chunk, as writers do for empty ones."""
    index = np.full((1, 2), 2**64 - 1, "<u8").tobytes()
    import google_crc32c

    sum_ = google_crc32c.Checksum(index).digest()[::-1]
    path.write_bytes(path.read_bytes()[: -len(index) - 4] + index + sum_)


def attributes(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    group = json.loads(path.read_text())
    change(group["attributes"]["impasto"])
    path.write_text(json.dumps(group))


DAMAGE: dict[str, tuple[Callable[[Path], object], str]] = {
    "a bit of a map": (lambda s: flip(s / "normal/c/0/0/0"), "normal/c/0/0/0: is damaged: the che"),
    "a bit of an index": (lambda s: flip(s / "normal/c/0/0/0", -1 + (s / "normal/c/0/0/0").stat()
        .st_size), "normal/c/0/0/0: is damaged"),
    "a bit of a number": (lambda s: flip(s / "beta/c", 3), "beta: is damaged"),
    "a bit of a rig": (lambda s: flip(s / "rig.lights/c/0/0"), "rig.lights: is damaged"),
    "a map deleted": (lambda s: (s / "sigma/c/0/0").unlink(), "sigma/c/0/0: is missing"),
    "a number deleted": (lambda s: (s / "gamma/c").unlink(), "gamma/c: is missing"),
    "an array deleted": (lambda s: shutil.rmtree(s / "diffuse"), "diffuse/zarr.json: is missing"),
    "a map truncated": (
        lambda s: (s / "diffuse/c/0/0/0").write_bytes(b"\\0" * 9),
        "diffuse/c/0/0/0: is truncated: it lacks 1 of its chunks",
    ),
    "a chunk that a shard does not hold": (
        lambda s: without_a_chunk(s / "status/c/0/0"),
        "status/c/0/0: is truncated: it lacks 1",
    ),
    "a number truncated": (lambda s: (s / "beta/c").write_bytes(b""), "beta/c: is truncated"),
    "a link": (
        lambda s: ((s / "beta/c").unlink(), (s / "beta/c").symlink_to("/dev/zero")),
        "beta/c: is no file",
    ),
    "a description": (
        lambda s: (s / "normal/zarr.json").write_text("{"),
        "normal: is damaged",
    ),
    "another size": (
        lambda s: (s / "normal/zarr.json").write_text(
            (s / "normal/zarr.json").read_text().replace("70", "71")
        ),
        r"normal: is damaged \(float32 \(3, 71, 90\)",
    ),
    "no description": (lambda s: (s / "zarr.json").unlink(), "is no result of impasto"),
    "text": (
        lambda s: attributes(s / "zarr.json", lambda own: own["text"].update(verdict="fitted")),
        "zarr.json: is damaged: its checksum does not agree",
    ),
    "one array less": (
        lambda s: attributes(s / "zarr.json", lambda own: own["arrays"].pop("beta")),
        "its checksum does not agree",
    ),
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGE)
def test_damage_is_found_and_named(damage: str, store: Path) -> None:
    act, words = DAMAGE[damage]
    act(store)
    with pytest.raises(CorruptInputError, match=words) as error:
        impasto.load_sbrdf(store)
    assert str(store) in str(error.value)


@pytest.mark.filterwarnings("ignore::zarr.errors.ZarrUserWarning")
def test_other_stores_are_refused_and_left_alone(result: impasto.Sbrdf, tmp_path: Path) -> None:
    foreign = tmp_path / "foreign.zarr"
    zarr.open_group(foreign, mode="w", zarr_format=3).create_array("normal", data=np.eye(3))
    before = tree(foreign)
    with pytest.raises(CorruptInputError, match=r"foreign\.zarr: is no result of impasto"):
        impasto.load_sbrdf(foreign)
    with pytest.raises(ArgumentError, match="exists and is no result of impasto"):
        result.save(foreign)
    assert tree(foreign) == before
    (tmp_path / "file.zarr").write_bytes(b"PK")
    with pytest.raises(CorruptInputError, match="is no result of impasto"):
        impasto.load_sbrdf(tmp_path / "file.zarr")
    with pytest.raises(FileNotFoundError, match=r"nothing\.zarr"):
        impasto.load_sbrdf(tmp_path / "nothing.zarr")


def test_a_store_of_another_thing_is_refused(tmp_path: Path) -> None:
    impasto.learn_sbrdf(stack(), pooling="none").save(tmp_path / "learned.zarr")
    with pytest.raises(
        CorruptInputError, match=r"holds impasto\.LearnedModel, not the result of a fit"
    ):
        impasto.load_sbrdf(tmp_path / "learned.zarr")
    assert impasto.load_learned(tmp_path / "learned.zarr").extent == (70, 90)


@pytest.mark.parametrize("step", [1, 5, 30, 60])
def test_an_error_while_saving_leaves_the_older_result(
    step: int, result: impasto.Sbrdf, store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever flush fails, also one of the last: the older store is there, or the new one."""
    before, steps, flush = tree(store), [], os.fsync

    def full(handle: int) -> None:
        steps.append(handle)
        if len(steps) == step:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        flush(handle)

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left") as error:
        replace(result, diffuse=2.0 * result.diffuse).save(store)
    assert error.value.filename is not None
    assert tree(store) == before
    assert [path.name for path in store.parent.iterdir()] == [store.name]


def test_a_rename_that_fails_leaves_the_older_result(
    result: impasto.Sbrdf, store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, rename = tree(store), os.rename

    def refused(source: Any, target: Any, **options: Any) -> None:
        if str(source).endswith(".partial"):
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        rename(source, target, **options)

    monkeypatch.setattr(os, "rename", refused)
    with pytest.raises(OSError, match="Input/output"):
        replace(result, diffuse=2.0 * result.diffuse).save(store)
    assert tree(store) == before
    assert [path.name for path in store.parent.iterdir()] == [store.name]


@pytest.mark.parametrize(
    ("tile", "pixel", "inner"),
    [
        *[(33, 4, 33), (192, 4, 192), (1000, 4, 500), (1024, 4, 512), (1024, 1, 1024)],
        *[(1024, 12, 256), (1024, 192, 128), (192, 192, 96), (1000, 192, 125), (131, 192, 131)],
    ],
)
def test_inner_chunks_divide_a_tile(tile: int, pixel: int, inner: int) -> None:
    """They hold a megabyte at most, or 128 x 128 pixels."""
    assert inner_of(tile, pixel) == inner
    assert tile % inner == 0


@pytest.mark.parametrize("dtype", ["float16", "float32", "uint8", "uint16", "bool", "int64"])
def test_tiles_written_alone_are_those_of_the_whole(dtype: str, tmp_path: Path) -> None:
    """Also with tiles of several chunks, and tiles cut off by the border."""
    values = (np.arange(17 * 300 * 410) % 1999).reshape(17, 300, 410).astype(dtype)
    array = ZarrArray("map", values.shape, values.dtype, 256)
    (tmp_path / "map").mkdir()
    (tmp_path / "map" / "zarr.json").write_bytes(array.metadata)
    for name, (row, column) in reversed(list(array.paths())):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(array.encoded(values[(..., *array.window(row, column))], row, column))
        assert array.missing_chunks(path, row, column) == 0
        part = values[(..., *array.window(row, column))]
        pieces = b"".join(bytes(piece) for piece in array.pieces(part, row, column))
        assert pieces == path.read_bytes()
    found = zarr.open_array(tmp_path / "map", mode="r")
    assert found.dtype == values.dtype
    assert found[...].tobytes() == values.tobytes()


@pytest.mark.parametrize("dtype", ["float16", "float64", "uint16", "bool"])
def test_windows_of_what_the_zarr_library_wrote(dtype: str, tmp_path: Path) -> None:
    """Whole, across tiles and chunks, a pixel."""
    values = (np.arange(17 * 300 * 410) % 1999).reshape(17, 300, 410).astype(dtype)
    array = ZarrArray("map", values.shape, values.dtype, 256)
    (tmp_path / "map").mkdir()
    (tmp_path / "map" / "zarr.json").write_bytes(array.metadata)
    zarr.open_array(tmp_path / "map", mode="r+", config={"write_empty_chunks": True})[...] = values
    assert is_usual(tmp_path, array)
    for top, left, bottom, right in [(0, 0, 300, 410), (130, 200, 290, 409), (255, 256, 256, 257)]:
        part = slice(top, bottom), slice(left, right)
        found = read_window(tmp_path, array, *part)
        assert found.dtype == values.dtype
        assert found.tobytes() == np.ascontiguousarray(values[(..., *part)]).tobytes()
        some = read_window(tmp_path, array, *part, stride=7)
        assert some.tobytes() == np.ascontiguousarray(found[..., ::7, ::7]).tobytes()


def test_a_map_in_another_layout_is_read_by_zarr(tmp_path: Path) -> None:
    """Without checksums, as other programs write; the shape of its shards is that of our tiles."""
    values = np.random.default_rng(3).random((3, 64, 64), np.float32)
    array = ZarrArray("map", values.shape, values.dtype, 64)
    zarr.create_array(
        tmp_path / "map", data=values, shards=(3, 64, 64), chunks=(3, 32, 32), compressors=None,
        zarr_format=3,
    )  # fmt: skip
    assert not is_usual(tmp_path, array)
    found = read_window(tmp_path, array, slice(5, 50), slice(0, 64))
    assert found.tobytes() == np.ascontiguousarray(values[:, 5:50]).tobytes()


def test_importing_impasto_does_not_load_zarr() -> None:
    script = "import sys, impasto, impasto.jobs; print('zarr' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "False"


def test_a_store_without_zarr_says_so(
    result: impasto.Sbrdf, saved: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "zarr", None)
    words = r"a \.zarr result needs zarr, which is not installed: pip install 'impasto\[scale\]'"
    with pytest.raises(impasto.MissingExtraError, match=words):
        result.save(tmp_path / "painting.zarr")
    with pytest.raises(impasto.MissingExtraError, match=words):
        impasto.load_sbrdf(saved)
    assert list(tmp_path.iterdir()) == []


def test_saving_removes_nothing_that_is_not_its_own(result: impasto.Sbrdf, tmp_path: Path) -> None:
    path = tmp_path / "fit.zarr"
    result.save(path)
    (path / "notes.txt").write_text("of a conservator")
    with pytest.raises(ArgumentError, match=r"holds notes\.txt, which saving would remove"):
        result.save(path)
    (path / "notes.txt").unlink()
    (tmp_path / "link.zarr").symlink_to(path)
    result.save(tmp_path / "link.zarr")
    assert (tmp_path / "link.zarr").is_symlink()
    assert impasto.load_sbrdf(path).normal.tobytes() == result.normal.tobytes()
