"""Faults of files, disks and processes: told in words, and nothing is torn, mixed or lost."""

from __future__ import annotations

import errno
import json
import os
import resource
import signal
import stat
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

import impasto
import processes
from impasto.cli import main
from impasto.cli.folder import REPORT, check_listed, result_folder
from impasto.colour.session import read_display
from impasto.io import (
    atomic_bytes,
    atomic_path,
    read_camera,
    read_image,
    read_lights,
    read_spectra,
    write_exr,
    write_png16,
    write_tiff32,
)
from impasto.io.folders import new_folder
from impasto.io.results.zarr_store import ZarrStore
from impasto.report import report, write_report

LIGHTS = [(0.5, 0, 0.9), (0, 0.5, 0.9), (-0.5, 0, 0.9), (0, -0.5, 0.9), (0, 0, 1)]

# --- what parsers trip over


LONG = "9" * 5000
"""More digits than Python makes an integer of."""


@pytest.mark.parametrize(
    ("read", "name", "text"),
    [
        (read_lights, "a.lp", f"{LONG}\na.png 0 0 1\n"),
        (read_lights, "a.lp", "²\na.png 0 0 1\n"),
        (read_lights, "a.csv", "a,0,0,1\rb,0,0,1\r"),
        (read_lights, "a.csv", "a" * 200_000 + ",0,0,1\n"),
        (read_lights, "a.json", "[" * 100_000),
        (read_lights, "a.dome", '{"a":' * 100_000),
        (read_lights, "a.dome", f'{{"directions": [[{LONG}, 0, 1]]}}'),
        (read_lights, "a.json", f'{{"lights": {{"a": {{"direction": [0, {LONG}, 1]}}}}}}'),
        (read_lights, "a.relight", f'{{"images": [{{"direction": [0, {LONG}, 1]}}]}}'),
        (read_camera, "a.csv", "wavelength," + "r" * 200_000 + "\n400,1\n500,1\n"),
        (read_spectra, "a.csv", "wavelength," + "r" * 200_000 + "\n400,1\n500,1\n"),
        (read_display, "a.json", "[" * 100_000),
        (read_display, "a.json", f'{{"white": {LONG}}}'),
    ],
)
def test_a_text_that_no_parser_expects_is_a_damaged_file(
    tmp_path: Path, read: Any, name: str, text: str
) -> None:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8", newline="")
    with pytest.raises(impasto.CorruptInputError) as caught:
        read(path)
    assert caught.value.path == path


def test_a_disk_that_fails_is_no_damaged_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, kind="learned model")

    def fails(*_: object, **__: object) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(np, "load", fails)
    with pytest.raises(OSError, match="Input/output"):
        impasto.load_learned(path)


def test_many_photographs_take_no_more_time_each(tmp_path: Path) -> None:
    """40,000 names took 14 s where each was compared with all before it, and take 1 s."""
    path = tmp_path / "a.lp"
    count = 40_000
    lines = "".join(f"p{index}.png 0.1 0.2 {1 + index}\n" for index in range(count))
    path.write_text(f"{count}\n{lines}p7.png 0 0 1\n")
    before = time.process_time()
    lights = read_lights(path)
    assert time.process_time() - before < 6.0
    assert len(lights) == count + 1
    assert any("p7.png" in str(note) for note in lights.notes)


@pytest.mark.parametrize("name", ["PIZ", "B44", "B44A", "RLE", "DWAA", "DWAB"])
@pytest.mark.parametrize("tiled", [False, True])
def test_an_exr_that_ends_in_zeros_is_damaged(tmp_path: Path, name: str, tiled: bool) -> None:
    """A preallocated copy that was not finished; the decoders take the zeros for codes."""
    header: dict[str, Any] = {
        "type": OpenEXR.tiledimage if tiled else OpenEXR.scanlineimage,
        "compression": getattr(OpenEXR, f"{name}_COMPRESSION"),
    }
    if tiled:
        header["tiles"] = OpenEXR.TileDescription()
        header["tiles"].xSize = header["tiles"].ySize = 64
    rows, columns = np.mgrid[:128, :128]
    plane = (np.floor((rows + columns) / 8) / 32).astype(np.float16)
    plane[100:] = 0.0
    path = tmp_path / "a.exr"
    OpenEXR.File(header, {"Y": plane}).write(str(path))
    np.testing.assert_allclose(read_image(path)[0], plane, atol=0.02)
    data = path.read_bytes()
    path.write_bytes(data[:-16] + bytes(16))
    with pytest.raises(impasto.CorruptInputError, match=r"zeros that no writer leaves|is damaged"):
        read_image(path)


