"""Captures of a simulated rig: every misfire is found, nothing is lost, the session can be read."""

from __future__ import annotations

import os
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

import captures
import impasto
from impasto import capture, simulate
from impasto.capture import Frame, Pose, Shot, ShotPlan
from impasto.capture.drivers.faults import Fault, Faults, random_faults
from impasto.capture.drivers.simulated import SimulatedRig
from impasto.capture.journal import Entry, read_log
from impasto.errors import (
    ArgumentError,
    CorruptInputError,
    DeviceError,
    DisconnectedError,
    ResumeMismatchError,
)
from impasto.io import read_session
from impasto.io.json_lines import sealed_line


def degrees(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip((a * b).sum(axis=0), -1.0, 1.0)))


# --- without faults


def test_the_session_of_a_capture_is_fitted_as_photographs_that_never_were_files(
    tmp_path: Path,
) -> None:
    """Dark frames, hashes and directions come right: the normals are those of the same rig.

    Both fits see the same light with other noise, 16 bits against 12: of errors of one or two
    degrees, which relief and gloss make, a tenth is far more than the noise changes.
    """
    shots = captures.plan(24)
    result = captures.taken(shots, captures.rig(shots), tmp_path / "a")
    assert result.complete
    assert result.session == tmp_path / "a" / "session.toml"
    assert result.session is not None
    stack = impasto.read_stack(result.session)
    assert stack.shape == (24, 3, *captures.SIZE)
    assert np.allclose(stack.rig.directions, shots.directions, atol=1e-12)
    painting, part = captures.painting(), np.s_[:, 16:48, 16:48]
    rig = impasto.Rig(shots.directions)
    direct = simulate.capture(painting, rig, captures.camera(), exposure=0.5).stack
    fits = [impasto.fit_sbrdf(one[part[1:]], pooling="painting") for one in (stack, direct)]
    errors = [float(np.median(degrees(fit.normal, painting.normal[part]))) for fit in fits]
    assert errors[0] < 1.1 * errors[1]


def test_the_order_of_the_usual_plan() -> None:
    """Dark frames, then each lamp once, a reference before every ten and one at the end."""
    shots = captures.plan(24)
    assert [s.name for s in shots.of("dark")] == ["dark_001", "dark_002"]
    assert [s.lamp for s in shots.of("photograph")] == list(range(1, 25))
    kinds = [s.kind for s in shots][2:]
    assert [n for n, kind in enumerate(kinds) if kind == "reference"] == [0, 11, 22, 27]
    frontal = int(shots.directions[:, 2].argmax()) + 1
    assert {s.lamp for s in shots.of("reference")} == {frontal}


def test_poses_exposures_and_boards_go_into_the_session(tmp_path: Path) -> None:
    """Two views, two exposures and a board for each lamp; strengths are ratios of exposures."""
    directions = captures.light_file(3).directions
    side = (0.6, 0.0, 0.8)
    shots = ShotPlan(
        (
            *(Shot(f"white_{n}", "board", n, 0.01) for n in (1, 2, 3)),
            Shot("a", "photograph", 1, 0.01),
            Shot("b", "photograph", 2, 0.005),
            Shot("c", "photograph", 3, 0.01),
        ),
        directions,
    )
    result = captures.taken(shots, captures.rig(shots), tmp_path / "a")
    session = read_session(tmp_path / "a")
    assert result.complete
    assert session.intensities == (1.0, 0.5, 1.0)
    assert session.white == tuple(f"board/white_{n}.png" for n in (1, 2, 3))
    assert session.board_exposure == (1.0, 0.5, 1.0)
    # The same reflectance as with boards of the same time; the noise of a sample is 0.5 % of full
    # scale at most, and the medians are of 19 200 samples.
    darks = tuple(Shot(f"dark_{n}", "dark", None, 0.01) for n in (1, 2))
    own = replace(shots, shots=(*darks, *shots.shots))
    same = replace(own, shots=tuple(replace(one, exposure_s=0.01) for one in own.shots))
    for name, plan in (("c", own), ("d", same)):
        captures.taken(plan, captures.rig(plan), tmp_path / name)
    assert read_session(tmp_path / "d").board_exposure is None
    found, expected = (impasto.read_stack(tmp_path / name).samples for name in "cd")
    for one, other in zip(found, expected, strict=True):
        assert float(np.nanmedian(one / other)) == pytest.approx(1.0, abs=0.003)
    posed = replace(shots, shots=(replace(shots.shots[3], pose=Pose(view=side)), shots.shots[5]))
    captures.taken(posed, captures.rig(posed), tmp_path / "b")
    assert read_session(tmp_path / "b").views == {"a.png": side, "c.png": (0.0, 0.0, 1.0)}


