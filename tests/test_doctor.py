"""`impasto.doctor`: each fault is found when it is there, and not when it is not."""

from __future__ import annotations

import json
import tracemalloc
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from impasto import Encoding, PointLight, Rig, Stack, doctor, read_stack, simulate
from impasto.cli import main
from impasto.doctor.lights import lights as directions_alone
from impasto.doctor.tone import tone
from impasto.io import estimate_tone, read_lights, write_lights, write_png16, write_stack

RIGS = ("tominaga-rgb-camera", "tominaga-six-band-adaptation")
SIZE = (72, 72)


@cache
def painted(
    seed: int, size: tuple[int, int], varnish: str | None, relief: float
) -> simulate.Painting:
    return simulate.painting(seed, size, varnish=varnish, relief=relief)


def captured(seed: int = 0, rig: str = RIGS[1], varnish: str | None = "satin", **options) -> Stack:
    size = options.pop("size", SIZE)
    relief = options.pop("relief", 1.0)
    return simulate.capture(painted(seed, size, varnish, relief), rig, **options).stack


def altered(stack: Stack, **changes) -> Stack:
    """The same stack with other samples, lights ..."""
    arguments = {
        name: getattr(stack, name)
        for name in ("samples", "bands", "mask", "saturation", "scale", "black", "names", "notes")
    } | {"encoding": stack.encoding, "lights": stack.rig}
    arguments |= changes
    return Stack(arguments.pop("samples"), **arguments)


def turned(stack: Stack, matrix: list[list[float]]) -> Stack:
    return altered(stack, lights=stack.rig.directions @ np.array(matrix, dtype=float).T)


def found(diagnosis: doctor.Diagnosis) -> set[str]:
    """Codes of everything that is not fine."""
    return {f.code for f in diagnosis.of("warning", "error")}


@pytest.mark.slow
@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("varnish", [None, "matte", "satin", "gloss", "patches"])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_healthy_stack_raises_no_alarm(rig: str, varnish: str | None, seed: int) -> None:
    diagnosis = doctor.examine(captured(seed, rig, varnish))
    assert found(diagnosis) == set(), diagnosis
    assert diagnosis["directions"].numbers["verdict"] == "as given"
    assert diagnosis["pairing"].numbers["agreement"] > 0.3
    assert diagnosis.usable


@pytest.mark.slow
@pytest.mark.parametrize("varnish", [None, "matte", "gloss"])
@pytest.mark.parametrize("rig", RIGS)
def test_a_flat_painting_raises_no_alarm(rig: str, varnish: str | None) -> None:
    for relief in (0.0, 0.1):
        diagnosis = doctor.examine(captured(2, rig, varnish, relief=relief))
        assert found(diagnosis) == set(), diagnosis


@pytest.mark.slow
@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("varnish", ["matte", "gloss"])
@pytest.mark.parametrize(
    ("matrix", "repairs"),
    [
        ([[1, 0, 0], [0, -1, 0], [0, 0, 1]], {"(x, -y, z)", "(-x, y, z)"}),
        ([[-1, 0, 0], [0, 1, 0], [0, 0, 1]], {"(x, -y, z)", "(-x, y, z)"}),
        ([[0, 1, 0], [1, 0, 0], [0, 0, 1]], {"(y, x, z)", "(-y, -x, z)"}),
        ([[0, -1, 0], [1, 0, 0], [0, 0, 1]], {"(y, -x, z)", "(-y, x, z)"}),
        ([[0, 1, 0], [-1, 0, 0], [0, 0, 1]], {"(y, -x, z)", "(-y, x, z)"}),
    ],
    ids=["mirrored y", "mirrored x", "swapped", "quarter left", "quarter right"],
)
def test_wrong_directions_are_found(
    rig: str, varnish: str, matrix: list[list[float]], repairs: set[str]
) -> None:
    """A distant lamp leaves the choice between two repairs that differ by 180 degrees."""
    finding = doctor.examine(turned(captured(3, rig, varnish), matrix))["directions"]
    assert finding.severity == "error"
    assert {finding.numbers["repair"], finding.numbers["alternative_repair"]} == repairs