# --- writers that are killed


KILLED = """
import os, signal, sys
from pathlib import Path
import numpy as np
import impasto
from impasto.io import atomic_path
stack = impasto.Stack(np.full((5, 1, 8, 8), 0.4, np.float32), lights={lights})
result = impasto.fit_sbrdf(stack, pooling="painting", check=False)
folder = Path(sys.argv[1])
result.save(folder / "a.zarr")
{step}
"""
IN_A_FILE = """
with atomic_path(folder / "b.npz") as temporary:
    temporary.write_bytes(b"half")
    os.kill(os.getpid(), signal.SIGKILL)
"""
BETWEEN_RENAMES = """
rename, done = os.rename, []
def once(source, target, **options):
    if done:
        os.kill(os.getpid(), signal.SIGKILL)
    done.append(source)
    rename(source, target, **options)
os.rename = once
result.save(folder / "a.zarr")
"""


def killed(folder: Path, step: str) -> None:
    program = KILLED.format(lights=LIGHTS, step=step)
    done = subprocess.run(
        [sys.executable, "-c", program, str(folder)],
        env=processes.surroundings(),
        check=False,
        timeout=120,
    )
    assert done.returncode == -signal.SIGKILL


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.slow
def test_what_a_killed_writer_left_goes_with_the_next_write(tmp_path: Path) -> None:
    killed(tmp_path, IN_A_FILE)
    (left,) = (name for name in names(tmp_path) if name.startswith("."))
    assert left.startswith(".b-")
    (tmp_path / ".b-original.npz").write_bytes(b"of somebody else")
    with atomic_path(tmp_path / "b.npz") as one:
        assert left not in names(tmp_path)
        # The first is being written and stays.
        atomic_bytes(tmp_path / "b.npz", b"two")
        one.write_bytes(b"one")
    assert (tmp_path / "b.npz").read_bytes() == b"one"
    assert names(tmp_path) == [".b-original.npz", "a.zarr", "b.npz"]


@pytest.mark.slow
@pytest.mark.parametrize("next_step", ["load", "save"])
def test_a_store_whose_replacement_was_killed_is_found_again(
    tmp_path: Path, next_step: str
) -> None:
    killed(tmp_path, BETWEEN_RENAMES)
    path = tmp_path / "a.zarr"
    assert not path.exists(), "killed between the two renames"
    if next_step == "load":
        impasto.load_sbrdf(path)
    result = impasto.load_sbrdf(path)
    result.save(path)
    assert names(tmp_path) == ["a.zarr"]
    assert impasto.load_sbrdf(path).diffuse.tobytes() == result.diffuse.tobytes()


# --- result folders


def made(out: Path, **files: bytes) -> None:
    with result_folder(out) as folder:
        for name, data in files.items():
            path = folder / name.replace("__", "/").replace("_", ".")
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(data)
        write_report(folder / REPORT, report("fit", folder=folder))


def test_nothing_outside_of_a_result_folder_is_touched(tmp_path: Path) -> None:
    out, outside = tmp_path / "out", tmp_path / "precious"
    made(out, maps__a_png=b"1", b_png=b"1")
    outside.mkdir()
    (outside / "a.png").write_bytes(b"1")
    (out / "maps").rename(tmp_path / "moved")
    (out / "maps").symlink_to(outside)
    with pytest.raises(impasto.ArgumentError, match="is a link to another folder"):
        made(out, b_png=b"2")
    with pytest.raises(impasto.ArgumentError, match="is a link to another folder"):
        made(out, maps__a_png=b"2")
    assert (outside / "a.png").read_bytes() == b"1"
    assert (out / "b.png").read_bytes() == b"1"