def test_a_stage_that_stops_short_is_ordered_again(tmp_path: Path) -> None:
    """Its joint stays behind once; a plan with joints is refused where no stage moves."""

    class Sticking(SimulatedRig):
        stuck = 1
        joints = ("tilt",)

        def move(self, pose: Pose) -> Pose:
            behind, self.stuck = self.stuck, 0
            return replace(pose, angles={"tilt": pose.angles["tilt"] - 0.1 * behind})

    shots = captures.plan(1, darks=0, references=0)
    shots = replace(shots, shots=(replace(shots.shots[0], pose=Pose(angles={"tilt": 0.3})),))
    stage = Sticking(captures.painting(), shots.directions, bands=captures.camera())
    assert captures.taken(shots, stage, tmp_path / "a").complete
    (tried,) = captures.lines_of(tmp_path / "a", "tried")
    assert tried["code"] == "wrong-pose"
    with pytest.raises(ArgumentError, match="the plan sets the joints tilt"):
        capture.run(shots, stage, stage, None, tmp_path / "b", warm_up_s=None)


# --- faults of single photographs

CODES: dict[Fault, set[str]] = {
    "timeout": {"device"}, "setting": {"wrong-exposure"}, "exposure": {"wrong-exposure"},
    "duplicate": {"duplicate"}, "missing": {"missing"}, "corrupt": {"corrupt"},
    "disconnect": {"disconnected"}, "no-ack": {"device"}, "late-ack": {"wrong-lamp"},
    "wrong-ack": {"wrong-lamp"}, "wrong-lamp": {"wrong-lamp"}, "dark": {"no-light"},
    "double": {"double-light"}, "clipped": {"clipped"}, "blurred": {"blurred"},
    "moved": {"moved"}, "drift": {"lamp-drift"},
}  # fmt: skip


def test_every_fault_is_found_by_its_name_and_taken_again(tmp_path: Path) -> None:
    """One of each kind among 104 photographs: all end up right, and the journal has the causes."""
    assert CODES.keys() == set(get_args(Fault))
    shots = captures.plan(104)
    # The drift comes last: it concerns all photographs between two reference shots.
    kinds = [kind for kind in get_args(Fault) if kind != "drift"]
    photographs = [n for n, s in enumerate(shots, 1) if s.kind == "photograph"]
    places = photographs[10:90:5]
    # What fails at once is repeated at once, which moves the rest by one.
    at, moved_by = {}, 0
    later = {"wrong-lamp", "double", "blurred", "moved"}
    names: dict[str, Fault] = {}
    for kind, place in zip(kinds, places, strict=True):
        at[place + moved_by] = kind
        names[shots.shots[place - 1].name] = kind
        moved_by += kind not in later
    drift = photographs[97]
    at[drift + moved_by] = "drift"
    devices = captures.rig(shots, Faults(at))
    result = captures.taken(shots, devices, tmp_path / "a")
    assert result.complete
    assert captures.wrong_pairings(tmp_path / "a", devices) == []
    found: dict[str, set[str]] = {}
    for line in captures.lines_of(tmp_path / "a", "code"):
        if name := line.get("tried") or line.get("failed"):
            found.setdefault(name, set()).add(line["code"])
    drifted = {name for name, codes in found.items() if codes == {"lamp-drift"}}
    assert shots.shots[drift - 1].name in drifted
    assert {name: found[name] for name in names} == {n: CODES[k] for n, k in names.items()}
    # A right neighbour of a wrong one may be taken again, too.
    assert len(found.keys() - drifted - names.keys()) <= 2
    committed = {entry.sha256 for entry in captures.log_of(tmp_path / "a").entries.values()}
    impasto.read_stack(tmp_path / "a")
    assert len(committed) == len(shots)


def test_a_capture_with_many_misfires_has_no_wrong_pairing(tmp_path: Path) -> None:
    """Ten in a hundred, of all kinds at random; ``benches/python/capture.py`` takes 770 shots."""
    shots = captures.plan(45)
    devices = captures.rig(shots, random_faults(len(shots), 0.1, seed=11))
    result = captures.taken(shots, devices, tmp_path / "a")
    assert result.complete
    assert captures.wrong_pairings(tmp_path / "a", devices) == []


# --- faults that stay