@pytest.mark.slow
@pytest.mark.parametrize(
    ("matrix", "severity", "repair"),
    [
        ([[1, 0, 0], [0, 1, 0], [0, 0, 1]], "ok", None),
        ([[-1, 0, 0], [0, -1, 0], [0, 0, 1]], "warning", None),
        ([[1, 0, 0], [0, -1, 0], [0, 0, 1]], "error", "(x, -y, z)"),
        ([[-1, 0, 0], [0, 1, 0], [0, 0, 1]], "error", "(-x, y, z)"),
        ([[0, 1, 0], [1, 0, 0], [0, 0, 1]], "error", "(y, x, z)"),
        ([[0, -1, 0], [-1, 0, 0], [0, 0, 1]], "error", "(-y, -x, z)"),
        ([[0, -1, 0], [1, 0, 0], [0, 0, 1]], "error", "(y, -x, z)"),
        ([[0, 1, 0], [-1, 0, 0], [0, 0, 1]], "error", "(-y, x, z)"),
    ],
)
def test_falloff_tells_one_side_from_the_other(
    matrix: list[list[float]], severity: str, repair: str | None
) -> None:
    near = simulate.rig(RIGS[1], distance_mm=30.0)
    stack = captured(1, varnish="matte", rig=near)
    distant = altered(stack, lights=near.directions)
    finding = doctor.examine(turned(distant, matrix))["directions"]
    assert finding.severity == severity, finding
    assert finding.numbers.get("repair") == repair
    assert "alternative" not in finding.numbers


