"""What a study's rows say, in sentences: rows by hand, the words that must come."""

from __future__ import annotations

from typing import Any

import pytest

from impasto.effort import PRESETS
from study import recommendations
from study.sentences import paragraphs
from study.tables import unbeaten


def test_sentences_say_what_rows_say() -> None:
    """Half the time, a decibel less on the one set, the same on the other; nothing is lost."""

    def row(name: str, data: str, seconds: float, decibels: float) -> dict[str, Any]:
        error = {"psnr": decibels, "flagged": 0.5}
        return {
            "knob": "lobes", "setting": name, "data": data, "cost": {"cpu": seconds},
            "error": error,
        }  # fmt: skip

    rows = [
        row(name, data, seconds, decibels + more)
        for name, seconds, decibels in (
            ("none", 1, 20),
            ("1 at most", 2, 30),
            ("2 at most", 6, 31.5),
        )
        for data, more in (("own model", 0.0), ("icon", 2.0 if name == "2 at most" else 0.0))
    ]
    assert "lobes" not in paragraphs(rows)
    rows += [row("3 at most", "own model", 6, 31.46), row("3 at most", "icon", 6, 33.5)]
    at_most = (
        "The first lobe gains +10.0 dB; 2 at most instead of 1: 3.0 times the time, "
        "+1.5 to +3.5 dB; 3 at most instead of 2: 1.0 times the time, 0.0 dB"
    )
    assert paragraphs(rows) == {"lobes": f"{at_most}."}
    rows += [row("2 always", "own model", 9, 31.0), row("2 always", "icon", 9, 33.5)]
    always = "2 always instead of at most: 1.5 times the time, -0.5 to 0.0 dB"
    assert paragraphs(rows) == {"lobes": f"{at_most}; {always}."}


@pytest.mark.parametrize(("loss", "verdict"), [(20.0, "it cannot"), (1.0, "it can")])
def test_the_sentence_on_views_says_whether_the_claim_holds(loss: float, verdict: str) -> None:
    """By the best of the choices, at a fortieth or less; what a hundredth loses is no matter."""
    losses = {350: 0.4, 175: 1.0, 70: 1.0, 35: 1.0, 18: loss, 7: 30.0}
    decibels = {(700, "all"): 60.0} | {
        (count, f"{count} {choice}"): 60.0 - least - further
        for count, least in losses.items()
        for choice, further in (("random", 2), ("spread", 0), ("best", 1))
    }
    rows = [
        {
            "knob": "views", "setting": name, "data": "770 views", "number": count,
            "error": {"psnr": value},
        }
        for (count, name), value in decibels.items()
    ]  # fmt: skip
    text = paragraphs(rows)["views"]
    assert f" about 1 dB. Here {verdict}. Change against all photographs, by the best" in text
    lost = "1/2 0 dB, 1/4 -1 dB, 1/10 -1 dB, 1/20 -1 dB"
    assert f"selections: {lost}, 1/39 -{loss:.0f} dB, 1/100 -30 dB. The simulated surface" in text


