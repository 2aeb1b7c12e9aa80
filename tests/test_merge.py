"""Overlapping frames of one painting become one result.

The truth is a simulated painting that was photographed in six parts (``overlapping_frames.py``),
and results that are cut into overlapping parts, whose merge must be the whole again.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

import impasto
from command_line import complaint
from failing_steps import Steps, counted
from impasto import simulate
from impasto.cli import main
from impasto.cli.codes import Exit
from impasto.merge.resampling import Samples
from killed_jobs import tree
from overlapping_frames import Scene, at_places, rotation, scene, two_by_three

SIZE, FRAME = (132, 182), (86, 88)


@pytest.fixture(scope="module")
def taken() -> Scene:
    return scene(SIZE, FRAME, two_by_three(SIZE, FRAME), lights=9, fine=2)


@pytest.fixture(scope="module")
def fits(taken: Scene) -> list[impasto.PooledSbrdf]:
    return [impasto.fit_sbrdf(stack, pooling="painting") for stack in taken.stacks]


@pytest.fixture(scope="module")
def merged(fits: list[impasto.PooledSbrdf]) -> impasto.Merged:
    return impasto.merge(fits, white=0)


@pytest.fixture(scope="module")
def lobed(taken: Scene) -> impasto.LobeSbrdf:
    """A part of the painting with lobes per pixel, and a gap."""
    x, y = np.meshgrid(np.arange(30.0, 150.0), np.arange(30.0, 100.0))
    normal, colours = (
        at_places(planes, x, y, taken.fine) for planes in (taken.normal, taken.diffuse)
    )
    lights = simulate.rig("tominaga-six-band-adaptation").directions
    surface = impasto.Surface.torrance_sparrow(
        normal / np.linalg.norm(normal, axis=0), colours, 2.0, 0.2
    )
    mask = np.ones((70, 120), np.bool_)
    mask[30:33, 60:64] = False
    stack = impasto.Stack(surface.predict(lights), lights=lights, mask=mask)
    return impasto.fit_sbrdf(stack, pooling="pixel", lobes=2, effort="draft")


@pytest.fixture(scope="module")
def again(lobed: impasto.LobeSbrdf) -> impasto.Merged:
    """Two parts of it, merged in memory."""
    return impasto.merge(parts(lobed))


def parts(whole: impasto.Sbrdf) -> list[Any]:
    return [whole[:, :75], whole[:, 45:]]


def degrees(one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
    across = np.linalg.norm(np.cross(one, other, axis=0), axis=0)
    return np.asarray(np.degrees(np.arctan2(across, np.sum(one * other, axis=0))))


@pytest.mark.slow
def test_six_frames_agree_at_their_seams(merged: impasto.Merged) -> None:
    """The bounds are those that a merge is held to: 0.2 dE00 and 0.1 degree.

    Before, neighbours differ by 1 to 6 dE00 and by 0.8 to 2.3 degrees: nothing is left undone.
    """
    seams = merged.report.seams
    assert {(seam.first, seam.second) for seam in seams} >= {
        (0, 1), (1, 2), (3, 4), (4, 5), (0, 3), (1, 4), (2, 5),
    }  # fmt: skip
    assert min(seam.colour_before for seam in seams) > 0.5
    assert min(seam.degrees_before for seam in seams) > 0.5
    assert max(seam.colour for seam in seams) < 0.2
    assert max(seam.degrees for seam in seams) < 0.1
    assert merged.report.warnings == ()


@pytest.mark.slow
def test_frames_lie_where_they_were_taken(taken: Scene, merged: impasto.Merged) -> None:
    """What patches of a seam leave decides.

    Its fourteen patches lie 17 pixels from their middle and miss each other by 0.009 pixels along
    either axis (root mean squares). They overlap: some four of them are independent. So a seam
    fixes scale and angle to 0.009 / (17 sqrt(4)) = 0.00026, and with that the first pixel, 62
    pixels from the middle of its frame, to 0.017. Frames are up to two seams away from the
    reference: 0.0004, and 0.025 pixels. Twice that is allowed.
    """
    first = taken.shots[0]
    x, y = (FRAME[1] - 1) / 2, (FRAME[0] - 1) / 2
    for shot, frame in zip(taken.shots, merged.report.frames, strict=True):
        assert frame.scale == pytest.approx(shot.scale, abs=0.0008)
        assert frame.angle == pytest.approx(shot.angle, abs=0.0008)
        # The first pixel lies up and left of the middle, rotated about it.
        cos, sin = shot.scale * np.cos(shot.angle), shot.scale * np.sin(shot.angle)
        left = shot.x - first.x - (cos * x + sin * y) + x
        top = shot.y - first.y - (cos * y - sin * x) + y
        assert frame.left - merged.report.frames[0].left == pytest.approx(left, abs=0.05)
        assert frame.top - merged.report.frames[0].top == pytest.approx(top, abs=0.05)


@pytest.mark.slow
def test_gains_and_tilts_are_those_of_the_frames(taken: Scene, merged: impasto.Merged) -> None:
    """Neither is further off than what is left at seams, even if all their pixels erred alike.

    The worst seam has 0.15 dE00, which is half a percent of the light of a middle grey (L* changes
    by 31 times the share). Errors of the two seams to the farthest frame add in squares: 0.7 %.
    Normals of seams that are a side of both frames differ by 0.05 degrees.
    """
    for shot, frame in zip(taken.shots, merged.report.frames, strict=True):
        np.testing.assert_allclose(np.array(frame.gain) * shot.gain, 1.0, atol=0.007)
        tilt = np.degrees(np.arccos(rotation(shot.tilt)[2, 2]))
        assert np.degrees(frame.tilt) == pytest.approx(tilt, abs=0.05)


@pytest.mark.slow
def test_the_merged_painting_is_as_true_as_its_frames(
    taken: Scene, fits: list[impasto.PooledSbrdf], merged: impasto.Merged
) -> None:
    """Normals and colours err about as those of the frames do, each in its own system.

    What is left at seams comes on top: 0.05 degrees to the 0.21 of a frame, 0.2 % (as of half a
    seam's difference) to its 0.47 %. Added in squares this is 3 % and 9 % more; a tenth is allowed,
    for interpolation, too. A frame that is not corrected errs by its tilt, a degree, and by its
    gain, a tenth.
    """
    assert isinstance(merged.sbrdf, impasto.Sbrdf)
    normal, diffuse = taken.truth(merged.report)
    angles, offs = [], []
    for index, fit in enumerate(fits):
        own_normal, own_diffuse = taken.truth_of(index)
        angles.append(degrees(fit.normal, own_normal))
        offs.append(np.abs(fit.diffuse / own_diffuse - 1.0))
    found = np.nanmedian(degrees(merged.sbrdf.normal, normal))
    assert found < 1.1 * np.median(angles)
    off = np.nanmedian(np.abs(merged.sbrdf.diffuse / diffuse - 1.0))
    assert off < 1.1 * np.median(offs)


@pytest.mark.slow
def test_parts_of_a_result_merge_to_the_whole(
    lobed: impasto.LobeSbrdf, again: impasto.Merged
) -> None:
    """The overlap is the same in both parts: nothing but rounding may change.

    Parts are placed to 6e-5 pixels everywhere (a shift by 2e-5, a scale that is 5e-7 off over 120
    pixels), so that maps change by that times their slopes. Neighbours differ by up to 5 standard
    deviations of a map (99 % of them), those of light samples by 0.15.
    """
    found = again.sbrdf
    assert isinstance(found, impasto.LobeSbrdf)
    assert again.report.shape == found.shape == lobed.shape
    np.testing.assert_array_equal(found.status, lobed.status)
    np.testing.assert_array_equal(found.lobes, lobed.lobes)
    for name in ("normal", "diffuse", "specular", "gamma", "ambient", "residual", "sigma"):
        one, other = getattr(found, name), getattr(lobed, name)
        np.testing.assert_array_equal(np.isnan(one), np.isnan(other), err_msg=name)
        scale = float(np.nanstd(other))
        assert np.nanquantile(np.abs(one - other), 0.99) < 3e-4 * scale, name
    light = [(0.3, 0.2, 0.9)]
    assert np.nanquantile(np.abs(found.predict(light) - lobed.predict(light)), 0.99) < 1e-5
    assert found.normals.status.tobytes() == lobed.normals.status.tobytes()


@pytest.mark.slow
def test_a_store_has_the_bytes_of_memory_whatever_its_tiles(
    lobed: impasto.LobeSbrdf, again: impasto.Merged, tmp_path: Path
) -> None:
    files = [tmp_path / "left.zarr", tmp_path / "right.npz"]
    for part, file in zip(parts(lobed), files, strict=True):
        part.rotated(0).save(file)
    whole = again.sbrdf
    assert isinstance(whole, impasto.LobeSbrdf)
    out = tmp_path / "merged.zarr"
    merged = impasto.merge(files, out, tile=50)
    assert isinstance(merged.sbrdf, impasto.StoredSbrdf)
    assert merged.sbrdf.tile == 50
    stored = impasto.load_sbrdf(out)
    for name, array in whole.arrays().items():
        assert np.asarray(array).tobytes() == np.asarray(stored.arrays()[name]).tobytes(), name
    # The names of frames are those of their files.
    said = json.loads((out / "merge" / "report.json").read_text("utf-8"))
    assert said == merged.report.to_dict()
    assert merged.sbrdf.factors == (2, 4)
    part = merged.sbrdf[10:20, 30:50]
    assert part.rig.origin == whole[10:20, 30:50].rig.origin
    with pytest.raises(impasto.ArgumentError, match=r"merged\.zarr exists; remove it"):
        impasto.merge(files, out)


@pytest.mark.slow
def test_lafortune_lobes_merge_and_lamps_stand_where_they_stood(
    taken: Scene, tmp_path: Path
) -> None:
    """Frames with a rig of their own: that of the reference, whose middle is not the painting's."""
    fits = [
        impasto.fit_sbrdf(stack, model="lafortune", lobes=1, effort="draft")
        for stack in taken.stacks[:2]
    ]
    merged = impasto.merge(fits)
    assert isinstance(merged.sbrdf, impasto.LafortuneSbrdf)
    # Patches of frames with other lobes miss each other by 0.013 pixels, 0.009 along either axis
    # (above). A draft has more noise: half as much again is allowed.
    assert max(seam.shift for seam in merged.report.seams) < 0.02
    (rows, columns), own = merged.sbrdf.shape, fits[0].shape
    first = merged.report.frames[0]
    right = (columns - own[1]) / 2 - round(first.left)
    up = round(first.top) - (rows - own[0]) / 2
    assert merged.sbrdf.rig.origin == (right, up) != (0.0, 0.0)
    stored = impasto.merge(fits, tmp_path / "merged.zarr", tile=64).sbrdf
    assert stored.rig.origin == merged.sbrdf.rig.origin
    loaded = impasto.load_sbrdf(tmp_path / "merged.zarr")
    assert loaded.predict([(0.3, 0.2, 0.9)]).tobytes() == merged.sbrdf.predict(
        [(0.3, 0.2, 0.9)]
    ).tobytes()  # fmt: skip


@pytest.mark.slow
def test_a_gap_of_one_frame_is_filled_by_the_other(lobed: impasto.LobeSbrdf) -> None:
    """A gap of both stays as it is; neither spreads."""
    left, right = parts(lobed)
    gap = np.zeros(left.shape, np.bool_)
    gap[10:14, 50:58] = True
    unknown = {
        name: np.where(gap, np.float32(np.nan), getattr(left, name))
        for name in ("normal", "diffuse", "specular", "gamma", "ambient", "residual", "sigma")
    }
    codes = {
        "status": np.where(gap, np.uint8(21), left.status),
        "lobes": np.where(gap, np.uint8(0), left.lobes),
    }
    holed = replace(left, **unknown, **codes, normals=left.normals.within(~gap))
    merged = impasto.merge([right, holed], reference=1)
    assert isinstance(merged.sbrdf, impasto.Sbrdf)
    top, left_ = (round(merged.report.frames[1].top), round(merged.report.frames[1].left))
    found = merged.sbrdf[top : top + 70, left_ : left_ + 120]
    np.testing.assert_array_equal(found.status, lobed.status)
    np.testing.assert_array_equal(np.isnan(found.normal), np.isnan(lobed.normal))


def test_frames_of_other_paintings_are_named(lobed: impasto.LobeSbrdf) -> None:
    left, right = parts(lobed)
    rng = np.random.default_rng(1)
    other = replace(right, diffuse=rng.uniform(0.1, 0.9, right.diffuse.shape).astype(np.float32))
    with pytest.raises(impasto.ArgumentError, match="frame 1 shares too little with the frames"):
        impasto.merge([left, other])


def test_what_cannot_be_merged_is_refused(lobed: impasto.LobeSbrdf) -> None:
    left, right = parts(lobed)
    with pytest.raises(impasto.ArgumentError, match="frames: expected two or more"):
        impasto.merge([left])
    with pytest.raises(impasto.ArgumentError, match="frames: frame 2 is given twice; leave one"):
        impasto.merge([left, right, left])
    with pytest.raises(impasto.ArgumentError, match="frames: number 1 is int"):
        impasto.merge([left, 3])  # type: ignore[list-item]
    with pytest.raises(impasto.ArgumentError, match="reference: expected the number of a frame"):
        impasto.merge([left, right], reference=2)
    with pytest.raises(impasto.ArgumentError, match="frame 1 has the bands red, but frame 0"):
        impasto.merge([left, right.with_bands([0])])
    with pytest.raises(impasto.ArgumentError, match="index differs"):
        impasto.merge([left, replace(right, index=1.6)])


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("merged.tif", r"out: expected a name ending in \.zarr"),
        ("a\0.zarr", "out: .* is no name of a file"),
        ("none/a.zarr", "out: the folder .*none does not exist"),
        ("link.zarr", "out: .* is a link to nothing"),
    ],
    ids=["suffix", "zero", "folder", "link"],
)
def test_a_name_that_no_store_can_have_is_refused_before_frames_are_registered(
    name: str, words: str, lobed: impasto.LobeSbrdf, tmp_path: Path
) -> None:
    (tmp_path / "link.zarr").symlink_to(tmp_path / "nowhere.zarr")
    done: list[int] = []
    with pytest.raises(impasto.ArgumentError, match=words):
        impasto.merge(parts(lobed), tmp_path / name, progress=lambda count, _: done.append(count))
    assert done == []
    assert [path.name for path in tmp_path.iterdir()] == ["link.zarr"]