def test_only_what_an_earlier_run_wrote_is_removed(tmp_path: Path) -> None:
    out = tmp_path / "out"
    made(out, a_png=b"1", b_png=b"1", c_png=b"1", d_png=b"1")
    (out / "b.png").write_bytes(b"retouched")
    (out / "c.png").unlink()
    (out / "c.png").symlink_to(out / "b.png")
    made(out, d_png=b"2")
    assert names(out) == ["b.png", "c.png", "d.png", REPORT]


def test_files_of_two_runs_are_no_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    made(out, sbrdf_npz=b"1", z_png=b"1")
    check_listed([out / "sbrdf.npz"])
    replace = Path.replace

    def ended(source: Path, target: Path) -> None:
        if target == out / "z.png":
            raise KeyboardInterrupt  # as SIGKILL would, in the middle
        replace(source, target)

    monkeypatch.setattr(Path, "replace", ended)
    with pytest.raises(KeyboardInterrupt):
        made(out, sbrdf_npz=b"2", z_png=b"2")
    monkeypatch.undo()
    assert (out / "sbrdf.npz").read_bytes() == b"2"
    with pytest.raises(impasto.CorruptInputError, match=r"is not the file that report\.json"):
        check_listed([out / "sbrdf.npz"])
    assert main(["render", str(out), "--out", str(tmp_path / "a.png")]) == 3
    made(out, sbrdf_npz=b"3", z_png=b"3")
    check_listed([out / "sbrdf.npz"])


def test_a_killed_run_leaves_a_folder_that_the_next_one_removes(tmp_path: Path) -> None:
    program = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from impasto.cli.folder import result_folder\n"
        "with result_folder(Path(sys.argv[1])) as folder:\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    with suppress(AssertionError):
        processes.run(program, str(tmp_path / "out"))
    assert len(names(tmp_path)) == 1
    made(tmp_path / "out", a_png=b"1")
    assert names(tmp_path) == ["out"]


# --- every step fails once


def written(kind: str, folder: Path, factor: float) -> None:
    """A file or a folder of one name, which depends on the factor."""
    plane = np.full((8, 8), 0.25 * factor, np.float32)
    if kind == "png":
        write_png16(folder / "a.png", plane)
    elif kind == "exr":
        write_exr(folder / "a.exr", {"Y": plane})
    elif kind == "tif":
        write_tiff32(folder / "a.tif", plane)
    elif kind == "folder":
        made(folder / "a", sbrdf_npz=bytes([int(factor)]), maps__b_png=bytes([int(factor)]))
    else:
        ZarrStore().write(folder / "a.zarr", {"status": np.zeros((8, 8), np.uint8), "x": plane})


