"""Drivers against devices that are not there: a dome on a pty, libgphoto2's virtual camera."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import cv2
import numpy as np
import pytest

import captures
import processes
from impasto import capture
from impasto.capture.drivers.by_hand import FolderCamera, HandLights
from impasto.capture.drivers.dome import Dome
from impasto.errors import ArgumentError, DeviceError, DisconnectedError, MissingExtraError
from impasto.io import read_session

pty = pytest.importorskip("pty", reason="pseudo-terminals are of POSIX systems")

# --- the dome

Reply = Callable[[int, str], bytes]


def firmware(number: int, order: str) -> bytes:
    """A dome with 64 lamps that does what the protocol says."""
    word, _, lamp = order.partition(" ")
    if word == "ID":
        return f"#{number} OK IMPASTO-DOME 1 64\n".encode()
    if word == "ON" and not 1 <= int(lamp) <= 64:
        return f"#{number} ERR no such lamp\n".encode()
    return f"#{number} OK {order}\n".encode()


@contextmanager
def dome_on_a_pty(reply: Reply = firmware) -> Iterator[str]:
    """The name of a serial port behind which a thread is the firmware."""
    import tty

    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    ended = threading.Event()

    def serve() -> None:
        held = b""
        with suppress(OSError):
            while not ended.is_set():
                held += os.read(ours, 256)
                while b"\n" in held:
                    line, _, held = held.partition(b"\n")
                    head, _, order = line.decode().partition(" ")
                    os.write(ours, reply(int(head.removeprefix("#")), order))

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield os.ttyname(theirs)
    finally:
        ended.set()
        os.close(theirs)  # the read of the firmware ends with it
        thread.join(2.0)
        os.close(ours)


def test_a_dome_switches_and_acknowledges() -> None:
    with dome_on_a_pty() as port, Dome(port) as dome:
        assert dome.lamps == 64
        assert [dome.switch_on(lamp) for lamp in (1, 64, 17)] == [1, 64, 17]
        dome.switch_off()
        with pytest.raises(DeviceError, match="the dome refuses ON 65: no such lamp"):
            dome.switch_on(65)


def test_a_dome_that_says_nothing_is_named_and_explained() -> None:
    """Three calls, since boards restart when their port is opened."""
    silent = dome_on_a_pty(lambda number, order: b"")
    with silent as port, pytest.raises(DisconnectedError) as caught:
        Dome(port, answer_s=0.1)
    assert str(caught.value) == (
        f"no answer from the dome at {port} to ID within 0.1 s; see that it has power, that the "
        "cable carries data, and that this is its port"
    )


def test_a_late_answer_is_not_taken_for_that_of_the_next_order() -> None:
    """Lamp 5 is acknowledged only after lamp 6 was ordered: its number gives it away."""
    late: list[bytes] = []

    def slow(number: int, order: str) -> bytes:
        if order == "ON 5":
            late.append(firmware(number, order))
            return b""
        return b"".join([*late, firmware(number, order)])

    with dome_on_a_pty(slow) as port, Dome(port, answer_s=0.2) as dome:
        with pytest.raises(DisconnectedError, match="no answer"):
            dome.switch_on(5)
        assert dome.switch_on(6) == 6


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (b"#1 OK Marlin 2 0\n", "is no dome with the protocol of impasto"),
        (b"#1 OK IMPASTO-DOME 2 64\n", "has version 2 of the protocol, expected 1"),
        (b"garbage\xff\n#1 what\n", "the dome answered 'what' to ID"),
    ],
)
def test_another_device_is_not_taken_for_a_dome(answer: bytes, words: str) -> None:
    other = dome_on_a_pty(lambda number, order: answer)
    with other as port, pytest.raises(DeviceError, match=words):
        Dome(port, answer_s=0.2)


def test_a_port_that_is_not_there() -> None:
    with pytest.raises(DisconnectedError, match=r"cannot be opened .* see that its cable"):
        Dome("/dev/ttyNONE7")


def test_a_dome_that_is_unplugged_stops_the_run_and_loses_nothing(tmp_path: Path) -> None:
    """The light comes from the simulated rig, orders go to the dome, which dies at lamp 4."""
    shots, out = captures.plan(6, references=0), tmp_path / "a"
    devices = captures.rig(shots)

    def dying(number: int, order: str) -> bytes:
        if order == "ON 4":
            return b""
        if order.startswith("ON"):
            devices.switch_on(int(order.split()[1]))
        elif order == "OFF":
            devices.switch_off()
        return firmware(number, order)

    stopped = pytest.raises(DisconnectedError, match="stopped at shot_004: no answer from the dome")
    with dome_on_a_pty(dying) as port, Dome(port, answer_s=0.1) as dome, stopped:
        capture.run(shots, devices, dome, None, out, warm_up_s=None)
    assert list(captures.log_of(out).entries) == [
        "dark_001", "dark_002", "shot_001", "shot_002", "shot_003"
    ]  # fmt: skip
    assert captures.wrong_pairings(out, devices) == []


def test_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'impasto\[capture\]'"):
        Dome("/dev/ttyNONE7")


# --- a camera of libgphoto2

CAMERA = """
import json, os, sys, tempfile
from pathlib import Path

