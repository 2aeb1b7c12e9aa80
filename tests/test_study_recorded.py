"""The study of time against accuracy: fronts, data, the sweep and what it writes."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
import study
from impasto import simulate
from impasto.effort import PRESETS
from impasto.simulate.planning import Truth
from impasto.study import pareto_front
from impasto.study.relative_error import full_scale, relative_error
from study import (
    candidates,
    data_sets,
    held_out_error,
    materials,
    minpack,
    settings,
    subsets,
    tables,
    treatments,
)
from study.__main__ import main
from study.cramer_rao import Bound, bound_of, strengths_off, widths_off
from study.journal import RUNS
from study.subsets import TooFewError

SIZES = data_sets.Sizes(painting=24, views=6, icon=24, paintings=2)


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The few settings of ``--quick`` on pictures that are smaller still; nothing but simulated."""
    out = tmp_path_factory.mktemp("study")
    return out, study.run(out, quick=True, sizes=SIZES, repeats=1)


# --- fronts


def test_the_front_is_what_nothing_beats() -> None:
    points = [(1.0, 9.0), (2.0, 9.0), (2.0, 4.0), (3.0, 5.0), (4.0, 4.0), (5.0, 1.0)]
    assert pareto_front.pareto_front(points) == [0, 2, 5]


def test_the_knee_is_where_time_stops_buying() -> None:
    # Error falls by 10 for the first doubling of time, by 2 per cent for each of the others.
    assert pareto_front.knee([(1.0, 10.0), (2.0, 1.0), (4.0, 0.98), (8.0, 0.96)]) == 1
    assert pareto_front.knee([(1.0, 1.0)]) == 0


def test_presets_lie_on_the_front() -> None:
    twice = {"effort": {"rounds": candidates.ROUNDS}}
    rng = np.random.default_rng(3)
    rungs = [
        candidates.Candidate(f"{i}", twice, float(t), float(e))
        for i, (t, e) in enumerate(zip(*np.exp(rng.normal(size=(2, 200))), strict=True))
    ]
    found = candidates.chosen(rungs)
    for candidate in found.values():
        assert not any(r.seconds < candidate.seconds and r.error < candidate.error for r in rungs)
    best = min(candidate.error for candidate in rungs)
    for name, near in (("reference", candidates.BEST), ("standard", candidates.NEAR_BEST)):
        as_good = [candidate.seconds for candidate in rungs if candidate.error <= near * best]
        assert found[name].seconds == min(as_good)
    assert found["draft"].seconds * 8 <= found["standard"].seconds
    # By hand: nothing is eight times faster; on logarithmic axes the second is farthest below the
    # chord from the first to the last.
    points = (("a", 2.0, 8.0), ("b", 4.0, 2.0), ("c", 8.0, 1.5), ("d", 12.0, 1.0))
    slow = candidates.chosen(
        [candidates.Candidate(name, twice, time, error) for name, time, error in points]
    )
    assert {name: candidate.setting for name, candidate in slow.items()} == {
        "draft": "b", "standard": "d", "reference": "d",
    }  # fmt: skip


@pytest.mark.parametrize("flagged", [0.0, 0.3])
def test_a_study_that_calls_for_no_preset_says_nothing_of_them(flagged: float) -> None:
    """What weighs samples anew twice is missing, or flags too many to be a preset."""
    efforts = [impasto.Effort(rounds=1), *([impasto.Effort(rounds=2)] if flagged else [])]
    rows = [
        {
            "data": "own model", "knob": "effort", "setting": f"{effort.rounds} rounds",
            "options": {"effort": effort.to_dict()}, "cost": {"cpu": 1.0, "wall": 1.0},
            "error": {
                "relative": 0.1, "psnr": 40.0, "colour": 0.2, "normal": 0.1, "normal_p95": 0.3,
                "flagged": flagged * (effort.rounds - 1),
            },
        }
        for effort in efforts
    ]  # fmt: skip
    made = tables.tables(rows)
    assert "derived" not in made
    assert len(made["effort"]) == len(rows)


# --- data


def test_no_stretch_of_the_dome_lies_in_a_ring() -> None:
    for lights in (data_sets.dome()[:6], data_sets.dome()[::5]):
        assert np.allclose(np.linalg.norm(lights, axis=1), 1.0)
        assert lights[:, 2].min() >= np.sin(np.radians(data_sets.LOWEST))
        # Lights in one ring would leave the third singular value of their differences at 0.
        assert np.linalg.svd(lights - lights.mean(axis=0))[1][2] > 0.25


