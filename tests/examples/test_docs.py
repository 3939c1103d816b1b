"""The pages' links lead somewhere, and each decision is in the list of decisions."""

from __future__ import annotations

import inspect
import re
import runpy
from collections.abc import Mapping
from functools import cached_property
from importlib import import_module
from pathlib import Path

import pytest

import navgrid
import planner
import semmap
from semmap.api.entity_collection import EntityCollection
from semmap.api.map_events import MapSubscription
from semmap.api.map_results import MapPlan, MapRoute, ObjectSearch
from semmap.api.spatial_fields import SpaceAnswer, SpatialFields
from semmap.belief.believed_places import BelievedPlaces
from semmap.draw.picture import Picture
from semmap.export.features import LAYERS as EXPORTED
from semmap.export.formats import FORMATS
from semmap.fields.sources.source import KEYS, installed_sources
from semmap.ingest.annotation.annotation import KINDS
from semmap.ingest.annotation.draft_world import USED_PROPERTIES
from semmap.ingest.annotation.feature_file import GEOREFERENCE
from semmap.ingest.annotation.feature_values import LAYERS
from semmap.ingest.importer import KNOWN
from semmap.ingest.sdf.resources import FUEL_VARIABLES, PATH_VARIABLES
from semmap.knowledge.answer import Answer
from semmap.manipulation.found_actions import FoundActions
from semmap.query.map_check.rules import Finding
from semmap.query.sql_statement import SqlRows

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


CLASSES = [
    *(getattr(semmap, name) for name in ("Database", "Door", "EntityVersion", "Map", "MapEntity")),
    *(semmap.MapEvent, semmap.Pose, navgrid.CostSource, navgrid.Costmap, navgrid.Grid),
    *(navgrid.StoreyGrid, planner.Action, planner.RobotClass, planner.RouteStep, planner.Topology),
    *(Answer, BelievedPlaces, EntityCollection, Finding, FoundActions, MapPlan, MapRoute),
    *(MapSubscription, ObjectSearch, Picture, SpaceAnswer, SpatialFields, SqlRows),
]
"""What a script meets; the page finds its classes by annotations."""


def members_on_the_page(cls: type) -> str:
    """The table or list of a class."""
    page = (ROOT / "docs/reference.md").read_text()
    (section,) = re.findall(rf"^###? Class {cls.__name__}\n(.*?)(?=^#|\Z)", page, re.M | re.S)
    return str(section)


@pytest.mark.parametrize("cls", CLASSES, ids=lambda each: each.__name__)
def test_the_reference_has_each_member(cls: type) -> None:
    section, missing = members_on_the_page(cls), []
    stated = {name for each in cls.__mro__ for name in vars(each).get("__annotations__", {})}
    known = {*vars(cls)} if cls is semmap.Door else {*dir(cls), *stated}
    for name in known - {*dir(tuple), *dir(Mapping)}:
        if name.startswith("_"):
            continue
        found = inspect.getattr_static(cls, name, None)
        called = inspect.isfunction(found) or isinstance(found, classmethod | staticmethod)
        if not re.search(rf"`{name}{'[(]' if called else '[:`]'}", section):
            missing.append(name)
    assert missing == []


def test_no_two_headings_of_the_reference_have_one_anchor() -> None:
    page = re.sub(r"^```.*?^```", "", (ROOT / "docs/reference.md").read_text(), flags=re.M | re.S)
    headings = re.findall(r"^#+ .*", page, re.M)
    assert len(headings) == len(anchors(ROOT / "docs/reference.md")) > 200


def test_the_reference_writes_a_property_without_parentheses() -> None:
    page = (ROOT / "docs/reference.md").read_text()
    for cls in (semmap.Database, semmap.Map, semmap.MapEntity, semmap.Door):
        for name in dir(cls):
            found = inspect.getattr_static(cls, name)
            if isinstance(found, property | cached_property) and not name.startswith("_"):
                assert f"\n{cls.__name__}.{name}(" not in page


def test_the_reference_says_what_a_script_starts_with() -> None:
    page = (ROOT / "docs/reference.md").read_text()
    assert "semmap.connect(url" in page
    assert "- `id: int | None`" in members_on_the_page(semmap.MapEvent)
    assert "`id: int`" in members_on_the_page(semmap.MapEntity)
    assert "- `for ... in entity_collection`" in members_on_the_page(EntityCollection)
    assert {"tutorial.md", "api.md"} <= {a for a, _ in LINK.findall(page)}


def test_the_page_of_fields_says_which_source_takes_which_percept() -> None:
    page = (ROOT / "docs/fields.md").read_text()
    (table,) = re.findall(r"^\| percept \| sources that take it.*?\n\n", page, re.M | re.S)
    rows = [line.split("|")[2:4] for line in table.splitlines()[2:] if line]
    written = {name: keys for names, keys in rows for name in re.findall(r"`(\w+)`", names)}
    assert written.keys() == installed_sources().keys()
    for name, home in installed_sources().items():
        module, _, cls = home.partition(":")
        taken = getattr(import_module(module), cls).takes
        keys = re.findall(r"\w+", KEYS[taken])
        assert all(f"`{key}`" in written[name] for key in keys if key not in ("and", "zones"))


def test_the_pages_of_import_and_export_have_each_ending_key_and_layer() -> None:
    into, out = ((ROOT / "docs" / name).read_text() for name in ("import.md", "export.md"))
    places = (*PATH_VARIABLES, *FUEL_VARIABLES)
    words = {*KNOWN, *LAYERS, *KINDS, *GEOREFERENCE, *places, "--model-path", "--scale"}
    assert [word for word in sorted(words) if f"`{word}" not in into] == []
    keys = set().union(*USED_PROPERTIES.values())
    assert [key for key in sorted(keys) if f"`{key}`" not in into + out] == []
    assert [each for each in (*FORMATS, *EXPORTED) if f"`{each}`" not in out] == []


def test_the_readme_names_the_formats_that_are_read() -> None:
    rows = (ROOT / "docs" / "import.md").read_text().split("| format |")[1].split("\n\n")[0]
    readme = (ROOT / "README.md").read_text()
    words = "SDF RMF IFC IMDF IndoorGML OpenStreetMap GeoJSON GeoPackage USD MJCF URDF"
    for word in words.split():
        assert word in readme
        assert word.lower() in rows.lower().replace("gpkg", "geopackage")


def test_each_page_is_in_the_contents() -> None:
    contents = (ROOT / "mkdocs.yml").read_text()
    listed = set(re.findall(r": ([\w/]+\.md)$", contents, re.MULTILINE))
    pages = {str(file.relative_to(ROOT / "docs")) for file in (ROOT / "docs").glob("*.md")}
    assert listed == pages | {"decisions/README.md"}
    linked = set(re.findall(r"\]\(([\w/]+\.md)\)", (ROOT / "docs/index.md").read_text()))
    assert linked | {"index.md"} == listed