folder = Path(tempfile.mkdtemp())
os.environ["VCAMERADIR"] = str(folder)  # read when the library is loaded
import cv2
import numpy as np
import captures
from impasto import capture
from impasto.capture.drivers.gphoto2_camera import GPhoto2Camera
from impasto.errors import DisconnectedError

SIZE = 60000
shots = captures.plan(3, darks=0, references=0)
rig = captures.rig(shots)

def photograph():
    # The virtual camera keeps the size that its file had first: a comment fills it up.
    codes = np.clip(np.moveaxis(rig._light(rig._on[0])[::-1], 0, -1) * 180, 0, 255)
    jpeg = cv2.imencode(".jpg", codes.astype(np.uint8))[1].tobytes()
    pad = SIZE - len(jpeg) - 4
    comment = b"\\xff\\xfe" + (pad + 2).to_bytes(2, "big") + bytes(pad)
    (folder / "one.jpg").write_bytes(jpeg[:2] + comment + jpeg[2:])

class Mirrored(GPhoto2Camera):
    def trigger(self):
        photograph()
        return super().trigger()

rig.switch_on(1)
photograph()
camera = Mirrored()
told = {"name": camera.name, "set": [camera.set_exposure(s) for s in (0.01, 0.02, 0.009)]}
out = Path(tempfile.mkdtemp()) / "a"
result = capture.run(shots, camera, rig, None, out, warm_up_s=None)
told["complete"] = result.complete
told["files"] = sorted(p.name for p in (out / "photographs").iterdir())
log = captures.log_of(out)
pictures = [cv2.imread(str(out / e.file)).mean() for e in log.entries.values()]
told["level"] = [float(one) for one in pictures]
told["expected"] = [float(np.clip(rig._light(n) * 180, 0, 255).mean()) for n in (1, 2, 3)]
camera.close()
try:
    GPhoto2Camera.trigger(camera)
except DisconnectedError as error:
    told["gone"] = str(error)
