"""The limits as data: their variables, their texts, and the table that the documentation has."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path

import pytest
import yaml

from navgrid.grid import Grid
from semmap import limits
from semmap.ingest.annotation.feature_file import read_features
from semmap.ingest.importer import read_world
from semmap.ingest.ontology.tbox import read_tbox
from semmap.ingest.world import WorldError
from semmap.limits import LIMITS, NAME_CHARACTERS, TRIANGLES

DOCS = Path(__file__).parents[1] / "docs"


def test_the_documentation_has_the_table() -> None:
    text = (DOCS / "limits.md").read_text("utf-8")
    written = text.split("<!-- limits -->\n")[1].split("<!-- end -->")[0]
    rows = [f"| {each.text(each.default)} | {each.covers} | `{each.variable}` |" for each in LIMITS]
    assert written.splitlines() == ["| at most | in | raised by |", "|---|---|---|", *rows]


def test_each_limit_has_a_variable_of_its_own() -> None:
    assert len({limit.variable for limit in LIMITS}) == len(LIMITS)


@pytest.mark.parametrize("text", ["many", "0", "-1", "nan", "inf", "1e400"])
def test_a_variable_that_is_no_limit(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SEMMAP_MAX_TRIANGLES", text)
    with pytest.raises(ValueError, match=rf"SEMMAP_MAX_TRIANGLES is '{text}': give a number"):
        _ = TRIANGLES.value


def test_texts() -> None:
    assert [limits.MESH_BYTES.text(n) for n in (7, 2**20, 2**32 + 1)] == [
        "7 bytes",
        "1 MiB",
        "4,294,967,297 bytes",
    ]
    assert [TRIANGLES.text(n) for n in (3, 0.5, 12_345_678, 1e308)] == [
        "3 triangles",
        "0.5 triangles",
        "12,345,678 triangles",
        "1e+308 triangles",
    ]
    with pytest.raises(KeyError, match="has nan triangles, the limit is 20,000,000 triangles"):
        TRIANGLES.check(float("nan"), lambda problem, fix: KeyError(f"{problem}. {fix}"), "Do.")


def feature(**changes: object) -> dict[str, object]:
    ring = [[0, 0], [3, 0], [3, 3], [0, 0]]
    return {
        "type": "Feature",
        "geometry": {"type": "Polygon", "coordinates": [ring]},
        "properties": {"kind": "room", "name": "r"},
    } | changes


def geojson(path: Path, *features: object) -> Path:
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def test_names(tmp_path: Path) -> None:
    for key in ("name", "label", "type"):
        properties = {"kind": "room", "name": "r", key: "x" * 501}
        path = geojson(tmp_path / "a.geojson", feature(properties=properties))
        with pytest.raises(WorldError, match=rf"its {key} has 501 characters, the limit is 500"):
            read_world(path)
        properties[key] = "x" * 500
        assert read_world(geojson(path, feature(properties=properties))).entries


def test_outlines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = geojson(tmp_path / "a.geojson", feature(), feature())
    monkeypatch.setenv("SEMMAP_MAX_VERTICES", "3")
    skipped = read_features(path).skipped
    assert [each.problem for each in skipped] == ["has 4 vertices, the limit is 3 vertices"] * 2
    assert "SEMMAP_MAX_VERTICES raises the limit" in skipped[0].fix


def test_entries_of_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = geojson(tmp_path / "a.geojson", feature(), feature())
    monkeypatch.setenv("SEMMAP_MAX_ENTRIES", "1")
    with pytest.raises(WorldError, match=r"file: has 2 entries, .*SEMMAP_MAX_ENTRIES"):
        read_world(path)


@pytest.mark.parametrize("name", ["a.sdf", "a.geojson", "a.building.yaml", "a.ttl"])
def test_the_size_of_text(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / name
    path.write_text(" " * 2_000_000)
    monkeypatch.setenv("SEMMAP_MAX_TEXT_BYTES", "1.5e6")
    with pytest.raises(WorldError, match=r"file: has 2,000,000 bytes, .*SEMMAP_MAX_TEXT_BYTES"):
        _ = read_tbox([path]) if name.endswith("ttl") else read_world(path)


def test_nesting_of_models_and_properties(tmp_path: Path) -> None:
    path = tmp_path / "a.sdf"
    depth = 70
    path.write_text(
        "<sdf version='1.9'><world name='w'>"
        + "".join(f"<model name='m{i}'>" for i in range(depth))
        + "<link name='l'/>"
        + "</model>" * depth
        + "</world></sdf>"
    )
    with pytest.raises(WorldError, match=r"nests models: 65 levels, the limit is 64 levels"):
        read_world(path)
    deep: object = 1
    for _ in range(depth):
        deep = [deep]
    properties = {"kind": "room", "name": "r", "deep": deep}
    skipped = read_features(geojson(tmp_path / "a.geojson", feature(properties=properties))).skipped
    assert [each.problem for each in skipped] == ["'deep' is nested too deeply"]


def test_cells_of_a_grid(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SEMMAP_MAX_GRID_CELLS", "100")
    Grid((0, 0), 0.1, (10, 10))
    with pytest.raises(ValueError, match="SEMMAP_MAX_GRID_CELLS"):
        Grid((0, 0), 0.1, (10, 11))


def test_values_of_yaml(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SEMMAP_MAX_ELEMENTS", "100")
    path = tmp_path / "a.building.yaml"
    path.write_text(yaml.safe_dump({"levels": {"L1": {"vertices": [[0, i] for i in range(60)]}}}))
    with pytest.raises(WorldError, match=r"has 101 values, .*SEMMAP_MAX_ELEMENTS"):
        read_world(path)


def test_the_longest_name_fits_into_the_index() -> None:
    """PostgreSQL's B-tree takes rows of 2,704 bytes; a character has at most four."""
    assert 4 * NAME_CHARACTERS.default < 2704


SET = {"HOME", "LANG", "LC_ALL", "PGPASSWORD", "PXR_WORK_THREAD_LIMIT"}
"""Variables that the packages only set or keep from other programs."""

NOT_VARIABLES = {"MAP", "NN", "PG", "TYPE", "UTC"}


def test_the_documentation_has_each_environment_variable() -> None:
    read = set()
    for package in ("semmap", "navgrid", "planner"):
        for file in sorted((DOCS.parent / package).rglob("*.py")):
            text = file.read_text("utf-8")
            if "os.environ" in text or "getenv" in text or "envvar" in text:
                constants = (
                    n.value for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Constant)
                )
                read |= {c for c in constants if re.fullmatch(r"[A-Z][A-Z_]*[A-Z]", str(c))}
    page = (DOCS / "limits.md").read_text("utf-8").partition("## Environment variables")[2]
    rows = [line.split("|")[1] for line in page.splitlines() if line.startswith("| `")]
    assert read - SET - NOT_VARIABLES == {*re.findall(r"`(\w+)`", "".join(rows))}
    assert {"SEMMAP_DB", "SEMMAP_DATA", "SEMMAP_MAP", "SEMMAP_POSTGRESQL"} <= read
