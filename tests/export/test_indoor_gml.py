"""IndoorGML: its structure by the sequences of the schema, and files of other programs."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh
from lxml import etree

import semmap
from semmap.ingest.importer import read_world
from semmap.ingest.world import OUTSIDE, WorldError

FEATURE = "gml:metaDataProperty*, gml:description?, gml:name*, gml:boundedBy?"
LINK = "core:duality", "core:connects", "core:partialboundedBy"
STRUCTURE = f"""
<!ELEMENT core:IndoorFeatures ({FEATURE}, core:primalSpaceFeatures?, core:multiLayeredGraph?)>
<!ELEMENT core:primalSpaceFeatures (core:PrimalSpaceFeatures)>
<!ELEMENT core:PrimalSpaceFeatures ({FEATURE}, core:cellSpaceMember*,
  core:cellSpaceBoundaryMember*)>
<!ELEMENT core:cellSpaceMember (core:CellSpace)>
<!ELEMENT core:CellSpace ({FEATURE}, core:cellSpaceGeometry?, core:duality?,
  core:externalReference*, core:partialboundedBy*, core:level*)>
<!ELEMENT core:cellSpaceGeometry (core:Geometry2D | core:Geometry3D)>
<!ELEMENT core:Geometry3D (gml:Solid)>
<!ELEMENT core:Geometry2D (gml:Polygon | gml:CompositeSurface)>
<!ELEMENT core:cellSpaceBoundaryMember (core:CellSpaceBoundary)>
<!ELEMENT core:CellSpaceBoundary ({FEATURE}, core:duality?, core:cellSpaceBoundaryGeometry?,
  core:externalReference*)>
<!ELEMENT core:cellSpaceBoundaryGeometry (core:geometry2D | core:geometry3D)>
<!ELEMENT core:geometry2D (gml:LineString)>
<!ELEMENT core:geometry3D (gml:Polygon)>
<!ELEMENT core:multiLayeredGraph (core:MultiLayeredGraph)>
<!ELEMENT core:MultiLayeredGraph ({FEATURE}, core:spaceLayers+, core:interEdges*)>
<!ELEMENT core:spaceLayers ({FEATURE}, core:spaceLayerMember+)>
<!ELEMENT core:spaceLayerMember (core:SpaceLayer)>
<!ELEMENT core:SpaceLayer ({FEATURE}, core:nodes+, core:edges*)>
<!ELEMENT core:nodes ({FEATURE}, core:stateMember+)>
<!ELEMENT core:edges ({FEATURE}, core:transitionMember*)>
<!ELEMENT core:stateMember (core:State)>
<!ELEMENT core:State ({FEATURE}, core:duality?, core:connects*, core:geometry?)>
<!ELEMENT core:transitionMember (core:Transition)>
<!ELEMENT core:Transition ({FEATURE}, core:weight, core:connects, core:connects, core:duality?,
  core:geometry)>
