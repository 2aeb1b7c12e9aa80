"""The matching experiment: pictures, orders, the log of a session, the page, and the analysis."""

from __future__ import annotations

import http.client
import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy import stats

import chromium
import impasto
from command_line import complaint
from impasto import ArgumentError, CorruptInputError, simulate
from impasto._internal.student import quantile
from impasto.cli import main
from impasto.matching import (
    Choice,
    Experiment,
    MatchingLog,
    MatchingServer,
    Stimuli,
    analyse,
    read_log,
    stimuli,
)
from impasto.matching.models import matches, transforms

DEGREES = tuple(round(0.1 * number, 1) for number in range(11))
SIZE = (24, 32)


@pytest.fixture(scope="module")
def painting(tmp_path_factory: pytest.TempPathFactory) -> tuple[impasto.Sbrdf, impasto.Reflectance]:
    capture = simulate.default_capture("tominaga-six-band-adaptation", size=SIZE)
    fit = impasto.fit_sbrdf(capture.stack, pooling="painting")
    return fit, impasto.fit_reflectance(capture.stack, fit, simulate.camera("six-band"))


@pytest.fixture(scope="module")
def shown(painting: tuple[impasto.Sbrdf, impasto.Reflectance]) -> Stimuli:
    return stimuli(*painting)


def experiment(shown: Stimuli, path: Path, **options: Any) -> Experiment:
    given = {"observer": "anna", "painting": "landscape", "adapt_seconds": 0.0} | options
    return Experiment(shown, path, **given)


def choice(one: Experiment, degree: float) -> dict[str, Any]:
    """What the page sends when the observer stops at the picture of a degree."""
    number = one.stimuli.degrees.index(degree)
    position = one.order(one.trial).index(number)
    return {"trial": one.trial, "position": position, "steps": 3, "seconds": 2.5}


def test_pictures_go_from_the_lamp_to_daylight_at_one_brightness(
    painting: tuple[impasto.Sbrdf, impasto.Reflectance], shown: Stimuli
) -> None:
    """Less adaptation is redder: red over blue falls from picture to picture.

    With one factor on all light the luminance of greys stays; colours shift it by some percent.
    """
    assert shown.degrees == DEGREES
    linear = [((one / 255.0 + 0.055) / 1.055) ** 2.4 for one in shown.pictures]
    means = np.array([one.mean(axis=(0, 1)) for one in linear])
    warmth = means[:, 0] / means[:, 2]
    assert (np.diff(warmth) < 0.0).all()
    assert warmth[0] > 2.0 * warmth[-1]
    luminance = means @ np.array([0.2126, 0.7152, 0.0722])
    assert np.abs(luminance / luminance.mean() - 1.0).max() < 0.1
    # Each is the picture that `render` makes of that scene.
    fit, reflectance = painting
    scene = impasto.Scene(
        [impasto.DistantLight((0.0, 0.71, 0.71))], illuminant="A", adaptation=0.6,
        exposure=shown.exposure,
    )  # fmt: skip
    expected = impasto.render(fit, scene, reflectance=reflectance).display
    np.testing.assert_array_equal(shown.pictures[6], expected)
    assert stimuli(*painting, (0.0, 1.0)).key != shown.key


def test_orders_are_random_and_repeatable(shown: Stimuli, tmp_path: Path) -> None:
    """Every order has all pictures; another observer and another trial have another one."""
    one = experiment(shown, tmp_path / "a.jsonl", trials=50)
    orders = [one.order(trial) for trial in range(50)]
    assert all(sorted(order) == list(range(11)) for order in orders)
    assert len({tuple(order) for order in orders}) == 50
    again = experiment(shown, tmp_path / "b.jsonl", trials=50)
    assert [again.order(trial) for trial in range(50)] == orders
    other = experiment(shown, tmp_path / "c.jsonl", trials=50, observer="ben")
    assert other.order(0) != orders[0]
    # The first picture is any of eleven: 50 draws miss at most half of them (chance below 1e-9).
    assert len({order[0] for order in orders}) > 5
    for each in (one, again, other):
        each.close()