def test_two_measurements_of_a_material_agree(data: Path) -> None:
    """The two tables fit the same measured materials: beside the highlight they must agree.

    To a factor of 1.6: that is what the fits themselves differ by (their residuals are some ten
    per cent, of darker materials more); a lost pi or cosine would be a factor of two or three.
    """
    angle = np.radians(np.array([12.0, 20.0, 30.0]))
    cosines = [np.full(3, np.cos(np.radians(30.0)))] * 2
    for name in materials.MATERIALS:
        both = []
        for file, reflect in materials.MODELS.values():
            row = materials.read_materials(data / "brdf" / file)[name]
            both.append(reflect(row, *cosines, np.cos(angle), cosines[0]).mean())
        assert 1 / 1.6 < both[0] / both[1] < 1.6, name


def test_measured_materials_are_reciprocal(data: Path) -> None:
    n_l, n_v, n_h, l_h = (np.array([c]) for c in (0.9, 0.6, 0.97, 0.8))
    for file, reflect in materials.MODELS.values():
        row = materials.read_materials(data / "brdf" / file)["white-paint"]
        there, back = reflect(row, n_l, n_v, n_h, l_h), reflect(row, n_v, n_l, n_h, l_h)
        # The same products in another order: a few roundings apart.
        assert np.allclose(there, back, rtol=1e-12)


def test_a_table_of_materials_that_is_damaged_is_named(tmp_path: Path) -> None:
    header = "material,kd_r,kd_g,kd_b,a_r,a_g,a_b,b,c,ior"
    for rows, words in (
        ("\x00\x01", "lacks 'special-walnut-224'"),
        (f"{header}\nwhite-paint,0.1,0.2", "no table of materials"),
        (f"{header}\nwhite-paint,0.1,0.2,x,1,1,1,1,1,1.5", "no table of materials"),
        (f"{header}\nwhite-paint,0.1,0.2,0.3,1,1,1,1,1,1.5,7", "no table of materials"),
        (f"{header}\nwhite-paint,0.1,0.2,0.3,1,1,1,1,1,1.5", "lacks 'special-walnut-224'"),
    ):
        (tmp_path / "abc_100.csv").write_text(rows)
        with pytest.raises(impasto.CorruptInputError, match=f"abc_100.csv: {words}"):
            materials.forward_of(tmp_path, "ABC")
    every = "\n".join(f"{name},0.1,0.2,0.3,1,1,1,1,1,1.5" for name in materials.MATERIALS)
    for table, words in (
        (f"{header}\n{every}".replace("ior", "index"), "lacks 'ior'"),
        (f"{header}\n{every}".replace("1.5", "nan"), "special-walnut-224 has numbers that reflect"),
        (
            f"{header},ior_r,ior_g,ior_b\n{every}".replace("1.5", "1.5,1,1,1"),
            "special-walnut-224: ",
        ),
    ):
        (tmp_path / "abc_100.csv").write_text(table)
        with pytest.raises(impasto.CorruptInputError, match=words):
            materials.forward_of(tmp_path, "ABC")
    (tmp_path / "abc_100.csv").write_text(f"{header}\n{every}")
    materials.forward_of(tmp_path, "ABC")


def test_as_many_photographs_as_there_are_are_no_choice() -> None:
    made, _ = data_sets.available(SIZES, 0, None)
    stack = made["own model"]()[0].stack
    for choice in treatments.SELECTIONS:
        for count in (48, 49):
            with pytest.raises(TooFewError, match=f"{count} of 48 photographs leave none out"):
                treatments.fewer(stack, 0, count=count, choice=choice)


def test_missing_data_is_said(tmp_path: Path) -> None:
    made, missing = data_sets.available(SIZES, 0, None)
    assert sorted(made) == ["770 views", "own model"]
    assert "icon_rti/dirs.lp" in missing["icon"]
    with pytest.raises(impasto.ArgumentError, match="data: there is no folder"):
        data_sets.available(SIZES, 0, tmp_path / "nowhere")


def test_a_spread_choice_is_more_even_than_chance() -> None:
    lights = data_sets.dome()

    def nearest(picked: Any) -> float:
        apart = np.linalg.norm(lights[picked][:, None] - lights[picked][None], axis=2)
        return float(apart[apart > 0].min())

    chance = max(nearest(np.random.default_rng(i).permutation(60)[:12]) for i in range(20))
    assert nearest(treatments.spread(lights, 12)) > chance


