"""The pages' links lead somewhere, and each decision is in the list of decisions."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [
    *sorted((ROOT / "docs").rglob("*.md")),
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
]
LINK = re.compile(r"(?<!\!)\[[^\]]*\]\(([^)\s]+)\)|!\[[^\]]*\]\(([^)\s]+)\)")
CODE = re.compile(r"^```.*?^```|^    .*?$|`[^`\n]*`", re.MULTILINE | re.DOTALL)
NAMED = re.compile(r"docs/decisions/(\w+\.md)")


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub makes them."""
    found = set()
    for line in re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S).splitlines():
        if line.startswith("#"):
            title = re.sub(r"[^\w\- ]", "", line.lstrip("#").strip().lower())
            found.add(title.replace(" ", "-"))
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_each_link_leads_somewhere(page: Path) -> None:
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S)
    broken = []
    for link in (a or b for a, b in LINK.findall(text)):
        if re.match(r"\w+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = page if not path else (page.parent / path).resolve()
        if not target.exists() or (
            anchor and target.suffix == ".md" and anchor not in anchors(target)
        ):
            broken.append(link)
    assert broken == []


def test_each_decision_is_listed() -> None:
    folder = ROOT / "docs/decisions"
    listed = set(re.findall(r"\]\((\w+\.md)\)", (folder / "README.md").read_text()))
    assert listed == {file.name for file in folder.glob("*.md")} - {"README.md"}


def test_the_decisions_that_code_names_are_there() -> None:
    named = set()
    for package in ("semmap", "navgrid", "planner", "schema", "native", "migrations"):
        for file in (ROOT / package).rglob("*.*"):
            if file.suffix in (".py", ".sql", ".cpp", ".hpp"):
                named |= set(NAMED.findall(file.read_text(encoding="utf-8")))
    assert len(named) >= 12
    assert {name for name in named if not (ROOT / "docs/decisions" / name).exists()} == set()


def test_the_reference_is_made_from_the_docstrings() -> None:
    made = runpy.run_path(str(ROOT / "scripts/reference"))["page"]()
    assert made == (ROOT / "docs/reference.md").read_text(), "run scripts/reference"


def test_each_page_is_in_the_contents() -> None:
    contents = (ROOT / "mkdocs.yml").read_text()
    listed = set(re.findall(r": ([\w/]+\.md)$", contents, re.MULTILINE))
    pages = {str(file.relative_to(ROOT / "docs")) for file in (ROOT / "docs").glob("*.md")}
    assert listed == pages | {"decisions/README.md"}
    linked = set(re.findall(r"\]\(([\w/]+\.md)\)", (ROOT / "docs/index.md").read_text()))
    assert linked | {"index.md"} == listed