def test_the_advice_says_what_leaving_the_default_gives() -> None:
    """By hand, on two data sets; of the second nobody knows the normals."""
    errors = {
        "one lobe": ((30.0, 2.0, 1.0, 0.2), (25.0, 4.0, None, 0.1)),
        "one lobe, as the papers have it": ((28.0, 2.5, 2.0, 0.0), (26.0, 4.0, None, 0.0)),
        "draft": ((38.0, 1.5, 0.3, 0.05), (31.5, 3.0, None, 0.015)),
        "standard": ((40.0, 1.5, 0.2, 0.0), (31.0, 3.1, None, 0.01)),
        "reference": ((39.9, 1.5, 0.15, 0.0), (31.0, 3.1, None, 0.01)),
    }
    seconds = {"one lobe": 90.0, "one lobe, as the papers have it": 9.0}
    seconds |= {"draft": 5.0, "standard": 10.0, "reference": 30.0}
    rows = [
        {
            "knob": "effort" if name in PRESETS else "pooling", "setting": name, "data": data,
            "cost": {"cpu": seconds[name]},
            "error": dict(zip(("psnr", "colour", "normal", "flagged"), error, strict=True)),
            "options": {"effort": PRESETS[name].to_dict()} if name in PRESETS else {},
        }
        for name, both in errors.items()
        for data, error in zip(("own model", "icon"), both, strict=True)
    ]  # fmt: skip
    many, first, last, default = recommendations.choice(rows).splitlines()
    assert (
        "are 6.0 to 10.0 dB nearer than with one lobe, colours 0.50 to 0.90 ΔE00, normals 0.80 °."
        in many
    )
    assert (
        "0.50 times the time of the standard effort; at most 2.0 dB, 0.00 ΔE00 and 0.10 °" in first
    )
    # In the mean of 5 and 1.5 % and of 0 and 1 %, as the table has it.
    assert "3.2 % of the pixels are flagged instead of 0.5 %." in first
    assert "3.0 times the time; at most 0.0 dB, 0.00 ΔE00 and 0.05 ° are gained." in last
    assert "takes 0.10 times the time and changes photographs by -2.0 to +1.0 dB." in default
    # Where no data set of both has true normals nothing is said of them.
    alone = [r for r in rows if r["setting"] != "draft" or r["data"] == "icon"]
    assert "at most 0.0 dB and 0.00 ΔE00 are lost" in paragraphs(alone)["choice"]


def test_it_is_said_with_how_many_lights_pixels_have_lobes_of_their_own() -> None:
    """By hand: with 14 they gain on both data sets, with 9 on one, with 6 again on both."""
    decibels = {
        14: ((31.0, 33.5), (30.0, 30.0)),
        9: ((31.0, 29.0), (30.0, 30.0)),
        6: ((31.0,) * 2, (30.0,) * 2),
    }
    rows = [
        {
            "knob": "lights", "setting": f"{count} spread{which}", "data": data, "number": count,
            "error": {"psnr": value, "normal": angle if data == "own model" else None},
        }
        for count, both in decibels.items()
        for which, values, angle in zip(("", ", one lobe"), both, (0.25, 1.0), strict=True)
        for data, value in zip(("own model", "icon"), values, strict=True)
    ]  # fmt: skip
    assert paragraphs(rows)["enough"] == (
        "With 14 lights or more, spread evenly, lobes per pixel predict held-out photographs "
        "better than one lobe on every data set. Difference to one lobe: "
        "14 lights +1.0 to +3.5 dB, normals -0.75 °; 9 lights -1.0 to +1.0 dB, normals -0.75 °; "
        "6 lights +1.0 dB, normals -0.75 °."
    )
    few = paragraphs([row for row in rows if row["number"] == 9])["enough"]
    assert few.startswith("Even with 9 lights, lobes per pixel do not predict")
    # A record without one lobe of fewer lights says nothing.
    assert paragraphs([row for row in rows if not row["setting"].endswith("one lobe")]) == {}


def test_what_a_large_picture_takes_is_told_beside_a_small_one() -> None:
    rows = [
        {
            "knob": knob, "setting": name, "data": "own model", "number": number,
            "cost": {"cpu": seconds}, "options": {},
        }
        for knob, number, both in (("pooling", None, (96.54, 9.0)), ("size", 64, (40.3, 8.0)))
        for name, seconds in zip(("one lobe", "one lobe, by hand"), both, strict=True)
    ]  # fmt: skip
    assert paragraphs(rows) == {
        "size": "A picture 64 times as large takes, in CPU seconds per megapixel: one lobe 40.3 "
        "instead of 96.5; one lobe, by hand 8.0 instead of 9.0."
    }
    assert paragraphs(rows[:2]) == {}