def test_photographs_that_determine_no_normal_are_drawn_again() -> None:
    """Nine in ten of the ball joint's photographs are lit from one arc, which lies in a plane."""
    made, _ = data_sets.available(SIZES, 0, None)
    stack = made["770 views"]()[0].stack
    total, count = len(stack.rig), 7

    def flat(order: Any) -> bool:
        return bool(np.linalg.matrix_rank(stack.rig.directions[order[:count]], tol=1e-6) < 3)

    redrawn = 0
    for seed in range(12):
        rng = np.random.default_rng([seed, count])
        orders = [rng.permutation(total) for _ in range(20)]
        first = next(order for order in orders if not flat(order))
        redrawn += first is not orders[0]
        picked = treatments.fewer(stack, seed, count=count, choice="random")
        # A stack has no name for its photographs: what they show tells them apart.
        assert (picked.samples == stack.samples[np.sort(first[:count])]).all()
    # Four in ten: that all of twelve are good at first comes once in five hundred times, that none
    # is once in sixty thousand.
    assert 0 < redrawn < 12


def test_the_best_photographs_are_better_than_those_spread_evenly() -> None:
    made, _ = data_sets.available(replace(SIZES, painting=36), 0, None)
    stack = made["own model"]()[0].stack
    light = np.array([stack.linear(i) for i in range(len(stack.rig))])
    some, best, again = (
        treatments.fewer(stack, 3, count=9, choice=choice) for choice in ("spread", "best", "best")
    )
    assert (best.samples == again.samples).all()
    # No photograph twice; what was exchanged was chosen by every third pixel, and shows on all.
    assert len({photograph.tobytes() for photograph in best.samples}) == 9
    errors = [
        relative_error(
            impasto.fit_sbrdf(part, pooling="pixel").predict(stack.rig), light, full_scale(stack)
        )
        for part in (some, best)
    ]
    assert errors[1] < errors[0]


@pytest.mark.parametrize("sort", treatments.NUMBER_FORMATS)
def test_recoded_photographs_show_the_same_light(sort: str) -> None:
    stack = simulate.default_capture("tominaga-rgb-camera", size=(16, 16)).stack
    other = treatments.recoded(stack, 0, number_format=sort)
    first, second = (np.array([s.linear(i) for i in range(9)]) for s in (stack, other))
    clipped = ~np.isfinite(first)
    assert not np.isfinite(second[clipped]).any()
    # Half a code of full scale (1 / 0.6), of float16 half a part in 1024 of the light.
    full = 1.0 / 0.6
    bound = {"8-bit sRGB": 0.011 * full, "float16": full / 2048}
    # And float32's own rounding of light up to that.
    own = full / 2**24
    bound |= {f"{bits}-bit linear": 0.5 * full / (2**bits - 1) + own for bits in (8, 12, 16)}
    fine = np.isfinite(second) & ~clipped
    assert np.abs(first - second)[fine].max() <= 1.001 * bound.get(sort, 0.0)


def test_a_large_picture_is_a_small_one_over_and_over() -> None:
    made, _ = data_sets.available(SIZES, 0, None)
    paintings = made["own model"]()
    first = paintings[0]
    (large,) = subsets.repeated(paintings, times=3)
    assert large.megapixels == pytest.approx(9.0 * first.megapixels)
    for place in np.ndindex(3, 3):
        here = np.s_[..., *(slice(24 * at, 24 * (at + 1)) for at in place)]
        assert (large.stack.samples[here] == first.stack.samples).all()
        assert (large.held[here] == first.held).all()
        assert (large.normal[here] == first.normal).all()
    # Every fit that somebody gets by name has its time on a large one.
    every = settings.settings()
    one_view = {s.name for s in every if s.knob == "pooling" and s.name != "Lafortune"}
    named = one_view | {f"lobes per pixel, {preset}" for preset in PRESETS}
    assert {s.name for s in every if s.knob == "size"} == named
    # What all lights give is on every data set of the quick study, too.
    quick = settings.settings(quick=True)
    every_light = [s for s in quick if (s.knob, s.name) == ("lights", "all")]
    assert sorted(name for s in every_light for name in s.on) == sorted(settings.ONE_VIEW)
    # The quick study has no time for it.
    assert "size" in {setting.knob for setting in settings.settings()}
    assert "size" not in {setting.knob for setting in settings.settings(quick=True)}


def test_a_class_of_fewer_pixels_than_a_row_fills_one() -> None:
    made, _ = data_sets.available(data_sets.Sizes(painting=5, paintings=1), 0, None)
    (part,) = subsets.alike(made["own model"](), lobes=1)
    assert part.stack.shape[2:] == part.held.shape[2:] == (1, subsets.WIDTH)