def test_cubics_are_interpolated_exactly() -> None:
    """Six points make a kernel that is exact for cubics, up to rounding of single precision."""
    y, x = np.mgrid[:20, :30].astype(np.float64)

    def cubic(x: NDArray[Any], y: NDArray[Any]) -> NDArray[Any]:
        u, v = x / 30, y / 20
        return 1 + u - 2 * v + 3 * u * v**2 + u**3 - v**3 + 2 * u**2

    rng = np.random.default_rng(0)
    right, down = rng.uniform(3, 26, 500), rng.uniform(3, 16, 500)
    found = Samples.at(right, down, (20, 30)).interpolated(cubic(x, y)[None].astype(np.float32))
    np.testing.assert_allclose(found[0], cubic(right, down), atol=4e-7)


def test_unknown_pixels_do_not_spread() -> None:
    """A place is unknown exactly where its nearest pixel is; others hold numbers of neighbours."""
    plane = np.random.default_rng(0).uniform(1, 2, (1, 20, 20)).astype(np.float32)
    plane[0, 8:11, 9:12] = np.nan
    y, x = (one.ravel() + 0.3 for one in np.mgrid[0:19, 0:19].astype(np.float64))
    found = Samples.at(x, y, (20, 20)).interpolated(plane)[0].reshape(19, 19)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(plane[0, :19, :19]))
    beside = found[7:12, 8:13]
    assert np.nanmin(beside) >= 1.0
    assert np.nanmax(beside) <= 2.0