def tree(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.mark.slow
@pytest.mark.parametrize("step", ["fsync", "rename", "replace", "open", "mkdir"])
@pytest.mark.parametrize("kind", ["png", "exr", "tif", "zarr", "folder"])
def test_a_step_that_fails_leaves_the_old_or_the_new(
    tmp_path: Path, kind: str, step: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The n-th call of a function of the system fails, for every n that there is."""
    (tmp_path / "new").mkdir()
    written(kind, tmp_path / "new", 2.0)
    old = tmp_path / "old"
    old.mkdir()
    written(kind, old, 1.0)
    before, after = tree(old), tree(tmp_path / "new")
    own = getattr(os, step)
    for number in range(1, 60):
        calls: list[object] = []

        def fails(*given: Any, **options: Any) -> Any:
            calls.append(given)  # noqa: B023
            if len(calls) == number:  # noqa: B023
                raise OSError(errno.EIO, os.strerror(errno.EIO))
            return own(*given, **options)

        with monkeypatch.context() as patch:
            patch.setattr(os, step, fails)
            failed = False
            try:
                written(kind, old, 2.0)
            except OSError as error:
                failed = error.errno == errno.EIO
        found = tree(old)
        if failed and kind == "folder":
            # Its files are replaced one by one, the report last.
            assert found.keys() == before.keys()
            assert all(data in {before[name], after[name]} for name, data in found.items())
        elif failed:
            assert found in (before, after)
        if len(calls) < number:
            break
        written(kind, old, 1.0)
        assert tree(old) == before
    else:
        pytest.fail("there are more than 60 of them")
    assert tree(old) == after


# --- the system


@pytest.fixture
def small_disk() -> Any:
    """Files end at 50,000 bytes, as on a full disk."""
    old = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    signal.signal(signal.SIGXFSZ, old)


def test_a_full_disk_under_openexr_is_an_error_of_the_disk(
    tmp_path: Path, small_disk: None
) -> None:
    path = tmp_path / "a.exr"
    plane = np.random.default_rng(1).random((300, 300))
    with pytest.raises(OSError, match="File too large") as caught:
        write_exr(path, {"Y": plane})
    assert caught.value.errno == errno.EFBIG
    assert caught.value.filename == str(path)
    assert names(tmp_path) == []


def test_an_error_of_any_library_ends_without_a_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails() -> None:
        raise LookupError("a codec\x1b[2J")

    monkeypatch.setattr("impasto.report.versions", fails)
    assert main(["info"]) == 70
    told = capsys.readouterr().err
    assert "a defect in impasto, please report it: LookupError: a codec" in " ".join(told.split())
    assert "Traceback" not in told
    assert "\x1b[2J" not in told


def test_an_unknown_instruction_set_is_told() -> None:
    program = (
        "import json, warnings\n"
        "with warnings.catch_warnings(record=True) as caught:\n"
        "    warnings.simplefilter('always')\n"
        "    import impasto\n"
        "print(json.dumps([str(one.message) for one in caught]))\n"
    )
    (told,) = json.loads(processes.run(program, IMPASTO_SIMD="avx9"))
    assert told.startswith("IMPASTO_SIMD='avx9' is not known")
    assert json.loads(processes.run(program, IMPASTO_SIMD="baseline")) == []


INTERRUPTED = """
import sys
class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == "impasto.rig":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupt())
import runpy
runpy.run_module("impasto", run_name="__main__")
"""


@pytest.mark.parametrize(("name", "quiet"), [("impasto", True), ("another", False)])
def test_ctrl_c_while_the_program_loads_is_one_line(name: str, quiet: bool) -> None:
    program = f"import sys\nsys.argv = [{name!r}, 'info']\n{INTERRUPTED}"
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=processes.surroundings(),
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == -signal.SIGINT
    assert (done.stderr == "impasto: interrupted\n") is quiet
    assert ("Traceback" in done.stderr) is not quiet


def test_an_error_in_a_hidden_folder_is_about_the_result_that_was_asked_for(tmp_path: Path) -> None:
    out = tmp_path / "result"
    with pytest.raises(OSError, match="full") as error, result_folder(out) as folder:
        raise OSError(errno.ENOSPC, "full", str(folder / "maps.zarr" / "angle"))
    assert error.value.filename == str(out / "maps.zarr" / "angle")
    assert list(tmp_path.iterdir()) == []


def test_the_mask_of_new_files_is_read_without_changing_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else what other threads make in that moment may be written by everybody."""
    before = os.umask(0o027)
    try:
        with monkeypatch.context() as patched:
            patched.setattr(os, "umask", None)
            atomic_bytes(tmp_path / "a.txt", b"a")
            with new_folder(tmp_path / "b"):
                pass
            made(tmp_path / "c", d_txt=b"d")
    finally:
        os.umask(before)
    modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()}
    assert modes == {"a.txt": 0o640, "b": 0o750, "c": 0o750}