@pytest.mark.slow
@pytest.mark.parametrize("angle", [15, 30, 45, 60, -30])
def test_a_turned_camera_is_found(angle: float) -> None:
    """The curl gives the rotation to a degree or two, up to 180 degrees."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    stack = captured(1, varnish="matte")
    finding = doctor.examine(turned(stack, [[c, -s, 0], [s, c, 0], [0, 0, 1]]))["directions"]
    assert finding.severity in {"warning", "error"}
    assert finding.numbers["curl_best_rotation_deg"] == pytest.approx(angle, abs=2.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("order", "verdict"),
    [
        (np.roll(np.arange(16), 1), "moved back by one"),
        (np.roll(np.arange(16), -2), "moved by two"),
        (np.arange(16)[::-1], "reversed"),
        (np.array(sorted(range(16), key=str)), None),
        (np.array(sorted(range(16), key=lambda i: str(i + 1))), "sorted as numbers"),
    ],
)
def test_lights_out_of_step_are_found(order: np.ndarray, verdict: str | None) -> None:
    stack = captured(1, varnish="matte")
    bad = altered(stack, lights=stack.rig.directions[order])
    diagnosis = doctor.examine(bad)
    if verdict is None:  # numbered from 0: not among the likely mistakes
        assert not diagnosis.usable
        return
    assert diagnosis["order"].severity == "error"
    assert diagnosis["order"].numbers["verdict"] == verdict
    assert diagnosis["directions"].severity == diagnosis["pairing"].severity == "ok"
    repaired = doctor.repaired_directions(bad, diagnosis)
    np.testing.assert_array_equal(repaired, stack.rig.directions)


@pytest.mark.slow
@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("varnish", [None, "satin", "gloss"])
@pytest.mark.parametrize("seed", [0, 1])
def test_an_exchanged_pair_is_found(rig: str, varnish: str | None, seed: int) -> None:
    stack = captured(seed, rig, varnish)
    order = list(range(len(stack.rig)))
    order[2], order[6] = order[6], order[2]
    finding = doctor.examine(altered(stack, samples=stack.samples[order]))["pairing"]
    assert finding.severity in {"warning", "error"}
    assert finding.observations == (2, 6)


@pytest.mark.slow
def test_case_21_a_copied_photograph_is_found() -> None:
    stack = captured()
    samples = stack.samples.copy()
    samples[5] = samples[1]
    finding = doctor.examine(altered(stack, samples=samples))["duplicates"]
    assert (finding.severity, finding.observations) == ("warning", (1, 5))
    same_light = stack.take([*range(16), 3])
    finding = doctor.examine(same_light)["duplicates"]
    assert finding.observations == (3, 16)
    assert "under the same light" in finding.message
    assert doctor.examine(same_light)["repeated-lights"].observations == (3, 16)


@pytest.mark.slow
@pytest.mark.parametrize("varnish", ["matte", "satin"])
def test_a_photograph_saved_twice_is_found(varnish: str) -> None:
    stack = captured(varnish=varnish)
    samples = stack.samples.copy()
    # Saved again with 9 of 12 bits, which is about what a JPEG of good quality keeps.
    samples[12] = samples[3] // 8 * 8 + 4
    finding = doctor.examine(altered(stack, samples=samples))["duplicates"]
    assert finding.observations == (3, 12)
    assert finding.severity == "warning"


def test_clipping_is_counted() -> None:
    stack = captured(varnish="gloss", exposure=1.0)
    bright = np.minimum(stack.samples.astype(np.int64) * 3, 4095).astype(np.uint16)
    bright = altered(stack, samples=bright)
    finding = doctor.examine(bright)["saturation"]
    assert finding.severity == "warning"
    assert finding.numbers["share"] == pytest.approx((bright.samples >= 4095).mean(), abs=1e-6)
    everything = altered(stack, samples=np.full_like(stack.samples, 4095))
    assert doctor.examine(everything)["saturation"].severity == "error"
    unmarked = altered(bright, saturation=65535.0)
    finding = doctor.examine(unmarked)["plateau"]
    assert finding.severity == "warning"
    assert "saturation=4095" in finding.advice


def test_darkness() -> None:
    stack = captured()
    black = altered(stack, samples=np.full_like(stack.samples, int(stack.black[0])))
    diagnosis = doctor.examine(black)
    assert diagnosis["darkness"].severity == "error"
    assert not diagnosis.usable
    samples = stack.samples.copy()
    samples[4] = int(stack.black[0])
    diagnosis = doctor.examine(altered(stack, samples=samples))
    assert diagnosis["unlit"].observations == (4,)
    low = (stack.samples - 64) // 20 + 64
    assert doctor.examine(altered(stack, samples=low))["darkness"].severity == "warning"


@pytest.mark.parametrize("kept", [0.4, 0.8])
def test_the_grey_rest_of_a_damaged_jpeg_is_found(tmp_path: Path, kept: float) -> None:
    """A JPEG whose data end early, but with an end marker, and which a converter passed on."""
    stack = captured(1, RIGS[0])
    for index, samples in enumerate(stack.samples):
        eight = np.ascontiguousarray(np.moveaxis((samples >> 4).astype(np.uint8)[::-1], 0, -1))
        if index == 4:
            whole = cv2.imencode(".jpg", eight)[1].tobytes()
            short = whole[: int(kept * len(whole))] + b"\xff\xd9"
            eight = cv2.imdecode(np.frombuffer(short, np.uint8), cv2.IMREAD_COLOR)
        cv2.imwrite(str(tmp_path / f"{index}.png"), eight)
    diagnosis = doctor.examine(read_stack(tmp_path, lights=stack.rig.directions))
    assert diagnosis["blank"].observations == (4,)
    assert diagnosis["blank"].severity == "warning"


def test_missing_samples() -> None:
    stack = captured(bits=None)
    samples = stack.samples.copy()
    samples[:, :, :4] = np.nan
    assert doctor.examine(altered(stack, samples=samples))["missing-samples"].severity == "warning"
    samples[3] = np.nan
    finding = doctor.examine(altered(stack, samples=samples))["missing-samples"]
    assert finding.observations == (3,)
    nothing = altered(stack, samples=np.full_like(samples, np.nan))
    assert doctor.examine(nothing)["missing-samples"].severity == "error"
    empty = altered(stack, mask=np.zeros(SIZE, bool))
    assert doctor.examine(empty)["mask"].severity == "error"


@pytest.mark.slow
@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("factor", [0.6, 1.6])
def test_an_odd_lamp_is_found(rig: str, factor: float) -> None:
    stack = captured(1, rig, "matte", bits=None, exposure=0.4)
    samples = stack.samples.copy()
    samples[3] *= factor
    finding = doctor.examine(altered(stack, samples=samples))["strengths"]
    assert finding.severity == "warning"
    assert finding.observations == (3,)
    assert finding.numbers["gain"][3] == pytest.approx(factor, rel=0.1)
    strong = [replace(light, intensity=factor if i == 3 else 1.0) for i, light in
              enumerate(stack.rig.lights)]  # fmt: skip
    told = altered(stack, samples=samples, lights=Rig(strong, pitch_mm=stack.rig.pitch_mm))
    assert doctor.examine(told)["strengths"].severity == "ok"


@pytest.mark.slow
@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("varnish", [None, "matte", "satin", "gloss"])
def test_a_wrong_tone_curve_is_found(rig: str, varnish: str | None) -> None:
    coded = captured(1, rig, varnish, encoding="srgb", bits=8)
    assert doctor.examine(coded)["encoding"].severity == "ok"
    codes = coded.encode(coded.samples)
    left_in = Stack(codes.astype(np.uint8), lights=coded.rig.directions)
    finding = doctor.examine(left_in)["encoding"]
    assert finding.severity == "warning"
    assert finding.advice.startswith('give encoding="srgb"')
    linear = captured(1, rig, varnish)
    share = (linear.samples - linear.black[0]) / (4095.0 - linear.black[0])
    light = Encoding("srgb").decode(share)
    bent = Stack(light, lights=linear.rig, saturation=1.0, encoding="srgb")
    finding = doctor.examine(bent)["encoding"]
    assert finding.severity == "warning"
    assert finding.numbers["best"] == "linear"


LIGHTS = simulate.rig(RIGS[1]).directions


@pytest.mark.parametrize(
    ("lights", "code", "severity"),
    [
        (LIGHTS[:1], "lights", "error"),
        (LIGHTS[:2], "lights", "error"),
        (LIGHTS[[0, 3, 6]], "lights", "warning"),
        (LIGHTS[[0, 2, 4, 6]], "lights", "note"),
        (np.stack([np.linspace(-0.8, 0.8, 9), 0 * np.linspace(0, 1, 9), np.ones(9)], 1),
         "conditioning", "error"),
        (np.stack([np.linspace(-0.8, 0.8, 9), 0.05 * np.cos(np.arange(9)), np.ones(9)], 1),
         "conditioning", "warning"),
        (LIGHTS[[0, 1, 2, 3, 8, 9, 10]], "coverage", "warning"),
        (LIGHTS * (1, 1, 0.15), "coverage", "warning"),
        (np.concatenate([LIGHTS, [[0.9, 0.1, -0.2]]]), "horizon", "warning"),
        (LIGHTS * (1, 1, -1), "horizon", "error"),
        (np.concatenate([LIGHTS, [[0.9, 0.1, 0.02]]]), "horizon", "note"),
        (np.concatenate([LIGHTS, LIGHTS[:1]]), "repeated-lights", "note"),
    ],
)  # fmt: skip
def test_lights(lights: np.ndarray, code: str, severity: str) -> None:
    rng = np.random.default_rng(5)
    samples = rng.uniform(0.2, 0.6, (len(lights), 3, 16, 16)).astype(np.float32)
    diagnosis = doctor.examine(Stack(samples, lights=lights))
    assert diagnosis[code].severity == severity, diagnosis


def test_a_light_repeats_where_the_view_does_too() -> None:
    """Snel's 770 photographs show six lamps from 115 views each: 39,490 pairs, no repetition."""

    def repeated(rig: Rig) -> list[doctor.Finding]:
        samples = np.random.default_rng(2).uniform(0.2, 0.6, (len(rig), 1, 4, 4))
        found = directions_alone(Stack(samples.astype(np.float32), lights=rig))
        return [finding for finding in found if finding.code == "repeated-lights"]

    snel = simulate.rig("snel-lafortune")
    assert len(np.unique(snel.directions.round(6), axis=0)) < 30
    assert repeated(snel) == []
    again = snel.take([*range(len(snel)), 5, 5, 700])
    (finding,) = repeated(again)
    assert finding.message.startswith("3 photographs with the light and the view of an earlier one")
    assert finding.numbers["pairs"] == [[5, 770], [5, 771], [700, 772]]
    assert finding.observations == (5, 700, 770, 771, 772)
    # A lamp that never moved: as many as come after the first.
    (still,) = repeated(snel.take([0] * 40))
    assert len(still.numbers["pairs"]) == 39


