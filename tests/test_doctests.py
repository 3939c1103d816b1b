"""The examples in docstrings run and print what they show."""

import doctest
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("semmap", "navgrid", "planner")
NEED_A_DATABASE = {"semmap", "semmap.api.database", "semmap.database.engine"}


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


MODULES = sorted(
    module_name(path)
    for package in PACKAGES
    for path in (ROOT / package).rglob("*.py")
    if ">>> " in path.read_text()
)


def run_examples(name: str) -> doctest.TestResults:
    return doctest.testmod(importlib.import_module(name))


def test_examples_are_found() -> None:
    assert len(MODULES) > 40
    assert set(MODULES) > NEED_A_DATABASE


@pytest.mark.parametrize("name", [name for name in MODULES if name not in NEED_A_DATABASE])
def test_examples_without_a_database(name: str) -> None:
    assert run_examples(name).failed == 0


@pytest.mark.parametrize("name", sorted(NEED_A_DATABASE))
def test_examples_with_a_database(
    name: str, database: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SEMMAP_DB", database)
    found = run_examples(name)
    assert found.attempted > 0
    assert found.failed == 0
