"""The command line: what people type, what they get, and what they are told."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest

import impasto
from command_line import complaint, photographs
from impasto.cli import main

SIZE = 48
PROGRAM = """\
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
from impasto.cli import main
sys.exit(main())
"""


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("cli") / "demo"
    assert main(["demo", "--out", str(out), "--size", str(SIZE), "--quiet"]) == 0
    return out


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return photographs(tmp_path_factory.mktemp("stack"))


@pytest.fixture(scope="module")
def fitted(stack: Path) -> Path:
    out = stack.parent / "fitted"
    assert main(["fit", str(stack), "--out", str(out), "--quiet"]) == 0
    return out


def said(capsys: pytest.CaptureFixture[str]) -> str:
    return " ".join(capsys.readouterr().err.split())


# --- what a result is


def test_a_fit_leaves_maps_an_overview_and_a_report(fitted: Path) -> None:
    assert {path.name for path in fitted.iterdir()} == {
        "diffuse.exr",
        "diffuse.png",
        "normal.exr",
        "normal.png",
        "overview.jpg",
        "report.json",
        "sbrdf.npz",
        "status.png",
        "quality.exr",
    }
    assert [path.name for path in fitted.parent.iterdir() if path.name.startswith(".")] == []


def test_maps_for_programs_are_the_fit_bit_for_bit(fitted: Path) -> None:
    sbrdf = impasto.load_sbrdf(fitted / "sbrdf.npz")
    with OpenEXR.File(str(fitted / "normal.exr"), separate_channels=True) as file:
        planes = {name: channel.pixels for name, channel in file.channels().items()}
    for name, plane in zip("XYZ", sbrdf.normal, strict=True):
        np.testing.assert_array_equal(planes[name], plane)
    with OpenEXR.File(str(fitted / "quality.exr"), separate_channels=True) as file:
        np.testing.assert_array_equal(file.channels()["status"].pixels, sbrdf.status)


def test_maps_for_people_have_sixteen_bits(fitted: Path) -> None:
    sbrdf = impasto.load_sbrdf(fitted / "sbrdf.npz")
    picture = cv2.imread(str(fitted / "normal.png"), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    assert picture.dtype == np.uint16
    x = picture[..., 2] / 65535.0 * 2.0 - 1.0
    # Half a code of 65535 over a range of 2.
    np.testing.assert_allclose(x, sbrdf.normal[0], atol=1.0 / 65535 + 1e-6)


def test_a_report_names_inputs_options_versions_and_counts(fitted: Path, stack: Path) -> None:
    report = json.loads((fitted / "report.json").read_text(encoding="utf-8"))
    assert [entry["file"] for entry in report["inputs"]] == [stack.as_posix()]
    assert report["options"]["method"] == "robust"
    assert report["options"]["index"] == 1.45
    assert sum(report["results"]["status"].values()) == 32 * 40
    assert {"photographs", "normals", "gloss", "files"} <= report["timings_s"].keys()
    assert {entry["file"] for entry in report["outputs"]} >= {"normal.exr", "sbrdf.npz"}
    assert "impasto" in report["versions"]


def test_the_papers_procedure_can_be_asked_for(stack: Path, tmp_path: Path) -> None:
    out = tmp_path / "papers"
    words = f"fit {stack} --out {out} --method threshold --extraction papers --no-joint --quiet"
    assert main(words.split()) == 0
    options = json.loads((out / "report.json").read_text(encoding="utf-8"))["options"]
    assert (options["method"], options["extraction"], options["joint"]) == (
        "threshold",
        "papers",
        False,
    )


def test_the_overview_is_one_picture_of_everything(fitted: Path) -> None:
    sheet = cv2.imread(str(fitted / "overview.jpg"))
    assert sheet is not None
    assert sheet.shape[1] > 3 * 400
    assert sheet.std() > 10


def test_the_demonstration_compares_with_the_truth(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "demo"
    assert main(["demo", "--out", str(out), "--size", "32"]) == 0
    printed = capsys.readouterr()
    for word in ("normals", "colour, D65", "colour, A", "gamma", "beta", "overview.jpg"):
        assert word in printed.out
    assert printed.out.splitlines()[-1] == f"Turn the light: impasto view {out}"
    assert "photographs" in printed.err
    truth = json.loads((out / "report.json").read_text(encoding="utf-8"))["results"]["truth"]
    assert truth["normal_mean"] > 0
    for name in ("above", "raking", "lamp", "slanted"):
        assert cv2.imread(str(out / f"{name}.png")) is not None


def test_the_demonstration_can_be_fitted_from_its_files(demo: Path, tmp_path: Path) -> None:
    folder, out = demo / "photographs", tmp_path / "again"
    code = main(
        f"fit {folder} --out {out} --quiet --dark 1024 --saturation 65520 --pitch 0.2 "
        f"--camera {folder / 'camera.csv'}".split()
    )
    assert code == 0
    first, again = (impasto.load_sbrdf(path / "sbrdf.npz") for path in (demo, out))
    np.testing.assert_array_equal(again.normal, first.normal)
    assert again.beta == first.beta
    assert (out / "reflectance.npz").is_file()
    assert (out / "colour.png").is_file()


def test_the_same_command_gives_the_same_bytes(stack: Path, fitted: Path, tmp_path: Path) -> None:
    out = tmp_path / "again"
    assert main(["fit", str(stack), "--out", str(out), "--quiet", "--threads", "1"]) == 0
    for name in ("normal.exr", "diffuse.exr", "quality.exr", "normal.png", "overview.jpg"):
        assert (out / name).read_bytes() == (fitted / name).read_bytes(), name


def test_photographs_that_an_earlier_result_holds_stay(
    demo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "demo"
    shutil.copytree(demo, own)
    assert main(["fit", str(own / "photographs"), "--out", str(own), "--quiet"]) == 1
    assert "give another folder" in capsys.readouterr().err
    assert (own / "photographs" / "lights.lp").is_file()


# --- info


def test_info_describes_the_installation(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["impasto"] == impasto.__version__


@pytest.mark.parametrize("name", ["", "report.json", "sbrdf.npz"])
def test_info_describes_a_result(
    fitted: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(fitted / name)]) == 0
    printed = capsys.readouterr().out
    assert "40 x 32 pixels, 3 bands" in printed
    assert "gamma degrees" in printed


def test_info_sees_a_file_that_was_changed(
    stack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "fit"
    assert main(["fit", str(stack), "--out", str(out), "--quiet"]) == 0
    (out / "normal.png").write_bytes(b"x")
    (out / "status.png").unlink()
    assert main(["info", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "normal.png has been changed" in printed
    assert "status.png is missing" in printed


# --- somebody else's files


def test_a_folder_of_other_files_is_refused(
    stack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    assert main(["fit", str(stack), "--out", str(tmp_path), "--quiet"]) == 1
    assert "--force" in said(capsys)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]
    assert main(["fit", str(stack), "--out", str(tmp_path), "--quiet", "--force"]) == 0
    assert (tmp_path / "thesis.txt").read_text() == "years of work"
    assert (tmp_path / "report.json").is_file()


def test_an_earlier_result_is_replaced_and_other_files_stay(demo: Path, tmp_path: Path) -> None:
    out = tmp_path / "result"
    photographs = demo / "photographs"
    words = f"fit {photographs} --out {out} --quiet --dark 1024 --saturation 65520"
    camera = photographs / "camera.csv"
    assert main(f"{words} --camera {camera}".split()) == 0
    (out / "mine.png").write_bytes(b"a render of my own")
    assert main(words.split()) == 0
    assert (out / "mine.png").is_file()
    assert not (out / "reflectance.npz").exists(), "spectra of the earlier result"


@pytest.mark.parametrize(
    "odd",
    [
        {"outputs": None},
        {"outputs": [{}]},
        {"outputs": "normal.png"},
        {"versions": []},
        {"results": []},
        {"results": {"shape": [1]}},
        {"results": {"status": {"a": 0}}},
        {"timings_s": {"a": "b"}},
    ],
    ids=str,
)
def test_an_odd_report_is_not_ours(
    odd: dict[str, object],
    fitted: Path,
    stack: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    report = json.loads((fitted / "report.json").read_text(encoding="utf-8"))
    (tmp_path / "report.json").write_text(json.dumps(report | odd))
    assert main(["info", str(tmp_path)]) == 3
    assert "is not a report written by impasto" in said(capsys)
    assert main(["fit", str(stack), "--out", str(tmp_path), "--quiet"]) == 1
    assert "--force" in said(capsys)


# --- mistakes


@pytest.fixture
def mistakes(tmp_path: Path, stack: Path, demo: Path) -> dict[str, str]:
    """Names that the command lines below may use."""
    photographs = tmp_path / "photographs"
    photographs.mkdir()
    for path in (demo / "photographs").iterdir():
        (photographs / path.name).write_bytes(path.read_bytes())
    truncated = photographs / "light05.tif"
    truncated.write_bytes(truncated.read_bytes()[:2000])
    two = tmp_path / "two.lp"
    lines = (demo / "photographs" / "lights.lp").read_text().splitlines()
    two.write_text("\n".join(["2", *lines[1:3]]))
    garbage = tmp_path / "garbage.npz"
    garbage.write_bytes(b"no archive")
    csv = tmp_path / "camera.csv"
    csv.write_text("wavelength,red\n400,zero\n")
    return {
        "stack": str(stack),
        "demo": str(demo),
        "broken": str(photographs),
        "two": str(two),
        "images": str(demo / "photographs"),
        "garbage": str(garbage),
        "csv": str(csv),
        "out": str(tmp_path / "out"),
        "tmp": str(tmp_path),
    }


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        ("fitt", 2, "fitt"),
        ("fit {stack}", 2, "fit: --out is missing or has no value"),
        ("fit --out {out}", 2, "fit: STACK is missing or has no value"),
        ("fit {stack} --out", 2, "fit: --out is missing or has no value"),
        ("fit {stack} --outt {out}", 2, "Unknown option: --outt. Did you mean --out?"),
        ("fit {stack} --outt={out}", 2, "Unknown option: --outt. Did you mean --out?"),
        ("fit {stack} --effart draft", 2, "--effart. Did you mean --effort? fit: --out is missing"),
        ("fit {stack} --out {out} --method magic", 2, "--method"),
        ("fit {stack} --out {out} --sharpness 3", 2, "--sharpness"),
        ("fit {stack} --out {out} --threads zero", 2, "--threads"),
        ("render {demo} --light 45 --out {out}.png", 2, "azimuth,elevation"),
        ("render {demo} --light 45,-5 --out {out}.png", 2, "elevation above 0"),
        ("render {demo} --light 45,30,tepid --out {out}.png", 2, "or warm, cool"),
        ("render {demo} --light 45,30,Z9 --out {out}.png", 2, "unknown name"),
        ("render {demo} --point 1,2 --out {out}.png", 2, "x,y,z"),
        ("fit {stack} --out {out} --illuminant A", 2, "needs --camera"),
        ("fit {images} --out {out} --pitch 0", 1, "--pitch: expected a positive"),
        ("fit {tmp}/nowhere.lp --out {out}", 1, "nowhere.lp does not exist"),
        ("fit {stack} --out {stack}", 1, "is a file"),
        ("fit {stack} --out {out} --threads 0", 1, "threads"),
        ("fit {stack} --out {out} --index 0.5", 1, "index"),
        ("fit {stack} --out {out} --camera {tmp}/none.csv", 1, "none.csv"),
        ("fit {stack} --out {out} --training {csv}", 2, "--training is for spectra"),
        ("fit {stack} --out {out} --camera srgb --training {tmp}/no.csv", 1, "no.csv"),
        ("fit {stack} --out {out} --camera srgb --training {csv}", 3, "camera.csv"),
        ("fit {images} --out {out} --encoding foo", 1, "encoding"),
        ("fit {images} --out {out} --dark nowhere", 1, "--dark"),
        ("fit {images} --out {out} --region 0 0 9999 9999", 1, "region"),
        ("fit {two} --images {images} --out {out}", 1, "2"),
        ("demo --out {out} --size 3", 1, "--size"),
        ("render {tmp} --out {out}.png", 1, "sbrdf.npz"),
        ("render {demo} --out {out}.gif", 1, ".gif"),
        ("render {csv} --out {out}.png", 1, "is no result: expected the --out folder"),
        ("render {demo} --illuminant Z9 --out {out}.png", 1, "Z9"),
        ("render {demo} --adaptation 3 --out {out}.png", 1, "adaptation"),
        ("render {demo} --display oscilloscope --out {out}.png", 1, "oscilloscope"),
        # Numbers are refused before a file is looked for.
        ("fit {tmp}/nowhere.lp --out {out} --threads 0", 1, "--threads: expected a number from 1"),
        ("fit {tmp}/nowhere.lp --out {out} --index 0.5", 1, "--index: expected a refractive"),
        ("fit {tmp}/nowhere.lp --out {out} --pitch 0", 1, "--pitch: expected a positive"),
        ("fit {tmp}/nowhere.lp --out {out} --region 0 0 0 9", 1, "--region: expected TOP"),
        ("fit {tmp}/nowhere.lp --out {out} --saturation nan", 1, "--saturation: expected"),
        ("doctor {tmp}/nowhere.lp --region -1 0 9 9", 1, "--region: expected TOP"),
        ("render {tmp} --threads 0 --out {out}.png", 1, "--threads"),
        (
            "render {tmp} --exposure 0 --out {out}.png",
            1,
            '--exposure: expected a positive factor or "maximum", found 0',
        ),
        ("render {tmp} --adaptation 3 --out {out}.png", 1, "expected a degree from 0 to 1, found"),
        ("render {tmp} --pitch -1 --out {out}.png", 1, "--pitch"),
        ("demo --out {out} --threads 0", 1, "--threads"),
        ("study {two} --threads 0", 1, "--threads"),
        ("study {two} --error 1.5", 1, "error: expected a share below 1"),
        ("study {two} --seconds 0", 1, "seconds: expected a number above 0, found 0"),
        ("study {two} --images {images}", 1, "stack: a trial needs 8 photographs, found 2"),
        ("study {two} --out {images} --no-figure", 1, "contains files of other programs"),
        ("study {two} --out {two} --no-figure", 1, "two.lp is a file; give a folder"),
        # The stack's lights, not the option of that name.
        ("fit {two} --images {images} --out {out}", 1, "impasto: lights: a normal needs"),
        ("info {tmp}/nowhere", 1, "nowhere does not exist: expected the --out folder"),
        ("info {tmp}", 1, "report.json"),
        ("fit {broken} --out {out}", 3, "light05.tif"),
        ("fit {garbage} --out {out}", 3, "garbage.npz"),
        ("fit {stack} --out {out} --camera {csv} --illuminant D65", 3, "line 2"),
        ("render {garbage} --out {out}.png", 3, "garbage.npz"),
        ("info {garbage}", 3, "garbage.npz"),
    ],
)
def test_a_mistake_is_one_line_with_its_name(
    words: str,
    code: int,
    told: str,
    mistakes: dict[str, str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert told in complaint([word.format(**mistakes) for word in words.split()], code, capsys)
    assert not Path(mistakes["out"]).exists()
    assert [p.name for p in Path(mistakes["tmp"]).iterdir() if p.name.startswith(".")] == []


def test_colours_without_spectra_cannot_change_their_light(
    fitted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "lamp.png"
    assert main(f"render {fitted} --illuminant A --out {out}".split()) == 1
    assert "--camera" in said(capsys)
    assert main(f"render {fitted} --light 45,30,warm --out {out}".split()) == 1
    assert "--camera" in said(capsys)


def test_a_missing_photograph_makes_a_partial_result(
    demo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, out = tmp_path / "photographs", tmp_path / "out"
    folder.mkdir()
    for path in (demo / "photographs").iterdir():
        if path.name != "light03.tif":
            (folder / path.name).write_bytes(path.read_bytes())
    words = f"fit {folder / 'lights.lp'} --out {out} --dark 1024 --saturation 65520"
    assert main(words.split()) == 4
    told = said(capsys)
    assert "light03.tif" in told
    assert "partial" in told
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    assert report["results"]["shape"][0] == 15
    assert any("light03.tif" in note for note in report["notes"])
    assert main([*words.split(), "--strict"]) == 3


# --- as a process


def run(*words: str, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(  # type: ignore[call-overload, no-any-return]
        [sys.executable, "-c", PROGRAM, *words],
        capture_output=True,
        text=True,
        check=False,
        **options,
    )


@pytest.mark.slow
def test_progress_and_complaints_leave_stdout_alone(stack: Path, tmp_path: Path) -> None:
    done = run("fit", str(stack), "--out", str(tmp_path / "out"))
    assert (done.returncode, done.stdout) == (0, "")
    assert "normals" in done.stderr
    assert "\x1b" not in done.stderr, "no escape sequences in a log file"
    failed = run("fit", "nowhere.lp", "--out", str(tmp_path / "out2"))
    assert (failed.returncode, failed.stdout) == (1, "")
    assert failed.stderr.startswith("impasto: nowhere.lp")


@pytest.mark.slow
def test_quiet_says_nothing(stack: Path, tmp_path: Path) -> None:
    done = run("fit", str(stack), "--out", str(tmp_path / "out"), "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.slow
def test_the_package_runs_as_the_program() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "impasto", "--version"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout.strip()) == (0, impasto.__version__)
    wrong = [sys.executable, "-m", "impasto", "fitt"]
    assert subprocess.run(wrong, capture_output=True, check=False).returncode == 2


@pytest.mark.slow
def test_an_ascii_terminal_gets_its_table(tmp_path: Path) -> None:
    ascii_only = os.environ | {"PYTHONIOENCODING": "ascii", "LC_ALL": "C"}
    done = run("demo", "--size", "16", "--out", str(tmp_path / "demo"), env=ascii_only)
    assert done.returncode == 0
    assert "normals" in done.stdout


@pytest.mark.slow
def test_a_bare_environment_is_enough() -> None:
    """No home, no language, a terminal that can do nothing."""
    kept = {"PATH", "PYTHONPATH", "LD_LIBRARY_PATH", "SYSTEMROOT"}
    bare = {name: text for name, text in os.environ.items() if name in kept}
    done = run("info", env=bare | {"TERM": "dumb", "LC_ALL": "C", "HOME": "/nonexistent"})
    assert (done.returncode, done.stderr) == (0, "")
    assert impasto.__version__ in done.stdout


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="a shell as on POSIX")
@pytest.mark.parametrize(
    ("words", "redirection"),
    [("--help", ">&-"), ("info --json", ">&-"), ("--help", "| head -c 1"), ("--help", "| :")],
)
def test_nobody_has_to_read_stdout(words: str, redirection: str) -> None:
    shell = shutil.which("bash")
    if shell is None:
        pytest.skip("no bash")
    script = f'set -o pipefail; "$0" -c "$1" {words} {redirection}'
    done = subprocess.run(
        [shell, "-c", script, sys.executable, PROGRAM], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_a_defect_has_its_own_exit_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken() -> None:
        raise impasto.InternalError("a panic")

    monkeypatch.setattr("impasto.report.versions", broken)
    assert main(["info"]) == 70
    assert "please report it" in said(capsys)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals as on POSIX")
def test_ctrl_c_stops_within_a_second_and_leaves_nothing(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "demo", "--size", "3000", "--out", str(tmp_path / "demo")],
        stderr=subprocess.PIPE,
        text=True,
    )
    # The hidden folder is made first, so when it is there the work has begun.
    deadline = time.monotonic() + 60
    while not list(tmp_path.iterdir()) and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    sent = time.monotonic()
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "interrupted" in err
    # A second, and as much again for a machine that is busy with other tests.
    assert time.monotonic() - sent < 2.0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "option",
    [
        "study photographs.lp --threads 1.5",
        "demo --size 64.5 --out x",
        "render x --out y --threads 1.5",
        "fit x --out y --lobes 1.5 --pooling pixel",
    ],
)
def test_numbers_that_are_not_whole_are_not_rounded(
    capsys: pytest.CaptureFixture[str], option: str
) -> None:
    assert main(option.split()) == 2
    assert "expected a whole number, found" in capsys.readouterr().err


def test_a_full_disk_is_told_in_words(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], stack: Path
) -> None:
    """Where Python does not say which file it was."""

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("impasto.study.run", full)
    assert main(["study", str(stack), "--quiet"]) == 1
    assert capsys.readouterr().err.strip() == "impasto: no space left on device"


@pytest.mark.parametrize(
    "group", ["calibrate", "capture", "edit", "experiment", "export", "job", "rti", "session"]
)
def test_every_command_of_a_group_is_described(
    group: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([group, "--help"]) == 0
    rows = capsys.readouterr().out.split("Commands ")[1].splitlines()[1:-1]
    # A row that begins with a name goes on with words.
    named = [row.strip("│ ").split(maxsplit=1) for row in rows if re.match(r"│ \S", row)]
    assert len(named) >= 2
    assert [row[0] for row in named if len(row) < 2] == []


@pytest.mark.parametrize(
    ("words", "more"),
    [
        (["rehearse"], "four markers and two mirror balls"),
        (["export", "gltf"], "a panel of the painting"),
        (["calibrate", "lights"], "FOLDER holds photographs of the painting"),
    ],
)
def test_help_of_a_command_says_more_than_the_list(
    words: list[str], more: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words, "--help"]) == 0
    assert more in " ".join(capsys.readouterr().out.split())