def test_point_lights_are_taken_as_such() -> None:
    near = simulate.rig(RIGS[1], distance_mm=30.0)
    stack = captured(1, varnish="matte", rig=near)
    assert all(isinstance(light, PointLight) for light in stack.rig.lights)
    diagnosis = doctor.examine(stack)
    assert found(diagnosis) == set(), diagnosis


@pytest.mark.slow
@pytest.mark.parametrize("coded", [False, True])
def test_the_tone_of_hundreds_of_photographs_takes_little_memory(coded: bool) -> None:
    """As many as there are pairs of light and view in a large capture."""
    some = captured(1, varnish="matte", size=(96, 96))
    photographs = np.random.default_rng(3).permutation(np.arange(770) % len(some.rig))
    many = altered(
        some, samples=some.samples[photographs], lights=some.rig.take(photographs), names=None
    )
    tracemalloc.start()
    if coded:
        estimate = estimate_tone(many.samples, many.rig.directions, white=4095.0)
        assert "linear" in estimate.plausible
    else:
        (finding,) = tone(many)
        assert finding.severity == "ok"
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # 128 photographs of 20,000 pixels in six bands are 61 MB; there are a few copies of them.
    assert peak < 300e6


@pytest.mark.slow
def test_the_same_stack_gets_the_same_diagnosis() -> None:
    stack = captured(4, RIGS[0])
    assert doctor.examine(stack).to_dict() == doctor.examine(stack).to_dict()