def test_waiting_is_told_in_processor_time() -> None:
    rows = [
        {"knob": "stereo", "data": "icon", "cost": {"cpu": 2.0, "wall": seconds}}
        for seconds in (1.9, 2.3)
    ]
    assert paragraphs(rows) == {
        "wall": "Wall-clock times are 0.95 to 1.15 times these CPU seconds."
    }


def test_peers_that_are_not_beaten_are_named() -> None:
    """By hand: of ours one fit, of theirs one that is faster, and two that are neither.

    One of these shows colours that are nearer all the same.
    """
    rows = [
        {
            "knob": knob, "setting": name, "data": "icon", "cost": {"cpu": seconds},
            "error": {"relative": error, "psnr": 30.0, "colour": colour},
        }
        for knob, name, seconds, error, colour in (
            ("lobes", "2 at most", 2.0, 0.1, 1.0), ("peer", "RBF, thin plate", 1.0, 0.2, 1.0),
            ("peer", "HSH", 3.0, 0.2, 0.9), ("peer", "PTM", 3.0, 0.2, 1.1),
        )
    ]  # fmt: skip
    said = (
        "2 of 3 peers are beaten by a fit of impasto in both time and error of relighting; 1 of "
        "them by a fit that is no worse in decibels and ΔE00. Not beaten:\n\n"
        "* gilded icon, photographs: "
    )
    assert paragraphs(rows)["peers"] == f"{said}*RBF, thin plate*."
    assert paragraphs([rows[0], rows[2]])["peers"] == (
        "A fit of impasto is as fast and as accurate as every peer; 0 of them by a fit that is no "
        "worse in decibels and ΔE00."
    )
    # Without a fit of ours nobody has been compared with it.
    assert "peers" not in paragraphs(rows[1:])
    assert unbeaten(rows[1:]) == []


def test_presets_are_compared_with_the_bound() -> None:
    """By hand: a tenth, a fifth, two fifths above it; widths half as far again, strengths twice."""
    rows = [
        {
            "knob": "effort", "setting": name, "data": data, "bound": 0.05,
            "error": {"normal": 0.05 * more}, "width": 1.5 * more, "strength": 2.0 * more,
            "options": {"effort": PRESETS[name].to_dict()},
        }
        for name, more in {"draft": 1.4, "standard": 1.2, "reference": 1.1}.items()
        for data in ("own model", "icon")
    ]  # fmt: skip
    assert paragraphs(rows) == {
        "bound": "On the simulated paintings with all photographs, errors of normals (mean), "
        "widths and strengths of gloss (median) are these multiples of their Cramér-Rao bounds: "
        '`"draft"` 1.40, 2.10 and 2.80, `"standard"` 1.20, 1.80 and 2.40, `"reference"` 1.10, 1.65 '
        "and 2.20. The bound of a strength assumes a colourless varnish; the fit does not."
    }
    # A record of before widths were measured.
    assert paragraphs([{k: v for k, v in row.items() if k != "width"} for row in rows]) == {}


def test_a_sentence_says_what_precision_is_worth() -> None:
    """By hand: a fifth more time for nothing, twice the time for a decibel and a hundredth."""
    rows = [
        {
            "knob": "precision", "setting": name, "data": "own model", "cost": {"cpu": seconds},
            "error": {"psnr": decibels, "normal": angle},
        }
        for name, seconds, decibels, angle in (
            ("single", 10.0, 40.0, 0.2),
            ("polished", 12.0, 40.0, 0.2),
            ("double", 20.0, 41.0, 0.19),
        )
    ]  # fmt: skip
    assert paragraphs(rows) == {
        "precision": 'Against single precision: `precision="polished"` takes 1.20 times the time, '
        'photographs 0.0 dB, normals 0.000 °; `precision="double"` takes 2.00 times the time, '
        "photographs +1.0 dB, normals -0.010 °."
    }
    # A study of two precisions says nothing of the third.
    assert paragraphs(rows[:2]) == {}
