"""The walls of the house (CONTRIBUTING.md, "Layout") stand."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import python_modules
import rust_modules

ROOT = Path(__file__).resolve().parents[1]
CORE = ROOT / "crates" / "impasto" / "src"
BORDER = ROOT / "crates" / "impasto-py" / "src"
CARD = ROOT / "crates" / "impasto-gpu" / "src"
PACKAGE = ROOT / "python" / "impasto"
CRATES = sorted(path.parent for path in (ROOT / "crates").glob("*/Cargo.toml"))


def rust(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.rs"))


def code(path: Path) -> str:
    """A Rust file without its comments and without its own tests."""
    text = re.sub(r"//.*", "", path.read_text(encoding="utf-8"))
    return text.split("#[cfg(test)]")[0]


def imports(path: Path) -> set[str]:
    """The crate's own modules that a Rust file names."""
    text = code(path)
    names = set(re.findall(r"\bcrate::(\w+)", text))
    for group in re.findall(r"\bcrate::\{([^;]*)\};", text):
        names |= set(re.findall(r"(?:^|,)\s*(\w+)", re.sub(r"\{[^{}]*\}", "", group)))
    return {name for name in names if name[0].islower()}


def tracked() -> list[Path]:
    listing = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if listing.returncode:
        pytest.skip("not a git checkout")
    return [ROOT / name for name in listing.stdout.split("\0") if name and (ROOT / name).exists()]


