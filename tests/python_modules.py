"""What the modules of a Python package import from each other, read from their source."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

Graph = dict[str, set[str]]


def modules(package: Path) -> dict[str, Path]:
    """Dotted names and files; a folder goes by its own name."""
    found = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package.parent).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(package: Path) -> Graph:
    """For each module the modules that it imports, anywhere in its file.

    Imports in functions and for type checkers count, too. A name that a folder exports counts as
    the folder; an extension module, which has no source here, does not count.
    """
    files = modules(package)
    graph: Graph = {}
    for module, path in files.items():
        named = _named(path, module)
        graph[module] = {found for name in named if (found := _known(name, files))} - {module}
    return graph


def folders(graph: Graph, package: str) -> Graph:
    """The same between the folders of a package; files beside them do not count."""
    rooms = {name for name in graph if any(other.startswith(f"{name}.") for other in graph)}
    rooms.discard(package)

    def room(module: str) -> str | None:
        own = ".".join(module.split(".")[:2])
        return own if own in rooms else None

    found: Graph = {name: set() for name in rooms if name.count(".") == 1}
    for module, needed in graph.items():
        here = room(module)
        for other in needed:
            there = room(other)
            if here and there and here != there:
                found[here].add(there)
    return found


def circle(graph: Graph) -> list[str]:
    """One circle of imports, or nothing."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def _named(path: Path, module: str) -> Iterator[str]:
    """Dotted names that a file imports."""
    folder = module if path.name == "__init__.py" else module.rpartition(".")[0]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = folder.split(".")[: len(folder.split(".")) + 1 - node.level]
            source = ".".join([*above, node.module or ""]) if node.level else node.module or ""
            yield from (f"{source.rstrip('.')}.{alias.name}" for alias in node.names)


def _known(name: str, files: dict[str, Path]) -> str | None:
    """The module that a dotted name belongs to: itself, or the one that defines it."""
    if name in files:
        return name
    source = name.rpartition(".")[0]
    # `from package import _core`: an extension module, no part of the package's own file.
    return source if source in files and not name.endswith("._core") else None