@pytest.mark.parametrize(
    ("fault", "error", "words"),
    [
        ("disconnect", DisconnectedError, "the camera does not answer: see to its cable"),
        ("no-ack", DeviceError, "no acknowledgement of lamp"),
        ("setting", DeviceError, "the camera says 20 ms, the plan 10 ms"),
        ("dark", DeviceError, "no light: 0 % of what this lamp should give"),
        ("moved", DeviceError, "moved 1.0 px to the right against the others"),
    ],
)
def test_a_fault_that_stays_stops_the_run_and_loses_nothing(
    tmp_path: Path, fault: Fault, error: type[DeviceError], words: str
) -> None:
    shots, out = captures.plan(14), tmp_path / "a"
    broken = captures.rig(shots, Faults(forever={12: fault}))
    with pytest.raises(error, match="the capture stopped at") as caught:
        captures.taken(shots, broken, out)
    assert words in str(caught.value)
    assert "--resume" in str(caught.value)
    before = captures.log_of(out).entries
    assert f"{len(before)} of {len(shots)} shots" in str(caught.value)
    # A camera that moves is found at the next reference shot: what is since the last one goes.
    assert len(before) == (3 if fault == "moved" else 11)
    mended = captures.rig(shots, seed=6)
    assert captures.taken(shots, mended, out, resume=True).complete
    assert captures.wrong_pairings(out, broken, mended) == []
    after = captures.log_of(out).entries
    assert all(after[name] == entry for name, entry in before.items())


@pytest.mark.parametrize("warm_up_s", [None, 0.0])
def test_a_rig_without_light_stops_at_the_first_reference_shot(
    tmp_path: Path, warm_up_s: float | None
) -> None:
    """Also while it is waited for a warm lamp; the two dark frames are kept."""
    shots, out = captures.plan(6), tmp_path / "a"
    faults = Faults(forever={3: "dark"})
    with pytest.raises(DeviceError, match=r"reference_001: .* is dark: 0\.0 % of full scale; see"):
        captures.taken(shots, captures.rig(shots, faults), out, warm_up_s=warm_up_s)
    assert list(captures.log_of(out).entries) == ["dark_001", "dark_002"]


def test_a_shot_that_fails_four_times_is_named_and_kept_out(tmp_path: Path) -> None:
    """All tries of shot_003 and of the retakes are overexposed; the last ones are kept."""
    shots, out = captures.plan(12), tmp_path / "a"
    third = [shot.name for shot in shots].index("shot_003") + 1
    tries = dict.fromkeys(range(third, third + 4), "clipped")
    faults = Faults(tries, forever={len(shots) + 4: "clipped"})
    result = captures.taken(shots, captures.rig(shots, faults), out)
    (retake,) = result.retakes
    assert str(retake).startswith("shot_003 (lamp 3): ")
    assert str(retake).endswith("% of the pixels are overexposed")
    assert (result.planned, result.taken) == (len(shots), len(shots) - 1)
    right = tuple(f"shot_{n:03}.png" for n in range(1, 13) if n != 3)
    assert impasto.read_stack(out).names == right
    assert any((out / "withdrawn").iterdir())
    assert captures.taken(shots, captures.rig(shots, seed=8), out, resume=True).complete


class JumpingClock(SimulatedRig):
    """Its clock is set an hour back during the capture."""

    def trigger(self) -> Frame:
        frame = super().trigger()
        assert frame.taken is not None
        back = timedelta(hours=1) if len(self.taken) > 9 else timedelta(0)
        return replace(frame, taken=frame.taken - back)


def test_a_jump_of_the_clock_is_named_and_keeps_the_order(tmp_path: Path) -> None:
    shots, out, said = captures.plan(12), tmp_path / "a", []
    devices = JumpingClock(captures.painting(), shots.directions, bands=captures.camera())
    assert captures.taken(shots, devices, out, say=said.append).complete
    assert said == [
        "the clock of the camera has jumped 3600 s back; shots keep their order, which is that of "
        "the journal"
    ]
    assert list(captures.log_of(out).entries) == [shot.name for shot in shots]


def test_a_lamp_is_waited_for_until_it_is_warm(tmp_path: Path) -> None:
    """It gains 2 % in the first frames: three that differ by less than 0.3 % come after these."""

    class Warming(SimulatedRig):
        def _light(self, lamp: int) -> np.ndarray:
            return super()._light(lamp) * np.float32(1.0 - 0.1 * 0.5 ** len(self.taken))

    shots, out = captures.plan(12), tmp_path / "a"
    devices = Warming(captures.painting(), shots.directions, bands=captures.camera())
    assert captures.taken(shots, devices, out, warm_up_s=0.0).complete
    (note,) = (one for one in captures.lines_of(out, "note") if one["note"] == "warm")
    # 0.1 / 2^n falls below 0.3 % of the light between the fifth and the seventh photograph, of
    # which two were dark frames.
    assert note["text"] == "settled after 6 reference frames"


