"""Every Python block of README and documentation runs; the pages are complete."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from pathlib import Path
from types import ModuleType

import pytest
from sybil import Sybil
from sybil.parsers.markdown import PythonCodeBlockParser

import impasto

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
MARKDOWN = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
PAGES = [
    page
    for page in MARKDOWN
    # tests/test_rehearsal.py runs the tutorials, on the sessions that it rehearses, and
    # tests/test_how_to.py the recipes, on files of the kinds that they name.
    if "```python" in page.read_text(encoding="utf-8")
    and not page.stem.startswith(("tutorial-", "how-to"))
]
REFERENCE = "\n".join(page.read_text(encoding="utf-8") for page in sorted(DOCS.glob("api*.md")))
MODULES = re.findall(r"automodule:: ([\w.]+)", REFERENCE)


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `make demo` leaves behind, on a small painting."""
    from impasto.cli import main

    folder = tmp_path_factory.mktemp("pages")
    assert main(["demo", "--out", str(folder / "demo"), "--size", "96", "--quiet"]) == 0
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_examples_of_a_page_run(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    after_demo = "demo/" in page.read_text(encoding="utf-8")
    monkeypatch.chdir(request.getfixturevalue("demo") if after_demo else tmp_path)
    document = Sybil(parsers=[PythonCodeBlockParser()]).parse(page)
    for example in document.examples():
        example.evaluate()


@pytest.mark.parametrize("page", MARKDOWN, ids=lambda page: page.stem)
def test_what_a_page_shows_or_links_is_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    named = re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r"\{figure\} (\S+)", text)
    files = {name.split("#")[0] for name in named if "://" not in name} - {""}
    assert [name for name in sorted(files) if not (page.parent / name).is_file()] == []


def test_the_table_of_faults_names_tests_that_there_are() -> None:
    """Every class of faults has a row, and every test that a row names is a function."""
    text = (DOCS / "faults.md").read_text(encoding="utf-8")
    rows = [int(number) for number in re.findall(r"^\| (\d+) \|", text, re.MULTILINE)]
    assert rows == list(range(1, 23))
    named = set(re.findall(r"`(test_\w+\.py)::(test_\w+)`", text))
    assert len(named) > 30
    there = {
        (file, node.name)
        for file in {file for file, _ in named}
        for node in ast.parse((ROOT / "tests" / file).read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef)
    }
    assert sorted(named - there) == []
    scripts = set(re.findall(r"`(?:python tests/)?([a-z_]+\.py)\b", text))
    assert [name for name in sorted(scripts) if not (ROOT / "tests" / name).is_file()] == []


def test_pictures_are_small() -> None:
    pictures = [p for p in DOCS.rglob("_static/*") if p.suffix in {".jpg", ".png"}]
    assert [p.name for p in pictures if p.stat().st_size > 300_000] == []


def test_every_public_name_is_on_the_api_page() -> None:
    listed = set(re.findall(r"auto(?:class|function):: (\w+)", REFERENCE))
    for name in MODULES:  # Sphinx lists what a module exports
        listed |= {name.removeprefix("impasto."), *vars(importlib.import_module(name))}
    assert sorted(set(impasto.__all__) - listed) == []


@pytest.mark.parametrize(
    "module", [impasto, *map(importlib.import_module, MODULES)], ids=lambda m: m.__name__
)
def test_sections_of_docstrings_are_numpy_s(module: ModuleType) -> None:
    """``Returns`` names a type, then indents; prose there becomes a bullet for each line."""
    names = getattr(module, "__all__", [n for n in vars(module) if not n.startswith("_")])
    odd = []
    for name in names:
        thing = getattr(module, name)
        inner = vars(thing).values() if inspect.isclass(thing) else ()
        for each in (thing, *inner):
            doc = inspect.getdoc(each) if callable(each) else None
            for body in re.findall(r"^(?:Returns|Yields)\n-+\n((?:.+\n?)+)", doc or "", re.M):
                first, *rest = body.splitlines()
                if " " in first.strip(" :") or not rest or not rest[0].startswith("    "):
                    odd.append(f"{name}: {first}")
    assert odd == []


def test_every_hard_case_that_the_code_names_is_listed() -> None:
    page = (ROOT / "docs" / "numerics.md").read_text(encoding="utf-8")
    listed = {int(number) for number in re.findall(r"^\| (\d+) \|", page, re.MULTILINE)}
    assert listed == set(range(1, 33))
    for path in sorted((ROOT / "crates").rglob("*.rs")):
        text = re.sub(r"\s*\n\s*//[/!]? ?", " ", path.read_text(encoding="utf-8"))
        for words in re.findall(r"hard cases? ((?:\d+(?:, | and )?)+)", text):
            named = {int(number) for number in re.findall(r"\d+", words)}
            assert named <= listed, f"{path.name}: {words}"


def test_the_hard_cases_name_their_tests() -> None:
    """The table's last column is what the names of the tests say, no more and no less."""
    page = (ROOT / "docs" / "numerics.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \|.*\| ([^|]*) \|$", page, re.MULTILINE)
    listed = {int(number): set(re.findall(r"`([^`]+)`", files)) for number, files in rows}
    core = ROOT / "crates" / "impasto"
    tests = [(ROOT / "tests", path) for path in (ROOT / "tests").glob("test_*.py")]
    tests += [(core, path) for path in core.rglob("*.rs")]
    found: dict[int, set[str]] = {number: set() for number in listed}
    for folder, path in tests:
        names = re.findall(r"(?:def|fn) \w*cases?_((?:\d+_(?:and_)?)+)", path.read_text("utf-8"))
        for number in re.findall(r"\d+", " ".join(names)):
            found.setdefault(int(number), set()).add(path.relative_to(folder).as_posix())
    assert listed == found


def test_every_hard_case_has_a_test_of_its_name() -> None:
    page = (ROOT / "docs" / "numerics.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \| ([^|]*) \|", page, re.MULTILINE)
    names = [f"case_{number}_{re.sub(r'[^a-z0-9]+', '_', name.lower())}" for number, name in rows]
    assert len(names) == 32
    paths = [*(ROOT / "tests").glob("test_*.py"), *(ROOT / "crates" / "impasto").rglob("*.rs")]
    texts = [path.read_text(encoding="utf-8") for path in paths]
    found = set(re.findall(r"(?:def|fn) (?:hard_|test_)?(case_\d+_\w+)\(", "\n".join(texts)))
    assert [name for name in names if name not in found] == []


def test_completion_lists_what_the_pages_use() -> None:
    """``impasto.<Tab>``, whatever else has been imported."""
    blocks = [
        block
        for page in MARKDOWN
        for block in re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    ]
    named = re.compile(r"(?<![\w.])impasto\.([a-zA-Z]\w*)")
    used = {name for block in blocks for name in named.findall(block)}
    listed = set(dir(impasto))
    assert {"fit_sbrdf", "simulate", "io"} <= used
    assert used - listed == set()
    public = {name for name in listed if not name.startswith("_")}
    assert all(getattr(impasto, name) is not None for name in public)
    with pytest.raises(AttributeError) as raised:
        _ = impasto.fit_brdf  # type: ignore[attr-defined]
    assert raised.value.name == "fit_brdf"  # with it, Python suggests the nearest name