@pytest.fixture(scope="module")
def packages() -> dict[str, set[str]]:
    """Direct dependencies of each crate, without those of its tests."""
    if shutil.which("cargo") is None:
        pytest.skip("cargo is not installed")
    found = subprocess.run(
        ["cargo", "metadata", "--format-version=1", "--no-deps", "--offline"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return {
        package["name"]: {d["name"] for d in package["dependencies"] if d["kind"] is None}
        for package in json.loads(found.stdout)["packages"]
    }


def test_the_numerics_know_neither_python_nor_the_gpu(packages: dict[str, set[str]]) -> None:
    assert not packages["impasto"] & {"pyo3", "numpy", "wgpu", "impasto-py", "impasto-gpu"}


def test_only_the_border_knows_python(packages: dict[str, set[str]]) -> None:
    assert {name for name, needs in packages.items() if "pyo3" in needs} == {"impasto-py"}


def test_only_the_card_s_renderer_knows_the_gpu(packages: dict[str, set[str]]) -> None:
    assert {name for name, needs in packages.items() if "wgpu" in needs} == {"impasto-gpu"}
    assert not packages["impasto-gpu"] & {"pyo3", "numpy", "impasto-py", "nalgebra", "rayon"}


def test_the_card_s_renderer_sees_surfaces_and_scenes_alone() -> None:
    allowed = {"surface", "relight", "geometry", "math", "pixels", "Error"}
    found = {name for path in rust(CARD) for name in re.findall(r"\bimpasto::(\w+)", code(path))}
    assert found == allowed - {"math"} or found == allowed


@pytest.mark.parametrize(
    ("room", "allowed"),
    [
        ("math", {"math"}),
        ("lm", {"lm", "math"}),
        ("brdf", {"brdf", "math"}),
        ("geometry.rs", {"error", "math"}),
        ("surface", {"surface", "geometry", "brdf", "math", "pixels", "error"}),
        ("passes.rs", set()),
        ("pixels.rs", {"passes", "math", "error"}),
        ("height.rs", {"pixels", "math", "error"}),
        ("radiosity.rs", {"pixels", "error"}),
        ("spectral", {"spectral", "maps", "pixels", "math", "error"}),
        ("stereo", {"stereo", "stack", "maps", "geometry", "pixels", "math", "error"}),
        ("relight", {"relight", "surface", "height", "geometry", "pixels", "math", "error"}),
        (
            "sbrdf",
            {"sbrdf", "surface", "stack", "maps", "geometry", "brdf", "lm", "pixels", "math"}
            | {"passes", "error"},
        ),
    ],
)
def test_a_room_imports_only_what_lies_below_it(room: str, allowed: set[str]) -> None:
    files = [path for path in rust(CORE / room) if path.name != "tests.rs"] or [CORE / room]
    for path in files:
        assert imports(path) <= allowed, path.relative_to(ROOT)


@pytest.mark.parametrize("crate", CRATES, ids=lambda crate: crate.name)
def test_no_file_imports_from_one_that_imports_from_it(crate: Path) -> None:
    graph = rust_modules.imports(crate / "src")
    assert any(graph.values())
    assert rust_modules.circles(graph) == []


def test_a_circle_of_imports_is_found(tmp_path: Path) -> None:
    files = {
        "lib.rs": "pub mod room;\npub mod other;",
        "room/mod.rs": "mod a;\nmod b;\npub use a::{A, Other};\npub struct Own;",
        "room/a.rs": "use super::{b::{B, C}, Own};\npub struct A;\npub struct Other;",
        "room/b.rs": "use crate::other::D;\npub struct B;\npub struct C;",
        # A re-exported item belongs to the file that defines it.
        "other.rs": "use crate::room::Other;\npub struct D;",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    graph = rust_modules.imports(tmp_path)
    assert graph["room", "a"] == {("room",), ("room", "b")}
    assert graph["other",] == {("room", "a")}
    assert rust_modules.circles(graph) == [["other", "room", "room::a", "room::b"]]
    (tmp_path / "other.rs").write_text("pub struct D;")
    # What a folder's own file defines must not come from one that it re-exports.
    assert rust_modules.circles(rust_modules.imports(tmp_path)) == [["room", "room::a"]]


def test_errors_name_no_other_module() -> None:
    assert imports(CORE / "error.rs") == set()


def test_only_pixels_names_rayon() -> None:
    assert [p.name for p in rust(CORE) if re.search(r"\brayon\b", code(p))] == ["pixels.rs"]


def test_only_the_lanes_are_unsafe() -> None:
    unsafe = [p for p in rust(ROOT / "crates") if re.search(r"\bunsafe\b", code(p))]
    lanes = rust(CORE / "math" / "lanes")
    assert lanes
    assert set(unsafe) <= set(lanes)


def test_the_numerics_touch_no_file_environment_or_clock() -> None:
    banned = re.compile(r"std::(fs|env|time|net|process)\b|\bprintln!|\bsrgb\b|\bcie\b", re.I)
    assert [p for p in rust(CORE) + rust(CARD) if banned.search(code(p))] == []


def test_the_border_has_no_formula() -> None:
    formula = re.compile(r"\bmul_add\b|\.(sqrt|exp|ln|powi|powf|sin|cos|atan2)\(")
    assert [p for p in rust(BORDER) if formula.search(code(p))] == []


def test_colour_knows_no_stack_and_no_fit() -> None:
    reach = re.compile(r"impasto(\.| import .*\b)(stack|Stack|fit|io|render|_core|simulate)\b")
    for path in sorted((PACKAGE / "colour").rglob("*.py")):
        assert not reach.search(path.read_text(encoding="utf-8")), path.relative_to(ROOT)


def test_the_package_knows_no_benchmark() -> None:
    """``benches/study`` imports impasto, never the other way round."""
    reach = re.compile(r"^\s*(from|import) (study|record|pages)\b", re.MULTILINE)
    found = [p for p in PACKAGE.rglob("*.py") if reach.search(p.read_text(encoding="utf-8"))]
    assert found == []


def test_no_python_module_imports_one_that_imports_it() -> None:
    graph = python_modules.imports(PACKAGE)
    assert graph["impasto.io.images.read"] >= {"impasto.io.images.exr", "impasto.errors"}
    assert python_modules.circle(graph) == []
    assert python_modules.circle(python_modules.folders(graph, PACKAGE.name)) == []


def test_a_circle_of_python_imports_is_found(tmp_path: Path) -> None:
    """Also one that a function or a type checker closes, and one between folders only."""
    package = tmp_path / "house"
    files = {
        "__init__.py": "from house.a.first import A\nfrom house import _core",
        "a/__init__.py": "",
        "a/first.py": "from house.b import second",
        "a/other.py": "",
        "b/__init__.py": "",
        "b/second.py": "import os",
    }
    for name, text in files.items():
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(text)

    def circles() -> tuple[list[str], list[str]]:
        graph = python_modules.imports(package)
        rooms = python_modules.folders(graph, "house")
        return python_modules.circle(graph), python_modules.circle(rooms)

    assert circles() == ([], [])
    (package / "b" / "second.py").write_text("def f():\n    from ..a.other import thing\n")
    assert circles()[0] == []
    assert set(circles()[1]) == {"house.a", "house.b"}
    (package / "b" / "second.py").write_text("if TYPE_CHECKING:\n    from house.a.first import A\n")
    assert set(circles()[0]) == {"house.a.first", "house.b.second"}


def test_no_import_is_hidden_in_a_string() -> None:
    """Where a module of the package is imported by its name as text, no graph shows it.

    The package itself imports some modules on first use, by the name that was asked for.
    """
    hidden = re.compile(r"""(?:import_module|__import__)\(\s*f?["'][^"')]*impasto""")
    named = re.compile(r"""^\s*\w+\s*=\s*["']impasto\.[\w.]+["']""", re.MULTILINE)
    texts = {path: path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")}
    assert [path for path, text in texts.items() if hidden.search(text)] == []
    importing = {path for path, text in texts.items() if "import_module" in text}
    assert [path for path in importing if named.search(texts[path])] == []


def test_colour_science_has_one_door() -> None:
    """It warns of every optional package that is absent; the door is quiet."""
    direct = re.compile(r"^\s*(import colour\b|from colour\b)", re.MULTILINE)
    found = [p for p in PACKAGE.rglob("*.py") if direct.search(p.read_text(encoding="utf-8"))]
    assert found == []


def test_files_stay_readable() -> None:
    long = {
        path.relative_to(ROOT).as_posix(): lines
        for path in tracked()
        if path.suffix in {".py", ".rs", ".pyi"}
        and (lines := len(path.read_text(encoding="utf-8").splitlines())) > 600
    }
    assert long == {}, "above 600 lines something wants a room of its own"


def test_no_file_names_a_place_on_one_machine() -> None:
    place = re.compile(r"(?<![\w./:])/(?:root|work|tmp|mnt|opt)/\w")
    found = {}
    for path in tracked():
        if path.suffix in {".png", ".jpg", ".npz", ".exr"} or path == Path(__file__).resolve():
            continue
        if hit := place.search(path.read_text(encoding="utf-8")):
            found[path.relative_to(ROOT).as_posix()] = hit.group()
    assert found == {}


def test_importing_impasto_loads_numpy_and_nothing_else() -> None:
    heavy = ["colour", "cv2", "OpenEXR", "tifffile", "rich", "cyclopts", "scipy", "zarr"]
    heavy += ["matplotlib", "xarray", "dask", "distributed"]
    script = f"import sys, impasto; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"
