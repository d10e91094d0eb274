"""The README keeps its word: links lead somewhere, commands exist, Python runs."""

from __future__ import annotations

import ast
import functools
import re
import runpy
import shlex
from pathlib import Path

import pytest
import tyro

import coin3d
from coin3d.cli import TUTORIAL, VERBS

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def commands(text: str) -> list[str]:
    lines = re.findall(r"^\s*(coin3d [a-z].*)$", text, flags=re.MULTILINE)
    return [re.split(r"\s{3,}|\s#", line)[0] for line in lines]


HELP = [command for verb in VERBS.values() for command in commands(verb.__doc__ or "")]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_lead_to_files(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_paths_that_are_named_exist() -> None:
    for path in re.findall(r"`((?:src|tests|docs|benchmarks)/[\w./-]+)`", README):
        assert (ROOT / path).exists(), path


@pytest.mark.parametrize("command", sorted({*commands(README), *commands(TUTORIAL), *HELP}))
def test_commands_can_be_parsed(command: str) -> None:
    words = shlex.split(command)[1:]
    if words[0] == "VERB":
        return
    verb = " ".join(words[:2]) if " ".join(words[:2]) in VERBS else words[0]
    words = words[len(verb.split()) :]
    function, seen = VERBS[verb], []

    @functools.wraps(function)
    def parsed(**arguments: object) -> None:
        seen.append(arguments)

    tyro.cli(parsed, args=words)
    assert seen and "out" in seen[0]


def test_python_in_the_readme_uses_names_that_exist() -> None:
    blocks = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    assert blocks
    for block in blocks:
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "coin3d":
                assert hasattr(coin3d, node.attr)


def test_the_first_lines_say_what_matters() -> None:
    top = README[:2500]
    for words in ("independent implementation", "CoIn3D: Revisiting Configuration-Invariant Multi-Camera 3D Object Detection"):
        assert words in " ".join(top.split())
    assert "know only the town" in " ".join(README.split())
    assert len(README.splitlines()) < 200


def test_tables_are_the_measured_ones() -> None:
    tables = runpy.run_path(str(ROOT / "benchmarks" / "tables.py"))
    for path in tables["DOCUMENTS"]:
        content = path.read_text(encoding="utf-8")
        assert "<!-- table " in content
        assert tables["filled"](content) == content, f"{path.name}: python benchmarks/tables.py brings it up to date"