def test_all_lights_are_as_many_as_there_are(data: Path) -> None:
    made, _ = data_sets.available(SIZES, 0, data)
    every = [s for s in settings.settings() if s.knob == "lights" and s.name == "all"]
    for setting in every:
        for name in setting.on:
            assert setting.number == len(made[name]()[0].stack.rig), name
    assert sorted(name for setting in every for name in setting.on) == sorted(settings.ONE_VIEW)


# --- measures


def test_a_perfect_fit_has_no_error() -> None:
    made, _ = data_sets.available(SIZES, 0, None)
    first, second = made["own model"]()

    class Perfect:
        def __init__(self, painting: data_sets.PaintingData) -> None:
            self.normal = painting.normal
            self.status = np.zeros(painting.stack.shape[2:], np.uint8)
            self.held = painting.held

        def predict(self, lights: Any) -> Any:
            del lights
            return self.held

    both = Perfect(first), Perfect(second)
    errors = held_out_error.compared(both, (first, second))
    assert (errors.relative, errors.colour, errors.flagged) == (0.0, 0.0, 0.0)
    assert errors.normal == pytest.approx(0.0, abs=1e-4)
    # Nothing is known of the second painting: what is left is its share of the light, a right
    # angle at half of the pixels.
    both[1].held = np.full_like(first.held, np.nan)
    both[1].normal = np.full_like(first.normal, np.nan)
    both[1].status[:] = 1
    errors = held_out_error.compared(both, (first, second))
    light = [(np.minimum(p.held, 1.0 / p.exposure) ** 2).sum() for p in (first, second)]
    # Sums in another order, in single precision.
    assert errors.relative == pytest.approx(np.sqrt(light[1] / sum(light)), rel=1e-5)
    assert (errors.normal, errors.normal_p95) == pytest.approx((45.0, 90.0), abs=1e-4)
    assert errors.flagged == 0.5


def test_the_peer_s_radiance_is_the_papers() -> None:
    """``minpack.radiance`` against ``impasto``'s own, which has oracles elsewhere.

    In float32 near the horizon a sample is known to some 1e-5 of its size.
    """
    rig = impasto.Rig(data_sets.dome(12))
    normal = np.array([0.1, -0.2, 1.0]) / np.linalg.norm([0.1, -0.2, 1.0])
    base = minpack.base_of(normal)
    unknowns = np.array([0.0, 0.0, 0.2, 0.3, 0.4, 8.0, np.log(0.12)])
    mine = minpack.radiance(rig, unknowns, base, 3)
    planes = normal.astype(np.float32)[:, None, None]
    diffuse = np.array([0.2, 0.3, 0.4], np.float32)[:, None, None]
    theirs = impasto.Surface.torrance_sparrow(planes, diffuse, 8.0, 0.12).predict(rig)[:, :, 0, 0]
    assert np.allclose(mine, theirs, rtol=3e-5, atol=1e-6)


def test_the_bound_falls_with_the_root_of_the_photographs() -> None:
    """Every photograph twice holds twice the information."""
    made, _ = data_sets.available(SIZES, 0, None)
    painting, _ = made["own model"]()
    assert painting.truth is not None
    once, twice = (
        bound_of(painting.truth, painting.stack.rig.take([*range(16)] * count)) for count in (1, 2)
    )
    # Sums of products in another order: rounding of float64, times the condition of 7 unknowns.
    assert once.normal / twice.normal == pytest.approx(np.sqrt(2.0), rel=1e-6)
    assert once.width / twice.width == pytest.approx(np.sqrt(2.0), rel=1e-6)
    assert once.strength / twice.strength == pytest.approx(np.sqrt(2.0), rel=1e-6)


def _bounded() -> tuple[data_sets.PaintingData, Truth, Bound, Any]:
    """A painting, what is true of it, what no fit can beat, and where that is known."""
    made, _ = data_sets.available(SIZES, 0, None)
    painting, _ = made["own model"]()
    assert painting.truth is not None
    return painting, painting.truth, bound_of(painting.truth, painting.stack.rig), np.s_[3::6, 3::6]


