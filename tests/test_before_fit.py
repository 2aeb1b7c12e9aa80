"""`doctor.before_fit`: what spoils a fit stops it, and nothing else does."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest

import impasto
from impasto import (
    ArgumentError,
    ImpastoWarning,
    Rig,
    Stack,
    doctor,
    fit_sbrdf,
    read_stack,
    simulate,
)
from impasto._internal.wording import factor, scatter
from impasto.cli import main
from impasto.doctor.before_fit import spoiling
from impasto.io import Session, write_lights, write_png16, write_session, write_stack
from test_doctor import RIGS, altered, captured


def codes(stack: Stack) -> set[str]:
    """What stops a fit."""
    return {finding.code for finding in spoiling(doctor.before_fit(stack))}


def warned(stack: Stack) -> set[str]:
    return {finding.code for finding in doctor.before_fit(stack).of("warning")}


def lit(stack: Stack, directions: np.ndarray) -> Stack:
    return altered(stack, lights=directions)


def exchanged(directions: np.ndarray, first: int, second: int) -> np.ndarray:
    result = directions.copy()
    result[[first, second]] = directions[[second, first]]
    return result


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("varnish", [None, "matte", "gloss", "patches"])
@pytest.mark.parametrize("relief", [0.0, 0.3, 3.0])
def test_nothing_stops_a_healthy_stack(rig: str, varnish: str | None, relief: float) -> None:
    stack = captured(4, rig, varnish, relief=relief)
    assert codes(stack) == warned(stack) == set()
    rng = np.random.default_rng(int(10 * relief))
    for count in (3, 4, 5, 6, 8):
        some = np.sort(rng.choice(len(stack.rig), count, replace=False))
        assert codes(stack.take(some)) == set(), some


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("varnish", ["matte", "gloss"])
def test_what_spoils_a_fit_stops_it(rig: str, varnish: str) -> None:
    stack = captured(3, rig, varnish)
    given = stack.rig.directions
    assert codes(lit(stack, given * [1, -1, 1])) == {"directions"}
    assert codes(lit(stack, given * [-1, 1, 1])) == {"directions"}
    assert codes(lit(stack, given[:, [1, 0, 2]])) == {"directions"}
    assert codes(lit(stack, given[:, [1, 0, 2]] * [1, -1, 1])) == {"directions"}
    assert "order" in codes(lit(stack, np.roll(given, 1, axis=0)))
    assert "order" in codes(lit(stack, given[::-1]))
    assert "pairing" in codes(lit(stack, exchanged(given, 2, 6)))
    samples = stack.samples.copy()
    samples[5] = samples[1]
    assert "duplicates" in codes(altered(stack, samples=samples))


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("varnish", [None, "matte", "gloss"])
def test_lights_in_any_other_order_are_warned_of(rig: str, varnish: str | None) -> None:
    stack = captured(3, rig, varnish)
    given = stack.rig.directions
    shuffled = lit(stack, given[np.random.default_rng(5).permutation(len(given))])
    assert codes(shuffled) == set()
    assert warned(shuffled) == {"order"}
    with pytest.warns(ImpastoWarning, match="no better than with their lights in random") as told:
        fit_sbrdf(shuffled, check=True, pooling="none")
    assert {Path(warning.filename).name for warning in told} == {Path(__file__).name}


def test_lights_in_another_order_that_seem_turned_are_not_to_be_turned() -> None:
    stack = captured(3, RIGS[1], "matte")
    given = stack.rig.directions
    shuffled = lit(stack, given[np.random.default_rng(6).permutation(len(given))])
    diagnosis = doctor.examine(shuffled)
    assert diagnosis["order"].numbers["verdict"] == "random"
    found = diagnosis["directions"]
    assert found.severity == "error"
    assert found.advice.startswith("make sure of the order first")
    directions = doctor.repaired_directions(shuffled, diagnosis)
    assert directions.tobytes() == shuffled.rig.directions.tobytes()


@pytest.mark.parametrize("relief", [0.0, 0.1])
def test_a_plane_under_a_ring_of_uneven_lamps_is_in_no_random_order(relief: float) -> None:
    """Its photographs are alike but for the strengths of the lamps, under any list of lights."""
    turn = np.arange(16) * np.pi / 8.0
    ring = np.stack([0.7 * np.cos(turn), 0.7 * np.sin(turn), np.full(16, 0.714)], axis=1)
    painting = simulate.painting(0, (72, 72), varnish="matte", relief=relief, pitch_mm=0.5)
    lights = [impasto.DistantLight((*one,), 0.5) for one in ring.tolist()]
    rig = Rig(lights, pitch_mm=0.5)
    stack = simulate.capture(painting, rig, "rgb", encoding="srgb", bits=8, exposure=0.5).stack
    assert codes(stack) == warned(stack) == set()


def test_lights_close_together_are_warned_of_and_too_few_are_an_error() -> None:
    stack = captured(3, RIGS[0], "matte")
    close = np.sort(np.argsort(stack.rig.directions[:, 0])[:4])
    assert warned(stack.take(close)) == {"coverage"}
    few = doctor.before_fit(stack.take([0, 1]))
    assert [finding.code for finding in few.of("error")] == ["lights"]
    assert spoiling(few) == ()  # the fit itself says so


def test_equal_photographs_of_a_plane_are_no_copies() -> None:
    """Without noise, a plane is equally bright under all lights of one height."""
    azimuth = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    lights = np.stack([np.cos(azimuth), np.sin(azimuth), np.ones(8)], axis=1) / np.sqrt(2.0)
    albedo = np.random.default_rng(0).uniform(0.2, 0.8, (3, 48, 48)).astype(np.float32)
    stack = Stack(np.repeat(albedo[None] / np.sqrt(2.0), 8, axis=0), lights=lights)
    assert doctor.examine(stack)["duplicates"].severity == "warning"
    assert codes(stack) == set()


def test_one_light_twice_goes_on() -> None:
    """It counts twice, which spoils nothing; the doctor says so."""
    stack = captured()
    again = stack.take([*range(16), 3])
    assert codes(again) == set()
    assert doctor.kept_observations(doctor.examine(again)) == list(range(16))


def test_the_check_can_be_had_in_python() -> None:
    stack = captured(3)
    wrong = lit(stack, stack.rig.directions * [1, -1, 1])
    with pytest.raises(ArgumentError, match=r"mirrored top to bottom .*\(use \(x, -y, z\)"):
        fit_sbrdf(wrong, pooling="painting", check=True)
    fitted = fit_sbrdf(stack, pooling="painting", check=True)
    np.testing.assert_array_equal(fitted.normal, fit_sbrdf(stack, pooling="painting").normal)
    assert np.isfinite(fit_sbrdf(wrong, pooling="painting").normal).any()
    with pytest.raises(ArgumentError, match="check: expected"):
        fit_sbrdf(stack, check="no")  # type: ignore[call-overload]


def session(folder: Path, stack: Stack) -> Path:
    folder.mkdir()
    names = [f"p{index:02d}.png" for index in range(len(stack.rig))]
    for name, planes in zip(names, stack.samples, strict=True):
        write_png16(folder / name, np.moveaxis(planes[:3] << 4, 0, -1))
    write_lights(folder / "lights.lp", stack.rig.directions, names)
    return folder / "lights.lp"


@pytest.mark.parametrize("fault", ["mirrored", "copied", "exchanged", "session"])
def test_the_commands_of_a_refusal_repair_the_stack(
    tmp_path: Path, fault: str, capsys: pytest.CaptureFixture[str]
) -> None:
    stack = captured(3, varnish="matte")
    given = stack.rig.directions
    if fault in {"mirrored", "session"}:
        stack = lit(stack, given * [1, -1, 1])
    elif fault == "exchanged":
        stack = lit(stack, exchanged(given, 2, 6))
    else:
        samples = stack.samples.copy()
        samples[5] = samples[1]
        stack = altered(stack, samples=samples)
    path, out = session(tmp_path / "my session", stack), tmp_path / "out"
    words = ["fit", str(path), "--saturation", "65520", "--out", str(out)]
    if fault == "session":
        path = path.with_name("session.toml")
        write_session(path, Session(lights="lights.lp", saturation=65520.0))
        words = ["fit", str(path), "--out", str(out)]
    assert main(words) == 1
    assert not out.exists()
    told = capsys.readouterr().err
    assert "--no-check fits them as they are" in told
    assert "1 error: repair the stack before a fit" in told
    assert "usable" not in told
    repair = [line.split("impasto ", 1)[1] for line in told.splitlines() if "  impasto " in line]
    assert [line.split()[0] for line in repair] == ["doctor", "fit"]
    main(shlex.split(repair[0]))
    written, go_on = capsys.readouterr().err.splitlines()[-2:]
    repaired = tmp_path / "my session" / "repaired.lp"
    what = {"exchanged": "p02.png and p06.png are exchanged", "copied": "p01.png, p05.png left out"}
    assert written.startswith(f"{repaired} written: ")
    assert written.endswith(what.get(fault, "replaces each direction (x, y, z)"))
    assert go_on.endswith(repair[1].replace(str(out), "OUT").removeprefix("impasto "))
    faster = ["--pooling", "none"] if fault == "session" else []
    assert main(shlex.split(repair[1]) + faster) == 0
    assert (out / "report.json").is_file()
    if fault in {"mirrored", "session"}:
        lights = read_stack(repaired).rig.directions
        # Mirrored back, or turned by half about the normal from that, which no curl tells apart.
        right = min(np.abs(lights - given * [s, s, 1]).max() for s in (1, -1))
        assert right < 1e-9


def test_no_check_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stack = captured(3)
    wrong = lit(stack, stack.rig.directions * [1, -1, 1])
    write_stack(tmp_path / "s.npz", wrong)
    words = ["fit", str(tmp_path / "s.npz"), "--out", str(tmp_path / "out"), "--pooling", "none"]
    assert main(words) == 1
    # A light file cannot repair an archive.
    assert "impasto doctor says more" in capsys.readouterr().err
    assert main([*words, "--no-check"]) == 0


@pytest.mark.parametrize("name", ["icon", "balls"])
def test_real_photographs(data: Path, name: str) -> None:
    if name == "icon":
        stack = read_stack(data / "icon_rti" / "dirs.lp")
    else:
        lights = data / "two_balls" / "light_directions.txt"
        stack = read_stack(data / "two_balls" / "Objects", lights=lights, encoding="linear")
    assert codes(stack) == warned(stack) == set()
    rng = np.random.default_rng(2)
    for count in (3, 6, 9, len(stack.rig) // 2):
        some = np.sort(rng.choice(len(stack.rig), count, replace=False))
        assert codes(stack.take(some)) == set(), some
    given = stack.rig.directions
    assert codes(stack._replace(rig=Rig(given * [1, -1, 1]))) == {"directions"}
    assert "order" in codes(stack._replace(rig=Rig(np.roll(given, 1, axis=0))))
    samples = stack.samples.copy()
    samples[5] = samples[1]
    assert "duplicates" in codes(stack._replace(samples=samples))


def test_scatter_is_said_as_people_say_it(data: Path) -> None:
    assert [scatter(np.log(x)) for x in (1.04, 1.3, 2.0, 35.2)] == [
        "4 %", "30 %", "a factor of 2.0", "a factor of 35",
    ]  # fmt: skip
    assert scatter(1e6) == "a factor of more than 100"
    assert [factor(x) for x in (1.44, 12.3, 3e17)] == ["1.4", "12", "more than 100"]
    balls = impasto.read_stack(
        data / "two_balls" / "Objects", lights=data / "two_balls" / "light_directions.txt"
    )
    # The black cloth around the object is no part of it.
    assert doctor.examine(balls)["strengths"].numbers["spread"] < np.log(2.0)