def test_the_report_reads_well() -> None:
    diagnosis = doctor.examine(turned(captured(), [[1, 0, 0], [0, -1, 0], [0, 0, 1]]))
    text = str(diagnosis)
    assert text.startswith("16 photographs, 6 bands, 72 x 72 pixels\n\nerror     directions: ")
    assert "-> use (x, -y, z)" in text
    assert text.endswith("1 error: repair the stack before a fit")
    assert max(len(line) for line in text.splitlines()) <= 92
    assert repr(diagnosis).startswith("<Diagnosis of 16 photographs")
    with pytest.raises(KeyError, match="no finding"):
        diagnosis["nonsense"]


@pytest.fixture(scope="module")
def icon(data: Path) -> Stack:
    return read_stack(data / "icon_rti" / "dirs.lp", encoding="srgb")


@pytest.mark.slow
def test_icon_is_usable(icon: Stack) -> None:
    """72 photographs of a gilded icon; 2.2 % of the samples have the code 255."""
    diagnosis = doctor.examine(icon)
    assert found(diagnosis) <= {"saturation"}
    assert diagnosis["directions"].severity == "ok"
    assert diagnosis["directions"].numbers["verdict"] == "as given"
    assert diagnosis["directions"].numbers["falloff_decided"]
    share = np.mean([np.isposinf(icon.linear(k)).mean() for k in range(72)])
    assert diagnosis["saturation"].numbers["share"] == pytest.approx(share, abs=1e-4)
    assert share == pytest.approx(0.022, abs=0.001)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("flip", "repair"), [((1, -1, 1), "(x, -y, z)"), ((-1, 1, 1), "(-x, y, z)")]
)
def test_icon_mirrored(icon: Stack, flip: tuple[int, int, int], repair: str) -> None:
    finding = doctor.examine(altered(icon, lights=icon.rig.directions * flip))["directions"]
    assert finding.severity == "error"
    assert finding.numbers["repair"] == repair
    assert "alternative" not in finding.numbers


@pytest.mark.slow
def test_icon_turned_by_half(icon: Stack) -> None:
    finding = doctor.examine(altered(icon, lights=icon.rig.directions * (-1, -1, 1)))["directions"]
    assert finding.severity == "warning"
    assert "180 degrees" in finding.message


@pytest.mark.slow
def test_icon_exchanged_pair(icon: Stack) -> None:
    for a, b in ((10, 40), (3, 50)):
        lights = icon.rig.directions.copy()
        lights[[a, b]] = lights[[b, a]]
        finding = doctor.examine(altered(icon, lights=lights))["pairing"]
        assert finding.severity == "warning"
        assert finding.observations == (a, b)


@pytest.mark.slow
def test_icon_out_of_step(icon: Stack) -> None:
    bad = altered(icon, lights=np.roll(icon.rig.directions, 1, axis=0))
    diagnosis = doctor.examine(bad)
    assert diagnosis["order"].numbers["verdict"] == "moved back by one"
    assert diagnosis["directions"].severity == diagnosis["pairing"].severity == "ok"