def test_widths_are_off_by_so_many_bounds() -> None:
    painting, truth, bound, places = _bounded()
    here = truth.gamma[0][places]
    off = bound.width.reshape(here.shape)
    gamma = np.full(truth.gamma.shape[1:], np.nan)
    # Either way off by three bounds; of a normal law that would be the median of 3 / 0.674.
    gamma[places] = here * np.exp(np.where(np.indices(here.shape).sum(axis=0) % 2, 3.0, -3.0) * off)
    assert widths_off([gamma], [truth], [bound]) == pytest.approx(3.0 / 0.67449, rel=1e-5)
    # A width that is not known is none: by a quarter of the pixels the median moves no further.
    gamma[3::6, 3::24] = np.nan
    assert widths_off([gamma], [truth], [bound]) == pytest.approx(3.0 / 0.67449, rel=1e-5)
    assert widths_off([np.full_like(gamma, np.nan)], [truth], [bound]) == np.inf
    # Where there is no gloss nothing tells of its width, and no fit is asked.
    matte = replace(truth, beta=np.zeros_like(truth.beta))
    none = bound_of(matte, painting.stack.rig)
    assert np.isinf(none.width).all()
    assert np.isinf(none.strength).all()


def test_strengths_are_off_by_so_many_bounds() -> None:
    _, truth, bound, places = _bounded()
    here = truth.beta[0][places]
    beta = np.zeros(truth.beta.shape[1:])
    beta[places] = here * (1.0 - 2.0 * bound.strength.reshape(here.shape))
    assert strengths_off([beta], [truth], [bound]) == pytest.approx(2.0 / 0.67449, rel=1e-5)
    # No lobe is one without strength: off by all of it.
    none = strengths_off([np.zeros_like(beta)], [truth], [bound])
    assert none == pytest.approx(np.median(1.0 / bound.strength) / 0.67449, rel=1e-5)


# --- the sweep


def test_no_fit_beats_the_bound(quick: tuple[Path, dict[str, Any]]) -> None:
    some = (row for row in quick[1]["rows"] if "bound" in row)
    rows = [row for row in some if row["error"]["normal"] is not None]
    assert {"lights", "effort", "normals"} <= {row["knob"] for row in rows}
    assert all({"width", "strength"} <= row.keys() for row in rows if row["knob"] == "effort")
    # The bound takes a pixel's two tilts for equally known. Where one is known without error the
    # mean angle is that of one normal deviate, sqrt(2 / pi) s, and the bound says
    # sqrt(pi / 2) sqrt(s^2 / 2): it is never too high by more than their quotient, 0.900.
    least = np.sqrt(2.0 / np.pi) / np.sqrt(np.pi / 4.0)
    for row in rows:
        assert row["error"]["normal"] > least * row["bound"], row["setting"]


def test_the_same_seed_gives_the_same_errors(
    quick: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    again = study.run(tmp_path, quick=True, sizes=SIZES, repeats=1, threads=1)
    first = [(row["data"], row["setting"], row["error"]) for row in quick[1]["rows"]]
    assert first == [(row["data"], row["setting"], row["error"]) for row in again["rows"]]


def test_everything_is_written(quick: tuple[Path, dict[str, Any]]) -> None:
    out, found = quick
    names = {path.name for path in study.write(found, out)}
    assert {"study.json", "study.md", "front.svg", "front.png", "lights.svg", "views.svg"} <= names
    kept = json.loads((out / "study.json").read_text("utf-8"))
    assert kept["run"]["seed"] == 0
    assert {"processor", "commit", "simd"} <= kept["run"].keys()
    assert kept["presets"] == json.loads(json.dumps(tables.tables(found["rows"])["presets"]))
    page = (out / "study.md").read_text("utf-8")
    assert "); quick study, on small pictures, seed 0.\n" in page
    assert "* Without icon: " in page
    # Whoever reads it has no other page to go to.
    assert "](#" not in page
    before = (out / "front.svg").read_bytes()
    study.write(found, out)
    assert (out / "front.svg").read_bytes() == before


def test_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(
        "study.sweep.QUICK", data_sets.Sizes(painting=16, views=4, icon=16, paintings=1)
    )
    out = tmp_path / "found"
    monkeypatch.setattr("study.__main__.data_folder", lambda: tmp_path / "nowhere")
    # The fixture has run all knobs.
    monkeypatch.setattr("study.__main__.run", partial(study.run, knobs=("effort", "peer")))
    command = ["--quick", "--out", str(out), "--repeats", "1", "--no-figures"]
    assert main(command) == 0
    said = capsys.readouterr()
    assert "lobes per pixel, standard" in said.out
    assert "without icon" in said.err
    assert {path.name for path in out.iterdir()} == {RUNS, "study.json", "study.md"}
    assert main(["--quick", "--out", str(out), "--seed", "1"]) == 1
    assert "error: out: " in (words := capsys.readouterr().err)
    assert "another study (seed 0, now 1)" in words
    assert main(["--quick", "--out", str(out), "--repeats", "0"]) == 1
    assert "repeats: expected a whole number from 1, found 0" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        main(["--quick", "--record"])
    assert "the quick study is not recorded" in capsys.readouterr().err