# --- the folder


def test_a_capture_is_not_overwritten_and_not_mixed(tmp_path: Path) -> None:
    shots, out = captures.plan(12), tmp_path / "a"
    captures.taken(shots, captures.rig(shots), out)
    with pytest.raises(ArgumentError, match="already holds a capture"):
        captures.taken(shots, captures.rig(shots), out)
    other = captures.plan(11)
    with pytest.raises(ResumeMismatchError, match="another plan"):
        captures.taken(other, captures.rig(other), out, resume=True)
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "letter.txt").write_text("mine")
    with pytest.raises(ArgumentError, match="not empty and holds no capture"):
        captures.taken(shots, captures.rig(shots), tmp_path / "b")


def test_two_runs_cannot_be_at_one_folder(tmp_path: Path) -> None:
    shots, out, refused = captures.plan(12), tmp_path / "a", []

    def second(done: int, total: int) -> None:
        if done == 3:
            words = f"in use by another job, process {os.getpid()}"
            with pytest.raises(ArgumentError, match=words):
                captures.taken(shots, captures.rig(shots), out, resume=True)
            refused.append(done)

    captures.taken(shots, captures.rig(shots), out, progress=second)
    assert refused == [3]


def test_a_session_that_was_edited_by_hand_stays(tmp_path: Path) -> None:
    shots, out = captures.plan(12), tmp_path / "a"
    captures.taken(shots, captures.rig(shots), out)
    (out / "photographs" / "shot_004.png").unlink()
    session = out / "session.toml"
    session.write_text(session.read_text().replace("# title =", "title ="))
    result = captures.taken(shots, captures.rig(shots, seed=9), out, resume=True)
    assert result.complete
    assert result.session is None
    assert "title = " in session.read_text()


# --- the check


def test_files_that_were_exchanged_damaged_or_lost_are_named(tmp_path: Path) -> None:
    shots, out = captures.plan(12), tmp_path / "a"
    captures.taken(shots, captures.rig(shots), out)
    assert capture.check(out).complete
    home = out / "photographs"
    two, three = home / "shot_002.png", home / "shot_003.png"
    content = two.read_bytes(), three.read_bytes()
    two.write_bytes(content[1])
    three.write_bytes(content[0])
    whole = (home / "shot_005.png").read_bytes()
    (home / "shot_005.png").write_bytes(whole[: len(whole) // 2])
    (home / "shot_007.png").unlink()
    result = capture.check(out)
    words = {one.name: (one.misfire.code, one.misfire.why) for one in result.retakes}
    assert words["shot_002"] == (
        "swapped",
        "photographs/shot_002.png is the photograph of shot_003: files were exchanged",
    )
    assert [words[name][0] for name in ("shot_003", "shot_005", "shot_007")] == [
        "swapped", "corrupt", "missing"
    ]  # fmt: skip
    assert len(words) == 4
    assert result.taken == len(shots) - 4
    again = captures.taken(shots, captures.rig(shots, seed=8), out, resume=True)
    assert again.complete
    assert capture.check(out).complete
    # What the folder held before is kept.
    assert len(list((out / "withdrawn").iterdir())) == 3


def test_a_folder_without_a_capture_cannot_be_checked(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="holds no capture"):
        capture.check(tmp_path)


@pytest.mark.parametrize(
    "change",
    [{"lamp": "1"}, {"exposure_s": float("nan")}, {"name": 3}, {"tries": 0.5}, {"file": "../a"}],
)
def test_a_journal_whose_values_are_of_another_kind_is_damaged(
    change: dict[str, Any], tmp_path: Path
) -> None:
    """The checksum of a line is right: another program wrote it."""
    good = Entry("a", "photographs/a.png", "0" * 64, 1, 0.01, 1.7e9, 1, 0.5)
    path = tmp_path / "journal.jsonl"
    head = sealed_line({"plan": "0" * 64})
    path.write_bytes(head + sealed_line({"shot": vars(good)}))
    assert read_log(path).entries == {"a": good}
    path.write_bytes(head + sealed_line({"shot": {**vars(good), **change}}))
    with pytest.raises(CorruptInputError, match="is damaged in line 2"):
        read_log(path)