def test_a_session_goes_on_where_it_was_killed(shown: Stimuli, tmp_path: Path) -> None:
    """A choice counts when its line is whole; a torn one is made again."""
    path = tmp_path / "a.jsonl"
    one = experiment(shown, path)
    for degree in (0.5, 0.7):
        one.save(choice(one, degree))
    one.close()
    data = path.read_bytes()
    path.write_bytes(data[:-7])
    assert [found.degree for found in read_log(path).choices] == [0.5]
    two = experiment(shown, path)
    assert two.trial == 1
    two.save(choice(two, 0.6))
    two.close()
    assert [found.degree for found in read_log(path).choices] == [0.5, 0.6]
    for change in ({"observer": "ben"}, {"seed": 3}, {"trials": 9}, {"painting": "icon"}):
        with pytest.raises(ArgumentError, match=r"log: .*another session"):
            experiment(shown, path, **change)
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(lines[0] + lines[1].replace(b"0.5", b"0.6") + lines[2])
    with pytest.raises(CorruptInputError, match="line 2"):
        read_log(path)
    (tmp_path / "other.jsonl").write_text('{"kind": "something else"}\n')
    with pytest.raises(CorruptInputError, match="line 1"):
        read_log(tmp_path / "other.jsonl")
    (tmp_path / "empty.jsonl").write_text("")
    with pytest.raises(CorruptInputError, match="no log"):
        read_log(tmp_path / "empty.jsonl")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"trial": 1}, "trial: expected 0 of 4, found 1; reload"),
        ({"trial": None}, "trial: expected 0"),
        ({"position": 11}, "position: expected 0 to 10, found 11"),
        ({"position": -1}, "position: "),
        ({"position": "3"}, "position: "),
        ({"steps": 0}, "steps: "),
        ({"seconds": -1.0}, "seconds: "),
        ({"seconds": "x"}, "seconds: "),
    ],
)
def test_what_no_page_sends_is_refused(
    shown: Stimuli, tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    one = experiment(shown, tmp_path / "a.jsonl")
    with pytest.raises(ArgumentError, match=message):
        one.save(choice(one, 0.5) | change)
    assert one.trial == 0
    one.close()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"observer": " "}, "observer: expected a name"),
        ({"trials": 0}, "trials: expected 1 to"),
        ({"seed": -1}, "seed: expected a whole number"),
        ({"adapt_seconds": float("nan")}, "adapt_seconds: expected 0 to"),
    ],
)
def test_wrong_sessions_are_refused(
    shown: Stimuli, tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    with pytest.raises(ArgumentError, match=message):
        experiment(shown, tmp_path / "a.jsonl", **change)
    assert not (tmp_path / "a.jsonl").exists()


@contextmanager
def served(one: Experiment) -> Iterator[MatchingServer]:
    server = MatchingServer(one)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
        one.close()


def test_the_page_never_learns_a_degree(shown: Stimuli, tmp_path: Path) -> None:
    """An observer who looks at what is sent sees positions in a random order only."""
    with served(experiment(shown, tmp_path / "a.jsonl")) as server:
        connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=20)

        def fetched(path: str) -> tuple[int, bytes]:
            connection.request("GET", f"/{server.token}/{path}")
            answer = connection.getresponse()
            return answer.status, answer.read()

        status, text = fetched("document.json")
        assert status == 200
        assert "degree" not in text.decode()
        order = server.subject.order(0)  # type: ignore[attr-defined]
        for position in (0, 10):
            status, data = fetched(f"picture/{position}?trial=0")
            assert status == 200
            picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
            np.testing.assert_array_equal(picture[..., ::-1], shown.pictures[order[position]])
        for gone in ("picture/11", "tile/0/0/0", "log", "editor.js", "page.html"):
            assert fetched(gone)[0] == 404, gone
        connection.close()