sys.stdout.write("\\n" + json.dumps(told))
"""


def test_a_camera_of_gphoto2_is_set_read_back_and_downloaded() -> None:
    """The virtual Nikon of libgphoto2, in a process of its own.

    Codes are rounded and JPEG keeps the mean of blocks to half a code: means differ by less than 1.
    """
    import json

    pytest.importorskip("gphoto2", reason="the extra capture is not installed")
    told = json.loads(processes.run(CAMERA).splitlines()[-1])
    assert told["name"].startswith("Nikon")
    assert told["set"] == [0.01, 0.02, 0.01]
    assert told["complete"]
    assert told["files"] == ["shot_001.jpg", "shot_002.jpg", "shot_003.jpg"]
    assert np.allclose(told["level"], told["expected"], atol=1.0)
    assert told["gone"] == "no camera; see that it is on, and to its cable"


# --- by hand


def test_new_photographs_of_a_folder_are_taken_when_they_are_whole(tmp_path: Path) -> None:
    """The file grows for a while, as one that is being copied; older files do not count."""
    picture = np.random.default_rng(1).integers(0, 65535, (40, 50, 3)).astype(np.uint16)
    data = cv2.imencode(".png", picture)[1].tobytes()
    (tmp_path / "old.png").write_bytes(data)
    said: list[str] = []
    camera = FolderCamera(tmp_path, said.append, patience_s=20.0, poll_s=0.02)
    assert camera.set_exposure(0.01) is None

    def copied() -> None:
        (tmp_path / "notes.txt").write_text("no photograph")
        with (tmp_path / "IMG_0001.PNG").open("wb") as file:
            for start in range(0, len(data), 4000):
                file.write(data[start : start + 4000])
                file.flush()
                time.sleep(0.05)

    thread = threading.Thread(target=copied)
    thread.start()
    frame = camera.trigger()
    thread.join()
    assert frame.data == data
    assert frame.suffix == ".PNG"
    assert said == [f"take the photograph; {tmp_path} is watched"]


def test_a_photograph_that_does_not_come_is_explained(tmp_path: Path) -> None:
    camera = FolderCamera(tmp_path, lambda words: None, patience_s=0.2, poll_s=0.02)
    with pytest.raises(DeviceError, match=r"no new photograph in .* within 0.2 s; see that"):
        camera.trigger()
    (tmp_path / "half.jpg").write_bytes(b"\xff\xd8\xff\xe0 half of a file")
    with pytest.raises(DeviceError, match=r"half\.jpg is "):
        camera.trigger()
    with pytest.raises(ArgumentError, match=r"watch: .* is no folder"):
        FolderCamera(tmp_path / "none", lambda words: None)


def test_a_person_is_told_which_lamp(tmp_path: Path) -> None:
    """Azimuth from the right against the clock, elevation from the painting."""
    said: list[str] = []
    confirmed: list[int] = []
    directions = np.array([[0.0, -0.6, 0.8], [0.0, 0.0, 1.0]])
    lights = HandLights(directions, said.append, lambda: confirmed.append(1))
    assert lights.switch_on(1) == 1
    lights.switch_off()
    lights.switch_off()
    assert said == [
        "switch on lamp 1 alone (azimuth 270, elevation 53 degrees)", "switch all lamps off"
    ]  # fmt: skip
    assert len(confirmed) == 2


def test_a_person_is_told_another_exposure(tmp_path: Path) -> None:
    """As in a bracket; the first one is set before the capture."""
    said: list[str] = []
    camera = FolderCamera(tmp_path, said.append)
    assert [camera.set_exposure(seconds) for seconds in (0.002, 0.002, 0.0333, 0.002)] == [None] * 4
    assert said == ["set the exposure time to 33.3 ms", "set the exposure time to 2 ms"]


def test_a_capture_by_hand_is_paired_and_its_exif_compared(tmp_path: Path) -> None:
    """A person who does what she is told; the second photograph has the wrong time at first."""
    image_module = pytest.importorskip("PIL.Image")
    watch, out = tmp_path / "card", tmp_path / "out"
    watch.mkdir()
    shots = captures.plan(3, darks=1, references=0)
    devices = captures.rig(shots)
    orders: list[str] = []
    times = iter([0.01, 0.01, 0.02, 0.01, 0.01])

    def person(words: str) -> None:
        orders.append(words.partition(";")[0])
        if words.startswith("switch on"):
            devices.switch_on(int(words.split()[3]))
        elif words.startswith("switch all"):
            devices.switch_off()
        else:
            light = sum(
                (devices._light(lamp) for lamp in devices._on), np.zeros((3, *captures.SIZE))
            )
            codes = np.clip(np.moveaxis(light, 0, -1) * 150, 0, 255).astype(np.uint8)
            picture = image_module.fromarray(codes)
            exif = picture.getexif()
            exif.get_ifd(0x8769)[0x829A] = next(times)
            exif[0x0110] = "Hand"
            picture.save(watch / f"IMG_{len(orders):04}.jpg", exif=exif, quality=95)

    camera = FolderCamera(watch, person, patience_s=20.0, poll_s=0.01)
    lights = HandLights(shots.directions, person)
    result = capture.run(shots, camera, lights, None, out, warm_up_s=None)
    assert result.complete
    (tried,) = captures.lines_of(out, "tried")
    assert (tried["tried"], tried["why"]) == ("shot_002", "the camera says 20 ms, the plan 10 ms")
    assert [words.split(" (")[0] for words in orders] == [
        "switch all lamps off", "take the photograph",
        "switch on lamp 1 alone", "take the photograph",
        *["switch on lamp 2 alone", "take the photograph"] * 2,
        "switch on lamp 3 alone", "take the photograph", "switch all lamps off",
    ]  # fmt: skip
    session = read_session(out)
    assert session.camera == "Hand"
    # Each file is the photograph under its lamp, and of no other one, by the mean of its codes.
    for lamp in (1, 2, 3):
        level = float(cv2.imread(str(out / "photographs" / f"shot_{lamp:03}.jpg")).mean())
        means = [np.clip(devices._light(n) * 150, 0, 255).mean() for n in (1, 2, 3)]
        assert int(np.argmin(np.abs(np.subtract(means, level)))) + 1 == lamp
