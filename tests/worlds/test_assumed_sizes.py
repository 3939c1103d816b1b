"""Furniture without geometry, counted in the building's file and looked for in its grids."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import shapely
import yaml
from rdflib import OWL, RDF, RDFS, Graph, URIRef
from rdflib.term import Node
from sqlalchemy import Engine, text

import semmap
from navgrid.map_file import read_map
from tests.command_line import semmap as command

ONTOLOGY = Path(__file__).parents[2] / "schema" / "ontology"
SIZE = URIRef("urn:semmap:ontology#typicalSize")
WITHOUT_SIZE = {
    "hotel": Counter(escalator_start=1),
    "clinic": Counter(cgm_vanguard=35, scrubs=12, op_scrubs=2, playground=1),
}


@pytest.fixture(params=["hotel", "clinic"])
def building(request: pytest.FixtureRequest) -> tuple[str, Engine]:
    return request.param, request.getfixturevalue(request.param)


def stated_sizes() -> dict[str, list[float]]:
    """The size of each class by its IRI, its own or that of a nearest superclass."""
    graph = Graph()
    for file in ONTOLOGY.glob("*.ttl"):
        graph.parse(file)
    found: dict[str, list[float]] = {}
    for iri in graph.subjects(RDF.type, OWL.Class):
        level: list[Node] = [iri]
        size = None
        while level and size is None:
            size = next((str(v) for c in level for v in graph.objects(c, SIZE)), None)
            level = sorted({a for c in level for a in graph.objects(c, RDFS.subClassOf)}, key=str)
        if size is not None:
            found[str(iri)] = [float(v) for v in size.split()]
    return found


def test_each_model_of_the_file_is_assumed_or_listed(
    building: tuple[str, Engine], worlds: Path, tmp_path: Path
) -> None:
    name, engine = building
    file = yaml.safe_load((worlds / "rmf" / name / f"{name}.building.yaml").read_text())
    counts = {level: len(about.get("models") or ()) for level, about in file["levels"].items()}
    chairs = sum(
        "chair" in model["name"].lower()
        for about in file["levels"].values()
        for model in about.get("models") or ()
    )
    url = engine.url.render_as_string(hide_password=False)
    words = ("-o", tmp_path, "--map", name, "--assume-sizes", "--no-picture", "--json")
    done = command(url, "grid", *words)
    assert done.exit_code == 0, done.output
    grids = {made["storey"]: made for made in json.loads(done.stdout)}
    listed = {s: len(g["assumed_sizes"]) + len(g["no_geometry"]) for s, g in grids.items()}
    assert listed == counts
    with engine.connect() as connection:
        rows = connection.execute(
            text(
                "SELECT e.name, e.type, t.iri, w.pose, h.name AS storey FROM entity e "
                "JOIN semantic_type t ON t.name = e.type JOIN world w ON w.entity_id = e.id "
                "JOIN entity h ON h.id = w.storey_id "
                "WHERE e.kind = 'object' AND e.type <> 'wall'"
            )
        ).all()
    sizes = stated_sizes()
    assumed = {n for g in grids.values() for n in g["assumed_sizes"]}
    assert {row.name for row in rows if row.iri in sizes} == assumed
    assert Counter(row.type for row in rows if row.iri not in sizes) == WITHOUT_SIZE[name]
    occupied: dict[str, Any] = {s: read_map(g["map"]) for s, g in grids.items()}
    seen = Counter[str]()
    for row in rows:
        x, y, z, *_ = row.pose
        elevation = grids[row.storey]["elevation"]
        if row.iri in sizes and z - elevation < 1 and z - elevation + sizes[row.iri][2] > 0.1:
            grid, cells = occupied[row.storey]
            assert cells[grid.cell(x, y)] == 100, row.name
            seen["chair" in row.name.lower()] += 1
    assert seen[True] == chairs > 0


def test_an_import_names_what_has_no_shape_and_the_way_out(database: str, worlds: Path) -> None:
    with semmap.connect(database) as db:
        summary = db.import_file(worlds / "rmf" / "hotel" / "hotel.building.yaml", map="hotel")
    said = " ".join(summary.notes)
    assert "175 objects with no geometry: treated as free floor" in said
    assert "--model-path" in said
    assert "--assume-sizes" in said


def test_pictures_mark_what_is_assumed(hotel: Engine) -> None:
    with semmap.connect(hotel.url.render_as_string(hide_password=False)) as db:
        house = db.map("hotel")
        (bare,), (view,) = house.views("L2"), house.views("L2", assume_sizes=True)
    marked = {o.name: o for o in view.objects if o.assumed}
    assert len(marked) == 59
    assert not any(o.assumed for o in bare.objects)
    for thing in marked.values():
        assert thing.footprint is not None
        assert thing.mesh is not None
        below = shapely.MultiPoint(thing.mesh.vertices[:, :2]).convex_hull
        assert thing.footprint.symmetric_difference(below).area < 1e-9