@pytest.mark.skipif(
    chromium.PROGRAM is None and not os.environ.get("IMPASTO_EXPECT_BROWSER"),
    reason="chromium is not installed",
)
def test_an_observer_with_a_keyboard_makes_all_matches(shown: Stimuli, tmp_path: Path) -> None:
    """In a browser: wait, step with the arrows, choose with Enter, until all trials are done."""
    path = tmp_path / "a.jsonl"
    one = experiment(shown, path, trials=2, adapt_seconds=0.3)
    with served(one) as server, chromium.Chromium(tmp_path / "profile") as page:
        page.open(server.url)
        assert page.value("document.documentElement.dataset.step") in {"adapt", "ready"}
        page.until("document.documentElement.dataset.step === 'ready'")
        page.click("#go")
        for trial, wanted in enumerate((0.6, 0.4)):
            page.until(
                "document.documentElement.dataset.step === 'match' && "
                f"document.getElementById('where').textContent.startsWith('match {trial + 1} of')"
            )
            position = one.order(trial).index(DEGREES.index(wanted))
            for _ in range(position + 11):
                page.key("ArrowRight")
            page.key("ArrowLeft")
            page.key("ArrowRight")
            shown_at = page.value("document.getElementById('picture').dataset.position")
            assert shown_at == str(position)
            page.screenshot(tmp_path / "match.png")
            page.key("Enter")
        page.until("document.documentElement.dataset.step === 'done'")
        page.key("Enter")  # nothing is left to choose
    log = read_log(path)
    assert [found.degree for found in log.choices] == [0.6, 0.4]
    # One for the first picture, and one for each key.
    assert log.choices[0].steps == 1 + one.order(0).index(6) + 11 + 2
    picture = cv2.imread(str(tmp_path / "match.png"))
    assert picture[:40].max() < 20  # a black page around the picture
    assert picture.max() > 60


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_the_command_serves_a_session_and_goes_on_with_it(
    painting: tuple[impasto.Sbrdf, impasto.Reflectance], tmp_path: Path
) -> None:
    """It prints the address, takes a choice, and says at Ctrl-C how far the session is."""
    fit, reflectance = painting
    (tmp_path / "fit").mkdir()
    fit.save(tmp_path / "fit" / "sbrdf.npz")
    reflectance.save(tmp_path / "fit" / "reflectance.npz")
    words = ["experiment", "run", str(tmp_path / "fit"), "--log", str(tmp_path / "a.jsonl")]
    words += ["--observer", "anna", "--degrees", "0,0.5,1", "--trials", "2", "--no-browser"]
    code = (
        "import signal\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores it\n"
        "from impasto.cli import main\n"
        f"raise SystemExit(main({words}))\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        lines = iter(process.stderr.readline, "")
        url = next(found[0] for line in lines if (found := re.search(r"http://\S+/", line)))
        host, token = url.removeprefix("http://").rstrip("/").split("/")
        connection = http.client.HTTPConnection(host, timeout=20)
        content = json.dumps({"trial": 0, "position": 1, "steps": 2, "seconds": 3.5})
        sent = {"Origin": f"http://{host}", "Content-Type": "application/json"}
        connection.request("POST", f"/{token}/save", content, sent)
        assert json.loads(connection.getresponse().read()) == {"said": "1 of 2"}
        connection.close()
        process.send_signal(signal.SIGINT)
        assert "1 of 2 in" in process.stderr.read()
        assert process.wait() == 0
    log = read_log(tmp_path / "a.jsonl")
    assert (log.observer, log.painting, log.trials) == ("anna", "fit", 2)
    assert [(one.steps, one.seconds) for one in log.choices] == [(2, 3.5)]


def test_the_command_refuses_a_result_without_spectra(
    painting: tuple[impasto.Sbrdf, impasto.Reflectance],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    painting[0].save(tmp_path / "sbrdf.npz")
    assert main(["experiment", "run", str(tmp_path), "--log", "a", "--observer", "b"]) == 1
    assert "no spectra; fit again with --camera" in capsys.readouterr().err


def session(observer: str, degrees: list[float], xyz: Any = None, **change: Any) -> MatchingLog:
    """A log as a session leaves it."""
    colours = [[0.3], [0.25], [0.06]] if xyz is None else xyz
    settings = {
        "observer": observer, "painting": "landscape", "trials": len(degrees), "seed": 0,
        "degrees": list(DEGREES), "illuminant": "A", "reference": "D65", "mode": "planck",
        "display": "srgb", "key": "0", "xyz": colours, "adapt_seconds": 180.0,
    }  # fmt: skip
    log = MatchingLog(settings | change)
    log.choices = [Choice(number, degree, 3, 1.0) for number, degree in enumerate(degrees)]
    return log


def simulated(rng: np.random.Generator, mean: float) -> list[MatchingLog]:
    """Fourteen observers who differ by 0.08, and are not sure by 0.06; four matches each."""
    logs = []
    for number in range(14):
        own = rng.normal(mean, 0.08)
        wanted = own + rng.normal(0.0, 0.06, 4)
        logs.append(session(f"{number}", [round(float(d), 1) for d in np.clip(wanted, 0.0, 1.0)]))
    return logs


@pytest.mark.parametrize("true", [0.35, 0.56, 0.7])
def test_the_degree_of_simulated_observers_is_recovered(
    true: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The interval of 95 % holds the true degree in 95 of 100 experiments, chance allowed for.

    Of 200 experiments 190 are expected; fewer than 178 or all 200 have a chance below 1e-3 (three
    and a half standard deviations of the binomial distribution, 3.1). Pictures in steps of a tenth
    add a variance of 0.01 / 12 to each choice and no bias in the middle of the range.
    """
    monkeypatch.setattr("impasto.matching.analysis.matches", lambda *_: ())
    rng = np.random.default_rng(7)
    found = [analyse(simulated(rng, true)) for _ in range(200)]
    hits = sum(one.interval[0] <= true <= one.interval[1] for one in found)
    assert 178 <= hits < 200
    means = np.array([one.degree for one in found])
    # Of a mean of fourteen observers, each of four choices: 0.08 and 0.06 with rounding.
    expected = np.sqrt((0.08**2 + (0.06**2 + 0.01 / 12) / 4) / 14)
    assert means.std() == pytest.approx(expected, rel=0.2)
    assert means.mean() == pytest.approx(true, abs=4 * expected / np.sqrt(200))
    between = np.mean([one.between**2 for one in found])
    assert between == pytest.approx(14 * expected**2, rel=0.1)
    within = np.mean([one.within**2 for one in found])
    assert within == pytest.approx(0.06**2 + 0.01 / 12, rel=0.1)


def test_the_interval_is_student_s() -> None:
    """Over the observers' means, as scipy computes it; not over choices, which are alike."""
    logs = [session("a", [0.4, 0.6]), session("b", [0.7, 0.7]), session("c", [0.5, 0.6])]
    found = analyse(logs, confidence=0.9)
    means = [0.5, 0.7, 0.55]
    low, high = stats.t.interval(0.9, 2, np.mean(means), stats.sem(means))
    assert found.interval == pytest.approx((low, high), rel=1e-9)
    assert found.degree == pytest.approx(np.mean(means))
    assert found.over == "observers"
    alone = analyse([logs[0]])
    assert alone.over == "choices"
    assert alone.interval == pytest.approx(
        stats.t.interval(0.95, 1, 0.5, stats.sem([0.4, 0.6])), rel=1e-9
    )
    assert "interval unknown to unknown" in str(analyse([session("a", [0.4])]))
    assert analyse([session("a", [0.4])]).to_dict()["interval"] == [None, None]
    assert quantile(0.025, 13) == pytest.approx(stats.t.isf(0.025, 13), rel=1e-10)


def test_observers_of_two_paintings_are_compared() -> None:
    logs = [
        session("a", [0.4, 0.4]), session("a", [0.6, 0.6], painting="icon"),
        session("b", [0.5, 0.5]), session("b", [0.7], painting="icon", trials=3),
    ]  # fmt: skip
    found = analyse(logs)
    assert found.paintings == pytest.approx({"icon": 0.65, "landscape": 0.45})
    assert found.observers == pytest.approx({"a": 0.5, "b": (0.5 + 0.5 + 0.7) / 3})
    assert found.unfinished == ("b (icon): 1 of 3",)
    for change in ({"illuminant": "D50"}, {"mode": "anchored"}, {"display": "display-p3"}):
        with pytest.raises(ArgumentError, match=f"logs: {next(iter(change))} differs"):
            analyse([logs[0], session("c", [0.5], **change)])
    with pytest.raises(ArgumentError, match="sessions with choices"):
        analyse([session("a", [])])


XYZ_A, XYZ_D65 = np.array([1.0985, 1.0, 0.3558]), np.array([0.9505, 1.0, 1.0890])
CAT16 = np.array(
    [[0.401288, 0.650173, -0.051461], [-0.250268, 1.204414, 0.045854],
     [-0.002079, 0.048952, 0.953127]]
)  # fmt: skip


def test_cat16_is_the_formula_of_its_paper() -> None:
    """Li et al. 2017: gains ``D w_r / w + 1 - D`` of cones, D of a dark room at 12 cd/m2.

    Whites to four digits are off by 1e-4.
    """
    d = 0.8 * (1.0 - np.exp((-12.0 - 42.0) / 92.0) / 3.6)
    gains = d * (CAT16 @ XYZ_D65) / (CAT16 @ XYZ_A) + 1.0 - d
    xyz = np.array([[0.3, 0.1], [0.25, 0.2], [0.06, 0.05]])
    expected = np.linalg.inv(CAT16) @ (gains[:, None] * (CAT16 @ xyz))
    (name,) = [one for one in transforms("A", "D65") if one.startswith("CAT16")]
    np.testing.assert_allclose(transforms("A", "D65")[name](xyz), expected, atol=2e-4)
    assert f"D = {d:.2f}" in name


def test_models_are_where_they_were_computed_by_hand(shown: Stimuli) -> None:
    """White degrees from A to D65 at 60 cd/m2: CAT16 in a dark room 0.72, CIE 1994 0.64.

    Complete adaptation to D65 is d = 1; colours of paint are nearest to degrees of their own.
    """
    found = matches(shown.xyz, "A", "D65", "planck", 0.56, (0.5, 0.6))
    cat16, von_kries, cie = found
    assert cat16.white_degree == pytest.approx(0.72, abs=0.01)
    assert cie.white_degree == pytest.approx(0.64, abs=0.01)
    assert von_kries.white_degree == pytest.approx(1.0, abs=0.002)
    assert von_kries.degree > 0.95
    # Anchored, the end of the path is D65 itself: von Kries' cones are those of eq. 9.
    anchored = matches(shown.xyz, "A", "D65", "anchored", 0.56, (0.5, 0.6))[1]
    assert anchored.degree == 1.0
    assert anchored.delta_e < 0.05
    assert not any(one.within for one in found)
    assert matches(shown.xyz, "A", "D65", "planck", 0.7, (0.65, 0.8))[0].within


def test_the_command_analyses_logs(
    shown: Stimuli, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = []
    for name, degree in (("anna", 0.5), ("ben", 0.6)):
        one = experiment(shown, tmp_path / f"{name}.jsonl", observer=name, trials=1)
        one.save(choice(one, degree))
        one.close()
        paths.append(str(tmp_path / f"{name}.jsonl"))
    out = tmp_path / "out"
    assert main(["experiment", "analyse", *paths, "--out", str(out), "--json"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["degree"] == pytest.approx(0.55)
    assert len(numbers["models"]) == 3
    assert json.loads((out / "report.json").read_text())["results"] == numbers
    assert cv2.imread(str(out / "matching.png")).shape[1] == 1100
    gone = ["experiment", "analyse", str(tmp_path / "gone.jsonl")]
    assert "gone.jsonl" in complaint(gone, 1, capsys)
    assert "expected the file of a session" in complaint(["experiment", "analyse"], 1, capsys)
    (tmp_path / "bad.jsonl").write_text("nothing\n")
    assert "bad.jsonl" in complaint(
        ["experiment", "analyse", str(tmp_path / "bad.jsonl")], 3, capsys
    )
