"""Plans of stored paintings are those of the paintings in memory, and read no maps for it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import impasto
from impasto import CorruptInputError, DistantLight, PointLight, Scene
from impasto.effects import Decisions
from impasto.fit.stored import StoredMaps
from killed_jobs import stack

pytest.importorskip("fcntl", reason="jobs need POSIX")

SIZE = (270, 530)
"""Two by three pieces of 256 pixels."""
SCENES = {
    "distant": Scene([DistantLight((0.3, 0.2, 0.9)), DistantLight((-0.9, 0.1, 0.2), 0.5)]),
    "dim": Scene([DistantLight((0.9, 0.0, 0.4), 1e-3)], exposure=1.0),
    "near": Scene([PointLight((60.0, 20.0, 30.0))]),
    "eye": Scene([DistantLight((0.3, 0.2, 0.9))], view=impasto.PointView((0.0, 0.0, 500.0))),
    "room": Scene(environment=impasto.Environment(np.linspace(0.1, 2.0, 384).reshape(3, 8, 16))),
    "brightest": Scene([DistantLight((0.3, 0.2, 0.9))], exposure="maximum"),
}
TOLERANCES = (0, "code:1", "dE:0.5")


def painting() -> impasto.Stack:
    """Half of it is not in the frame."""
    taken = stack(SIZE)
    mask = np.ones(SIZE, bool)
    mask[:5, :9] = mask[:, 300:420] = False
    return taken._replace(mask=mask, rig=impasto.Rig(taken.rig, pitch_mm=0.5))


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> dict[str, impasto.StoredSbrdf]:
    folder = tmp_path_factory.mktemp("plans")
    options: dict[str, Any] = {"pooling": "painting", "effort": "draft", "sample": 5}
    found = {}
    for name, tile, precision in (
        ("whole", 256, "single"),
        ("half", 256, "half"),
        ("odd", 100, "single"),
    ):
        out = impasto.run(
            painting(), folder / f"{name}.zarr", tile=tile, precision=precision, **options
        )
        found[name] = impasto.open_sbrdf(out)
    impasto.load_sbrdf(found["whole"].path).save(folder / "saved.zarr")
    return found | {"saved": impasto.open_sbrdf(folder / "saved.zarr")}


def told(plan: Decisions) -> tuple[Any, ...]:
    return plan.effects, plan.error, plan.unit, plan.tiles, plan.explain()


@pytest.mark.parametrize("store", ["whole", "half", "saved"])
def test_plans_are_those_of_the_painting_in_memory(
    store: str, stores: dict[str, impasto.StoredSbrdf], monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = stores[store]
    loaded = impasto.load_sbrdf(stored.path)
    if store != "saved":
        read = StoredMaps.read

        def pixel_only(self: StoredMaps, name: str, part: Any) -> Any:
            assert [p.stop - p.start for p in part] == [1, 1], f"{name} is read"
            return read(self, name, part)

        monkeypatch.setattr(StoredMaps, "read", pixel_only)
    left_out = set()
    for scene in SCENES.values():
        for tolerance in TOLERANCES:
            kept: Any = "photographs" if tolerance == 0 else "model"
            expected = impasto.plan(loaded, scene, tolerance=tolerance, fidelity=kept, level=False)
            found = stored.plan(scene, tolerance=tolerance, fidelity=kept)
            assert told(found) == told(expected)
            left_out |= {one.decision for one in found.effects}
    assert left_out >= {"absent", "no-op", "bounded", "on"}


def test_details_bands_and_levels_are_read(stores: dict[str, impasto.StoredSbrdf]) -> None:
    stored = stores["whole"]
    loaded = impasto.load_sbrdf(stored.path)
    part = np.s_[10:270, 200:500]
    for name in ("distant", "near"):
        scene = SCENES[name]
        found = stored.plan(scene, region=part, tolerance="dE:0.5")
        assert told(found) == told(
            impasto.plan(stored[part], scene, tolerance="dE:0.5", level=False)
        )
        some = loaded.with_bands([2, 0, 1])
        found = stored.plan(scene, bands=[2, 0, 1], fidelity="model")
        assert told(found) == told(impasto.plan(some, scene, fidelity="model", level=False))
        tilted = stored.plan(scene, level=True, fidelity="model")
        plane = stored.find_level()
        assert told(tilted) == told(impasto.plan(loaded, scene, level=plane, fidelity="model"))


def test_tiles_across_pieces_leave_out_no_more(stores: dict[str, impasto.StoredSbrdf]) -> None:
    stored = stores["odd"]
    loaded = impasto.load_sbrdf(stored.path)
    for scene in SCENES.values():
        exact = impasto.plan(loaded, scene, level=False)
        found = stored.plan(scene)
        for wide, narrow in zip(found.effects, exact.effects, strict=True):
            assert wide.name == narrow.name
            assert wide.tiles >= narrow.tiles
            assert wide.decision == "on" or narrow.decision != "on"


def test_damaged_statistics_are_refused(stores: dict[str, impasto.StoredSbrdf]) -> None:
    stored = stores["half"]
    file = stored.path / "statistics" / "c" / "0" / "0" / "0"
    before = file.read_bytes()
    try:
        file.write_bytes(before[:40] + bytes([before[40] ^ 1]) + before[41:])
        with pytest.raises(CorruptInputError, match="statistics"):
            stored.plan(SCENES["distant"])
        file.unlink()
        with pytest.raises(CorruptInputError, match="is missing"):
            stored.plan(SCENES["distant"])
    finally:
        file.write_bytes(before)
