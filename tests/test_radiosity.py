"""Light between the cells of a relief: the numerics, held against plain numpy."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from impasto import ArgumentError, DistantLight, Rig, _core
from impasto.fit.relief import FormFactors, Relief
from oracles import form_factors as oracle

EPS = np.finfo(np.float64).eps
Array = NDArray[np.float32]


def matrix(height: Array, normal: Array) -> NDArray[np.float64]:
    """``(n, n)``: what each cell gets of light that one sends at a time, which is exact."""
    return FormFactors.of(height, normal).gather(np.eye(height.size, dtype=np.float32)).T


def normals_of(height: Array) -> Array:
    """Unnormalised, of differences; upright along sides of a cell."""
    slopes = [np.gradient(height, axis=i) if height.shape[i] > 1 else 0 * height for i in (1, 0)]
    right, down = (np.nan_to_num(slope) for slope in slopes)
    return np.stack([-right, down, np.ones_like(height)]).astype(np.float32)


def relief(seed: int, rows: int, columns: int, rough: float = 1.5) -> tuple[Array, Array]:
    """Random heights with slow and fast parts, with holes."""
    rng = np.random.default_rng(seed)
    slow = rng.normal(0.0, 1.0, (rows, columns)).cumsum(axis=0).cumsum(axis=1) / 8.0
    height = (slow + rough * rng.random((rows, columns))).astype(np.float32)
    normal = normals_of(height)
    height[rng.random((rows, columns)) < 0.1] = np.nan
    return height, normal


def leaning(seed: int, rows: int, columns: int) -> tuple[Array, Array]:
    """Normals in all directions: half of them point behind the surface, some lie in its plane."""
    height, normal = relief(seed, rows, columns)
    normal = np.random.default_rng(seed).normal(0.0, 1.0, normal.shape).astype(np.float32)
    normal[2].flat[::7] = 0.0
    normal[2].flat[3::7] = 1e-30
    return height, normal


RELIEFS: dict[str, tuple[Array, Array]] = {
    "random": relief(1, 19, 23),
    "smooth": relief(2, 31, 26, 0.0),
    "rough": relief(3, 20, 20, 40.0),
    "leaning": leaning(4, 21, 18),
    "one cell": relief(5, 1, 1),
    "one row": relief(6, 1, 40),
    "one column": relief(7, 40, 1),
    "flat": (np.zeros((12, 13), np.float32), normals_of(np.zeros((12, 13), np.float32))),
    "nothing": (np.full((9, 8), np.nan, np.float32), normals_of(np.zeros((9, 8), np.float32))),
    "tilted": (np.mgrid[:15, :17][1].astype(np.float32), normals_of(np.mgrid[:15, :17][1] * 1.0)),
}


@pytest.mark.parametrize("name", RELIEFS)
def test_form_factors_are_those_of_plain_numpy(name: str) -> None:
    height, normal = RELIEFS[name]
    expected = oracle.form_factors(height, normal)
    found = matrix(height, normal)
    # An antiderivative is (a (e + sc) + z s^2) / 2 with |e| below pi: at most 2.1, of some eight
    # roundings. A share is 1/16 of the sum of differences of two of them. Those of neighbours are
    # the largest: four or five azimuths, in each of which a cell may be nearest at two distances.
    # That is 2.1 * 8 eps * 2 * 10 / 16, about 21 eps. Whether a cell at the horizon itself is seen
    # depends on rounding, and its share is then of that size.
    assert np.abs(found - expected).max() <= 21 * EPS
    if name in {"one cell", "flat", "nothing"}:
        assert not found.any()
    else:
        assert np.abs(expected).max() > 0.005


def test_what_is_gathered_is_the_product_of_matrices() -> None:
    height, normal = RELIEFS["smooth"]
    sent = np.random.default_rng(8).random((53, height.size), dtype=np.float32)
    found = FormFactors.of(height, normal).gather(sent)
    shares = oracle.form_factors(height, normal)
    # Sums of fewer than 200 positive terms, one rounding for each product and each sum; shares are
    # right to 21 eps, and numpy's sums of n terms are at least as good.
    entries = (shares != 0.0).sum(axis=1).max()
    assert 50 < entries < 200
    bound = 400 * EPS * (sent @ shares.T) + 200 * 21 * EPS
    assert (np.abs(found - sent @ shares.T) <= bound).all()


def test_what_is_not_seen_is_not_kept() -> None:
    height, normal = RELIEFS["random"]
    first, cell, share = FormFactors.of(height, normal)
    shares = oracle.form_factors(height, normal)
    assert len(first) == height.size + 1
    # Up to those that rounding keeps.
    assert len(cell) == len(share) <= 1.01 * (shares != 0.0).sum()
    # A cell that sends no number is no matter to those that do not see it.
    sent = np.ones((1, height.size), np.float32)
    sent[0, cell[0]] = np.nan
    received = FormFactors(first, cell, share).gather(sent)[0]
    np.testing.assert_array_equal(np.isnan(received), shares[:, cell[0]] != 0.0)


@pytest.mark.parametrize("threads", [2, 3, 5])
def test_threads_change_no_bit(threads: int) -> None:
    height, normal = RELIEFS["smooth"]
    alone = FormFactors.of(height, normal)
    for one, other in zip(alone, _core.form_factors(height, normal, threads), strict=True):
        assert one.tobytes() == other.tobytes()
    sent = np.random.default_rng(9).random((90, height.size), dtype=np.float32)
    together = _core.gather(*alone, sent, threads)
    assert together.tobytes() == alone.gather(sent).tobytes()
    # Nor does what else is gathered.
    assert together[37:41].tobytes() == alone.gather(sent[37:41]).tobytes()


def test_rows_that_are_none_are_refused() -> None:
    height, normal = RELIEFS["random"]
    first, cell, share = FormFactors.of(height, normal)
    sent = np.ones((2, height.size), np.float32)
    wrong: list[tuple[Any, ...]] = [
        (first[:-1], cell, share, sent),
        (first[::-1].copy(), cell, share, sent),
        (first, cell[1:], share, sent),
        (first, cell, share[1:], sent),
        (first, np.full_like(cell, height.size), share, sent),
        (first[:0], cell[:0], share[:0], sent[:, :0]),
        (first, cell, share, sent[:, 1:].copy()),
        (first, cell, share, sent.T),
    ]
    for arguments in wrong:
        with pytest.raises(ArgumentError, match=r"rows|sent"):
            _core.gather(*arguments)
    with pytest.raises(ArgumentError, match="normal"):
        _core.form_factors(height, normal[:, 1:].copy())
    with pytest.raises(ArgumentError, match="height"):
        _core.form_factors(height[:0], normal[:, :0])


def hollow() -> Relief:
    y, x = (np.mgrid[:20, :20] - 9.5) / 6.0
    height = (-8.0 * np.exp(-(x**2) - y**2)).astype(np.float32)
    normal = normals_of(height) / np.linalg.norm(normals_of(height), axis=0)
    return Relief(height, normal, np.full((2, 20, 20), 0.7, np.float32), 1, np.zeros(2), True)


def shown(relief: Relief, rig: Rig) -> Array:
    light = np.ones((len(rig), 2, 20, 20), np.float32)
    relief.add_to(light, relief.diffuse, None, rig)
    return light


def test_lights_that_are_alike_are_found_once(monkeypatch: pytest.MonkeyPatch) -> None:
    lights = [DistantLight((0.6, 0.1 * i, 0.7)) for i in range(3)]
    rig = Rig([lights[i] for i in (0, 1, 0, 2, 1, 0)])
    one_by_one = np.concatenate([shown(hollow(), rig.take([index])) for index in range(len(rig))])
    sizes: list[int] = []
    visibility = Relief.visibility

    def counted(self: Relief, rig: Rig) -> Array:
        sizes.append(len(rig))
        return visibility(self, rig)

    monkeypatch.setattr(Relief, "visibility", counted)
    relief = hollow()
    assert shown(relief, rig).tobytes() == one_by_one.tobytes()
    assert sizes == [3]
    assert shown(relief, rig.take([2, 5, 3])).tobytes() == one_by_one[[2, 5, 3]].tobytes()
    assert sizes == [3]


def test_what_is_remembered_keeps_nothing_else_in_memory() -> None:
    relief = hollow()
    shown(relief, Rig([DistantLight((0.6, 0.1 * i, 0.7)) for i in range(5)]))
    kept = [one for both in relief._known.values() for one in both if one is not None]
    assert len(kept) == 10
    assert all(one.base is None for one in kept)


def test_a_relief_that_was_used_can_be_pickled() -> None:
    relief, rig = hollow(), Rig([DistantLight((0.6, 0.2, 0.7))])
    wanted = shown(relief, rig)
    again = pickle.loads(pickle.dumps(relief))
    assert shown(again, rig).tobytes() == wanted.tobytes()
    other = Rig([DistantLight((-0.5, 0.2, 0.7))])
    assert shown(again, other).tobytes() == shown(relief, other).tobytes()