<!ELEMENT core:geometry (gml:Point | gml:LineString)>
<!ELEMENT core:weight (#PCDATA)>
<!ELEMENT core:level (#PCDATA)>
{"".join(f"<!ELEMENT {link} EMPTY><!ATTLIST {link} xlink:href CDATA #REQUIRED>" for link in LINK)}
<!ELEMENT gml:metaDataProperty (gml:GenericMetaData)>
<!ELEMENT gml:Solid (gml:exterior)>
<!ELEMENT gml:Shell (gml:surfaceMember+)>
<!ELEMENT gml:CompositeSurface (gml:surfaceMember+)>
<!ELEMENT gml:surfaceMember (gml:Polygon)>
<!ELEMENT gml:Polygon (gml:exterior, gml:interior*)>
<!ELEMENT gml:exterior (gml:LinearRing | gml:Shell)>
<!ELEMENT gml:interior (gml:LinearRing)>
<!ELEMENT gml:LinearRing (gml:posList)>
<!ELEMENT gml:LineString (gml:posList)>
<!ELEMENT gml:Point (gml:pos)>
"""
"""The sequences of indoorgmlcore.xsd 1.1 and of what it takes of GML 3.2.1, as a DTD."""

TEXTS = ["description", "name", "pos", "posList", "GenericMetaData"]
WITH_ID = ["Solid", "CompositeSurface", "Polygon", "LineString", "Point"]
CORE_IDS = [
    "IndoorFeatures",
    "PrimalSpaceFeatures",
    "CellSpace",
    "CellSpaceBoundary",
    "MultiLayeredGraph",
    "spaceLayers",
    "SpaceLayer",
    "nodes",
    "edges",
    "State",
    "Transition",
]


def structure() -> etree.DTD:
    texts = "".join(f"<!ELEMENT gml:{each} (#PCDATA)>" for each in TEXTS)
    ids = "".join(
        f"<!ATTLIST {each} gml:id ID #REQUIRED srsDimension CDATA #IMPLIED srsName CDATA #IMPLIED>"
        for each in [*(f"gml:{w}" for w in WITH_ID), *(f"core:{w}" for w in CORE_IDS)]
    )
    names = "".join(
        f"<!ATTLIST core:IndoorFeatures xmlns:{p} CDATA #IMPLIED>" for p in ("core", "gml", "xlink")
    )
    return etree.DTD(io.StringIO(STRUCTURE + texts + ids + names))


def test_it_has_the_structure_of_the_schema(furnished: semmap.Map, tmp_path: Path) -> None:
    furnished.add_room("loft", shapely.box(0, 5, 6, 9) - shapely.box(2, 6, 3, 7), ceiling=2.5)
    root = etree.parse(str(furnished.export(tmp_path / "flat.gml"))).getroot()
    dtd = structure()
    assert dtd.validate(root), dtd.error_log.filter_from_errors()
    core, gml = root.nsmap["core"], root.nsmap["gml"]
    by_id = {e.get(f"{{{gml}}}id"): e for e in root.iter() if e.get(f"{{{gml}}}id")}
    for link in root.iter(*(f"{{{core}}}{each[5:]}" for each in LINK)):
        target = by_id[link.get("{http://www.w3.org/1999/xlink}href")[1:]]
        wanted = {
            "connects": {"State": "Transition", "Transition": "State"},
            "partialboundedBy": {"CellSpace": "CellSpaceBoundary"},
            "duality": dict(
                zip(
                    ("CellSpace", "State", "CellSpaceBoundary", "Transition"),
                    ("State", "CellSpace", "Transition", "CellSpaceBoundary"),
                    strict=True,
                )
            ),
        }[etree.QName(link).localname]
        assert etree.QName(target).localname == wanted[etree.QName(link.getparent()).localname]
    cells = {e.findtext(f"{{{gml}}}name"): e for e in root.iter(f"{{{core}}}CellSpace")}
    assert cells.keys() == {"kitchen", "hall", "loft", "outside"}
    for name in ("kitchen", "hall", "loft"):
        solid = solid_of(cells[name], gml)
        assert solid.is_watertight
        assert solid.volume == pytest.approx(
            furnished[name].geometry.area * (2.7 if name != "loft" else 2.5)
        )


def test_a_map_without_rooms_has_no_graph(db: semmap.Database, tmp_path: Path) -> None:
    empty = db.create_map("empty")
    empty.add_storey("ground")
    with pytest.raises(ValueError, match="IndoorGML consists of rooms, and the map has none"):
        empty.export(tmp_path / "empty.gml")
    with pytest.raises(ValueError, match="nothing in the map empty has a surface"):
        empty.export(tmp_path / "empty.glb")
    assert [*tmp_path.iterdir()] == []


def solid_of(cell: etree._Element, gml: str) -> trimesh.Trimesh:
    """The solid of a cell, its polygons cut by Shapely in the planes that they lie in."""
    corners = []
    for polygon in cell.iter(f"{{{gml}}}Polygon"):
        rings = [
            np.array(e.text.split(), float).reshape(-1, 3)
            for e in polygon.iter(f"{{{gml}}}posList")
        ]
        normal = np.sum(np.cross(rings[0][:-1] - rings[0][0], rings[0][1:] - rings[0][0]), axis=0)
        normal /= np.linalg.norm(normal)
        side = np.cross(normal, [1, 0, 0] if abs(normal[0]) < 0.9 else [0, 1, 0])
        axes = np.array(
            [side / np.linalg.norm(side), np.cross(normal, side / np.linalg.norm(side))]
        )
        flat = shapely.Polygon(rings[0] @ axes.T, [r @ axes.T for r in rings[1:]])
        cut = shapely.constrained_delaunay_triangles(flat)
        for triangle in cut.geoms:
            points = shapely.get_coordinates(shapely.geometry.polygon.orient(triangle))[:3]
            corners.append(points @ axes + normal * (rings[0][0] @ normal))
    points = np.concatenate(corners).round(9)
    return trimesh.Trimesh(points, np.arange(len(points)).reshape(-1, 3), process=True)


def cell(
    number: int, name: str, box: tuple[float, float, float, float], z: float, more: str = ""
) -> str:
    x0, y0, x1, y1 = box
    ring = " ".join(
        f"<gml:pos>{x} {y} {z}</gml:pos>"
        for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0))
    )
    return f"""<cellSpaceMember><CellSpace gml:id="C{number}"><gml:description>{more}
      </gml:description><gml:name>{name}</gml:name><cellSpaceGeometry><Geometry2D>
      <gml:Polygon gml:id="P{number}"><gml:exterior><gml:LinearRing>{ring}</gml:LinearRing>
      </gml:exterior></gml:Polygon></Geometry2D></cellSpaceGeometry>
      <duality xlink:href="#S{number}"/></CellSpace></cellSpaceMember>"""


def transition(number: int, a: int, b: int, more: str = "") -> str:
    return f"""<transitionMember><Transition gml:id="T{number}"><weight>1</weight>
      <connects xlink:href="#S{a}"/><connects xlink:href="#S{b}"/>{more}</Transition>
      </transitionMember>"""


def file_of(cells: list[str], transitions: list[str], boundaries: str = "") -> str:
    states = "".join(
        f'<stateMember><State gml:id="S{n}"><duality xlink:href="#C{n}"/></State></stateMember>'
        for n in range(1, len(cells) + 1)
    )
    return f"""<IndoorFeatures xmlns="http://www.opengis.net/indoorgml/1.0/core"
      xmlns:gml="http://www.opengis.net/gml/3.2" xmlns:xlink="http://www.w3.org/1999/xlink">
      <primalSpaceFeatures><PrimalSpaceFeatures gml:id="PS">{"".join(cells)}{boundaries}
      </PrimalSpaceFeatures></primalSpaceFeatures><multiLayeredGraph><MultiLayeredGraph gml:id="M">
      <spaceLayers gml:id="SLS"><spaceLayerMember><SpaceLayer gml:id="SL"><nodes gml:id="N">
      {states}</nodes><edges gml:id="E">{"".join(transitions)}</edges></SpaceLayer>
      </spaceLayerMember></spaceLayers></MultiLayeredGraph></multiLayeredGraph></IndoorFeatures>"""


THICK = [
    cell(1, "lab", (0, 0, 4, 3), 0, 'storey="F1":type="office"'),
    cell(2, "hall", (4.2, 0, 9, 3), 0, 'storey="F1":'),
    cell(3, "d", (4, 1, 4.2, 2), 0, 'storey="F1":type="door"'),
    cell(4, "upper", (0, 0, 9, 3), 3.2, 'storey="F2":'),
    cell(5, "gate", (9, 1, 9.2, 2), 0, 'storey="F1":usage="Door"'),
]
"""Two rooms with a door in the wall between them, one to the outside, and a room above."""


def test_doors_that_are_cells_join_their_neighbours(tmp_path: Path) -> None:
    path = tmp_path / "thick.gml"
    ways = [transition(1, 1, 3), transition(2, 3, 2), transition(3, 2, 4), transition(4, 5, 2)]
    path.write_text(file_of(THICK, [*ways, transition(5, 3, 1)]))
    world = read_world(path)
    assert world.skipped == []
    entries = {entry.name: entry for entry in world.entries}
    assert {e.name: e.detail.elevation for e in world.entries if e.kind == "storey"} == {
        "F1": 0,
        "F2": 3.2,
    }
    assert {e.name for e in world.entries if e.kind == "room"} == {"lab", "hall", "upper"}
    assert entries["lab"].type == "office"
    door = entries["d"]
    assert door.detail.places == ("lab", "hall")
    assert door.detail.width == pytest.approx(1)
    assert door.pose[:3] == pytest.approx((4.1, 1.5, 0))
    assert abs(door.pose.yaw) < 1e-9
    assert entries["gate"].detail.places == ("hall", OUTSIDE)
    (stairs,) = (e for e in world.entries if e.type == "stairs")
    assert stairs.detail.places == ("hall", "upper")
    assert stairs.detail.poses[1].z == pytest.approx(3.2)


def test_transitions_across_a_border_are_openings(tmp_path: Path) -> None:
    """Of cells that touch; with a boundary of its own a transition is a door there."""
    cells = [cell(n + 1, f"r{n}", (4 * n, 0, 4 * n + 4, 3), 0) for n in range(3)]
    border = """<cellSpaceBoundaryMember><CellSpaceBoundary gml:id="B1"><cellSpaceBoundaryGeometry>
      <geometry2D><gml:LineString gml:id="L1"><gml:pos>8 0.5 0</gml:pos><gml:pos>8 1.5 0</gml:pos>
      </gml:LineString></geometry2D></cellSpaceBoundaryGeometry></CellSpaceBoundary>
      </cellSpaceBoundaryMember>"""
    path = tmp_path / "thin.gml"
    ways = [transition(1, 1, 2), transition(2, 2, 3, '<duality xlink:href="#B1"/>')]
    path.write_text(file_of(cells, [*ways, transition(3, 2, 1)], border))
    world = read_world(path)
    first, second = (e for e in world.entries if e.kind == "connector")
    assert (first.type, first.detail.places, first.detail.width) == ("opening", ("r0", "r1"), 0.9)
    assert first.pose[:2] == pytest.approx((4, 1.5))
    assert (second.type, second.detail.places, second.detail.width) == ("door", ("r1", "r2"), 1.0)
    assert second.pose[:2] == pytest.approx((8, 1))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "not well-formed"),
        (file_of(THICK, [])[:700], "not well-formed"),
        ("<kml/>", "is not the expected root, <IndoorFeatures>, but <kml>"),
        (file_of([], []), "has no cell spaces"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><IndoorFeatures/>', "declares a document type"),
    ],
)
def test_bad_files_are_refused(text: str, problem: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.gml"
    path.write_text(text)
    with pytest.raises(WorldError, match=problem):
        read_world(path)


def test_bad_cells_are_left_out_and_named(tmp_path: Path) -> None:
    """In the wrong unit, with words for numbers, and a transition to nowhere."""
    cells = [
        THICK[0],
        cell(2, "huge", (0, 0, 4e6, 3e6), 0),
        THICK[2].replace("<gml:pos>4 1", "<gml:pos>four 1"),
    ]
    cells.append(cell(4, "tower", (0, 0, 4, 3), 65535))
    path = tmp_path / "bad.gml"
    path.write_text(file_of(cells, [transition(1, 1, 9)]))
    world = read_world(path)
    assert [e.name for e in world.entries if e.kind == "room"] == ["lab"]
    problems = {each.element: each.problem for each in world.skipped}
    assert "too large for a local frame" in problems["huge"]
    assert problems["CellSpace C4"] == "reaches a height of 65,535 m, the limit is 10,000 m"
    assert "four 1" in problems["CellSpace C3"]
    assert problems["Transition T1"] == "connects S9, which has no cell"
