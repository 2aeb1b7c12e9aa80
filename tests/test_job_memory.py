"""The memory of a job: which tiles it gives, and that a job goes on with what it had."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import impasto
from impasto import ArgumentError, ImpastoWarning, jobs
from impasto._internal.memory import DEFAULT_MEMORY
from impasto.cli import main
from impasto.fit.lobes import HALO
from impasto.io import write_stack
from impasto.jobs import beginning, repeat
from impasto.jobs.grid import Footprint, bytes_of, stride_for, tile_for
from impasto.jobs.learning import border_of, checked_fit
from impasto.jobs.memory import MEMORY
from interrupted_jobs import interrupting
from killed_jobs import OPTIONS, stack, tree

pytest.importorskip("fcntl", reason="jobs need POSIX")


def test_tiles_follow_from_the_memory() -> None:
    # 16 lights, 6 bands, 16 bits.
    pixel = Footprint(samples=192, codes=192, observations=16, bands=6)
    # Of maps 120 + 6 * 4 * 7 bytes, of residuals 6 * 16 * 2.
    assert pixel.of_tile((1, 1), (1, 1)) == 768 + 4 * 288 + 6 * 192
    # Two bordered copies of the samples, and one as they stand in the files.
    assert pixel.of_tile((64, 64), (94, 94)) == 94**2 * 576 + 64**2 * (192 + 4 * 288 + 6 * 192)
    for border, side in ((0, 832), (15, 768)):
        assert tile_for(2**31, pixel, (1, 1), border) == side
        for larger in (0, 64):
            tile, read = side + larger, side + larger + 2 * border
            assert (pixel.of_tile((tile, tile), (read, read)) > 2**31) == bool(larger)
        assert tile_for(2**31, pixel, (512, 512), border) == 512
        assert tile_for(2**31, pixel, (1, 8192), border) == side
        assert tile_for(2**40, pixel, (1, 1), border) == 1024
    assert border_of(checked_fit({})) == border_of(checked_fit({"pooling": "pixel"})) == HALO
    assert border_of(checked_fit({"pooling": "painting"})) == 0
    assert border_of(checked_fit({"effort": impasto.Effort(start="multistart")})) == 0
    assert border_of(checked_fit({"model": "lafortune"})) == 0
    assert stride_for(2**31, pixel, (1000, 1000), 1) == 1
    assert stride_for(2**31, pixel, (1000, 1000), 3) == 3
    # 672 bytes of each pixel that is learned from: 3,196,000 fit, every 18.3th row and column.
    assert stride_for(2**31, pixel, (32768, 32768), 1) == 19
    # Half of what a job has: of a tile of 32 rows and columns, no longer one of 48.
    half = pixel.of_tile((32, 32), (62, 62))
    with pytest.raises(ArgumentError, match=r"MiB; give .*smaller.*\(tile=32, --tile 32\)$"):
        tile_for(half, pixel, (1, 1), 15)
    with pytest.raises(ArgumentError, match=r"give more memory$"):
        tile_for(1000, pixel, (1, 1), 15)
    assert bytes_of("4GiB") == 2**32
    assert bytes_of("1.5 MB") == 1_500_000
    assert bytes_of(7) == 7
    assert bytes_of("4G") == bytes_of("4096 m") == 2**32


@pytest.fixture
def unfinished(tmp_path: Path) -> Path:
    """A job of photographs in a file that had another memory than the default."""
    out = tmp_path / "painting.zarr"
    write_stack(tmp_path / "painting.npz", stack())
    with interrupting(3) as stop:
        impasto.run(tmp_path / "painting.npz", out, memory="96MiB", progress=stop, **OPTIONS)
    return out


@pytest.fixture
def budgets(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The bytes that resumed jobs are given."""
    found: list[int] = []
    carry_out = repeat.carry_out

    def noted(*given: Any) -> Path:
        found.append(given[-1].memory)
        return carry_out(*given)

    monkeypatch.setattr(repeat, "carry_out", noted)
    return found


def test_a_job_goes_on_with_the_memory_that_it_had(
    unfinished: Path, tmp_path: Path, budgets: list[int]
) -> None:
    assert jobs.status(unfinished).memory == 96 << 20
    assert jobs.verify(unfinished) == ()
    jobs.resume(unfinished)
    assert budgets == [96 << 20]
    # The finished store does not say in which memory it was made.
    assert jobs.status(unfinished).memory is None
    whole = impasto.run(tmp_path / "painting.npz", tmp_path / "whole.zarr", **OPTIONS)
    assert tree(unfinished) == tree(whole)


def test_another_memory_is_kept_instead(
    unfinished: Path, budgets: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    # From the first moment: photographs are hashed for hours.
    with monkeypatch.context() as patched:
        patched.setattr(beginning.Beginning, "hashes", interrupted)
        with pytest.raises(KeyboardInterrupt):
            jobs.resume(unfinished, memory="80MiB")
    assert jobs.status(unfinished).memory == 80 << 20
    jobs.resume(unfinished)
    assert budgets == [80 << 20]


@pytest.mark.parametrize(
    "text", [None, "", "{}", "[1]", '{"bytes": "many"}', '{"bytes": 1e999}', '{"bytes": -1}']
)
def test_a_job_that_does_not_say_its_memory_has_the_default(
    text: str | None, unfinished: Path, budgets: list[int]
) -> None:
    kept = unfinished.with_name("painting.zarr.partial") / "job" / MEMORY
    kept.unlink()
    if text is not None:
        kept.write_text(text)
    assert jobs.status(unfinished).memory is None
    jobs.resume(unfinished)
    assert budgets == [bytes_of(DEFAULT_MEMORY)]


def test_the_command_line_shows_the_memory_and_the_model(
    unfinished: Path, capsys: pytest.CaptureFixture[str], budgets: list[int]
) -> None:
    assert main(["job", "status", str(unfinished)]) == 0
    assert "\nmemory      0.0938 GiB\n" in capsys.readouterr().out
    assert main(["job", "status", str(unfinished), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["memory"], told["model"]) == (96 << 20, "photometric stereo alone")
    assert main(["job", "resume", str(unfinished), "--quiet"]) == 0
    assert budgets == [96 << 20]


def test_tiles_that_are_too_large_for_less_memory_are_told(unfinished: Path) -> None:
    with pytest.warns(ImpastoWarning, match="tiles of this job keep their 64 x 64 pixels"):
        jobs.resume(unfinished, memory="1MB")


@pytest.mark.parametrize(
    ("size", "read"), [((64, 64), (64, 64)), ((64, 200), (64, 94)), ((200, 70), (94, 70))]
)
def test_the_border_of_a_tile_ends_with_the_painting(
    size: tuple[int, int], read: tuple[int, int]
) -> None:
    pixel = Footprint(samples=192, codes=192, observations=16, bands=6)
    photographs: Any = SimpleNamespace(pixel=pixel)
    record: Any = SimpleNamespace(tile=64, shape=(16, 6, *size), fit=checked_fit({}))
    needed = pixel.of_tile((64, 64), read)
    with pytest.warns(ImpastoWarning, match="tiles of this job"):
        repeat._warn_of_memory(needed - 1, photographs, record)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        repeat._warn_of_memory(needed, photographs, record)