@pytest.mark.slow
def test_icon_read_as_linear(icon: Stack, data: Path) -> None:
    linear = read_stack(data / "icon_rti" / "dirs.lp", encoding="linear")
    finding = doctor.examine(linear)["encoding"]
    assert finding.severity == "warning"
    assert "linear" not in finding.numbers["plausible"]


@pytest.mark.slow
def test_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    stack = captured()
    write_stack("good.npz", stack)
    write_stack("bad.npz", turned(stack, [[1, 0, 0], [0, -1, 0], [0, 0, 1]]))
    Path("torn.npz").write_bytes(Path("good.npz").read_bytes()[:-500])
    assert main(["doctor", "good.npz"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("16 photographs, 6 bands, 72 x 72 pixels")
    assert out.rstrip().endswith("no fault found")
    assert main(["doctor", "bad.npz"]) == 1
    assert "error" in capsys.readouterr().out
    assert main(["doctor", "bad.npz", "--json"]) == 1
    content = json.loads(capsys.readouterr().out)
    assert content["worst"] == "error"
    assert [f["code"] for f in content["findings"] if f["severity"] == "error"] == ["directions"]
    assert main(["doctor", "torn.npz"]) == 3
    assert "torn.npz" in capsys.readouterr().err
    assert main(["doctor", "nowhere.npz"]) == 1
    assert main(["doctor"]) == 2
    capsys.readouterr()


@pytest.mark.slow
def test_repaired_lights(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Mirrored in y, and photographs 2 and 6 exchanged: the written file puts both right."""
    near = simulate.rig(RIGS[1], distance_mm=30.0)
    stack = captured(1, varnish="matte", rig=near)
    right = near.directions
    wrong = right * (1, -1, 1)
    wrong[[2, 6]] = wrong[[6, 2]]
    bad = altered(stack, lights=wrong, names=[f"{i}.tif" for i in range(16)])
    diagnosis = doctor.examine(bad)
    repaired = doctor.repaired_directions(bad, diagnosis)
    np.testing.assert_allclose(repaired, right, atol=1e-15)
    path = tmp_path / "bad.npz"
    write_stack(path, bad)
    assert main(["doctor", str(path), "--write", str(tmp_path / "good.lp")]) == 1
    written = read_lights(tmp_path / "good.lp")
    np.testing.assert_allclose(written.directions, right, atol=1e-12)
    assert written.names == bad.names
    assert doctor.examine(altered(bad, lights=written.directions)).usable
    told = capsys.readouterr().err
    assert f"{tmp_path / 'good.lp'} written: " in told
    assert "the directions of 2.tif and 6.tif are exchanged" in told
    assert "bad.npz keeps its own lights" in told
    assert main(["doctor", str(path), "--write", str(tmp_path / "good.lp")]) == 1
    assert "already exists" in capsys.readouterr().err


def test_every_damaged_file_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("a.png", "b.png", "c.png"):
        write_png16(tmp_path / name, np.zeros((3, 8, 8), np.uint16))
    write_lights(tmp_path / "dirs.lp", LIGHTS[:3], ["a.png", "b.png", "c.png"])
    for name in ("a.png", "c.png"):
        (tmp_path / name).write_bytes((tmp_path / name).read_bytes()[:-7])
    assert main(["doctor", str(tmp_path)]) == 3
    told = capsys.readouterr().err
    assert "a.png" in told
    assert "b.png" not in told
    assert told.count("c.png") == 1
    assert [Path(str(e.path)).name for e in doctor.damaged_files(tmp_path)] == ["a.png", "c.png"]


def test_repairs_of_reading_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stack = captured(1, RIGS[0])
    for index, samples in enumerate(stack.samples[:8]):
        write_png16(tmp_path / f"{index}.png", samples << 4)
    lines = [f"{i}.png {x} {y} {z}" for i, (x, y, z) in enumerate(stack.rig.directions * 1.5)]
    (tmp_path / "dirs.lp").write_text("\n".join(["12", *lines]))
    diagnosis = doctor.examine(read_stack(tmp_path / "dirs.lp"))
    told = {f.numbers["kind"]: f for f in diagnosis.findings if f.code == "reading"}
    assert told["missing"].severity == "warning"
    assert "8.png" in told["missing"].message
    assert told["length"].severity == told["count"].severity == "note"
    assert main(["doctor", str(tmp_path)]) == 0
    assert "8.png" in capsys.readouterr().out