@pytest.mark.slow
def test_merging_on_the_command_line(
    lobed: impasto.LobeSbrdf, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [str(tmp_path / name) for name in ("left.npz", "right.npz")]
    for part, file in zip(parts(lobed), files, strict=True):
        part.save(file)
    out = tmp_path / "merged.zarr"
    assert main(["job", "merge", *files, "--out", str(out)]) == 0
    assert "seam" in capsys.readouterr().out
    assert main(["info", str(out)]) == 0
    # Also by the name that it had until it was whole.
    for name in (out, out.with_name(f"{out.name}.partial")):
        assert main(["job", "verify", str(name)]) == 0
        assert f"{out}: all files are as written" in capsys.readouterr().out
    report = out / "merge" / "report.json"
    data = report.read_bytes()
    report.write_bytes(data + b" ")
    assert main(["job", "verify", f"{out}.partial"]) == Exit.CORRUPT_INPUT
    assert f"{out}: 1 file is not as written" in capsys.readouterr().err
    report.write_bytes(data)
    said = complaint(["job", "merge", *files, "--out", str(out)], 1, capsys)
    assert "exists; remove it" in said
    said = complaint(["job", "merge", files[0], "--out", str(tmp_path / "b.zarr")], 1, capsys)
    assert "expected two or more to merge, found 1" in said


def test_an_interrupted_merge_goes_on_to_the_same_bytes(
    lobed: impasto.LobeSbrdf, tmp_path: Path
) -> None:
    whole = tmp_path / "whole.zarr"
    impasto.merge(parts(lobed), whole, tile=48)
    out, partial = tmp_path / "merged.zarr", tmp_path / "merged.zarr.partial"

    def stop(done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        impasto.merge(parts(lobed), out, tile=48, progress=stop)
    with pytest.raises(impasto.ArgumentError, match=r"merged\.zarr is not finished.*same call"):
        impasto.open_sbrdf(out)
    other = [lobed[:, :75], replace(lobed, diffuse=lobed.diffuse * np.float32(0.5))[:, 45:]]
    with pytest.raises(impasto.ResumeMismatchError, match="of other frames"):
        impasto.merge(other, out, tile=48)
    # One of the tiles was torn, as by a failing disk, and one was being written.
    shard = partial / "normal/c/0/0/1"
    shard.write_bytes(shard.read_bytes()[:-9])
    (partial / "normal/c/0/0/.2-abc.tmp").write_bytes(b"half")
    done: list[int] = []
    # By the name that the folder shows.
    impasto.merge(parts(lobed), partial, tile=48, progress=lambda count, _: done.append(count))
    assert done[:2] == [0, 2], "two tiles are kept"
    assert tree(out) == tree(whole)
    assert impasto.jobs.verify(out) == ()


LAST = (
    "fsync a.zarr.partial",
    *(f"unlink a.zarr.partial/merge/{name}" for name in ("numbers.npz", "pace.jsonl")),
    "unlink a.zarr.partial/merge/journal.jsonl",
    "fsync a.zarr.partial/merge",
    "rename a.zarr.partial",
)
"""Steps of a merge after all of its files are written."""


class Whole(NamedTuple):
    """A merged store, and how often each step of :data:`LAST` was taken until it was the last."""

    store: Path
    counts: dict[str, int]


@pytest.fixture(scope="module")
def six(lobed: impasto.LobeSbrdf, tmp_path_factory: pytest.TempPathFactory) -> Whole:
    """Of six tiles."""
    out = tmp_path_factory.mktemp("whole") / "a.zarr"
    with counted(Steps(out.parent)) as steps:
        impasto.merge(parts(lobed), out, tile=48)
    end = steps.taken.index(LAST[-1]) + 1
    before, last = steps.taken[: end - len(LAST)], steps.taken[end - len(LAST) : end]
    assert tuple(last) == LAST
    # All that the journal tells of is on the disk before it goes; the new name comes after that.
    folders = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_dir()}
    assert set(before[-len(folders) :]) == {f"fsync a.zarr.partial/{name}" for name in folders}
    return Whole(out, {step: steps.taken[:end].count(step) for step in LAST})


@pytest.mark.parametrize("failing", LAST)
def test_a_merge_whose_last_steps_fail_blends_no_tile_again(
    failing: str, six: Whole, lobed: impasto.LobeSbrdf, tmp_path: Path
) -> None:
    out = tmp_path / "a.zarr"
    done: list[int] = []
    with (
        counted(Steps(tmp_path, (failing, six.counts[failing]))) as steps,
        pytest.raises(OSError, match=r"a\.zarr"),
    ):
        impasto.merge(parts(lobed), out, tile=48)
    assert steps.failed == failing
    assert not out.exists()
    if failing == LAST[-1]:
        assert not (tmp_path / "a.zarr.partial/merge/journal.jsonl").exists()
        other = [lobed[:, :75], replace(lobed, diffuse=lobed.diffuse * np.float32(0.5))[:, 45:]]
        with pytest.raises(impasto.ResumeMismatchError, match="of other frames"):
            impasto.merge(other, out, tile=48)
    impasto.merge(parts(lobed), out, tile=48, progress=lambda count, _: done.append(count))
    assert done == [0, 6]
    assert tree(out) == tree(six.store)


def test_a_whole_merge_without_its_journal_that_has_changed_is_made_anew(
    six: Whole, lobed: impasto.LobeSbrdf, tmp_path: Path
) -> None:
    out, partial = tmp_path / "a.zarr", tmp_path / "a.zarr.partial"
    for name in ("normal/c/0/0/1", "checksums.json"):
        shutil.copytree(six.store, partial)
        data = bytearray((partial / name).read_bytes())
        data[len(data) // 2] ^= 1
        (partial / name).write_bytes(data)
        impasto.merge(parts(lobed), out, tile=48)
        assert tree(out) == tree(six.store), name
        shutil.rmtree(out)


def test_a_merge_whose_name_another_has_meanwhile_is_refused_before_it_blends(
    lobed: impasto.LobeSbrdf, tmp_path: Path
) -> None:
    """The other one ends while the frames are registered."""
    out, done = tmp_path / "merged.zarr", []

    def other_ends(count: int, total: int) -> None:
        if not done:
            impasto.merge(parts(lobed), out, tile=128)
        done.append(count)

    with pytest.raises(impasto.ArgumentError, match=r"merged\.zarr exists; remove it or give"):
        impasto.merge(parts(lobed), out, tile=48, progress=other_ends)
    assert done == [0]
    assert [path.name for path in tmp_path.iterdir()] == ["merged.zarr"]
    assert impasto.jobs.verify(out) == ()


def test_an_unfinished_job_is_not_merged_into(lobed: impasto.LobeSbrdf, tmp_path: Path) -> None:
    (tmp_path / "a.zarr.partial" / "job").mkdir(parents=True)
    with pytest.raises(impasto.ResumeMismatchError, match=r"a\.zarr\.partial is there and is no"):
        impasto.merge(parts(lobed), tmp_path / "a.zarr")


def test_every_change_of_a_merged_store_is_found(lobed: impasto.LobeSbrdf, tmp_path: Path) -> None:
    """A bit of any file, one deleted, two exchanged, one too many, a link."""
    out = tmp_path / "merged.zarr"
    impasto.merge(parts(lobed), out, tile=64)
    assert impasto.jobs.verify(out) == ()
    rng = np.random.default_rng(11)
    files = sorted(path for path in out.rglob("*") if path.is_file())
    for path in files:
        data = path.read_bytes()
        changed = bytearray(data)
        changed[rng.integers(len(data))] ^= 1 << rng.integers(8)
        path.write_bytes(changed)
        found = {one.file for one in impasto.jobs.verify(out)}
        assert str(path) in found, "a list that is damaged is named itself"
        path.write_bytes(data)
    one, other = out / "normal/c/0/0/0", out / "normal/c/0/0/1"
    one.rename(tmp_path / "kept")
    assert [str(found) for found in impasto.jobs.verify(out)] == [f"{one}: is missing"]
    one.symlink_to(tmp_path / "kept")
    assert "is a link" in str(impasto.jobs.verify(out)[0])
    one.unlink()
    other.rename(one)
    (tmp_path / "kept").rename(other)
    assert {found.file for found in impasto.jobs.verify(out)} == {str(one), str(other)}
    other.rename(tmp_path / "kept")
    one.rename(other)
    (tmp_path / "kept").rename(one)
    (out / "more").write_bytes(b"")
    (more,) = impasto.jobs.verify(out)
    assert str(more) == f"{out / 'more'}: does not belong to the store"
