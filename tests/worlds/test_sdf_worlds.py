"""The small house, the bookstore and the YCB objects, as their parser gives them.

And files of the small house from which nothing can be taken.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from sqlalchemy import Engine, text

import semmap
from semmap.ingest.sdf.world_file import read_sdf
from semmap.ingest.world import World, WorldError
from tests.command_line import semmap as semmap_command


@pytest.fixture(scope="module")
def small_house(worlds: Path) -> World:
    return read_sdf(worlds / "small_house" / "worlds" / "small_house.world")


@pytest.fixture(scope="module")
def bookstore(worlds: Path) -> World:
    return read_sdf(worlds / "bookstore" / "worlds" / "bookstore.world")


def triangles(world: World) -> int:
    """Over all instances."""
    return sum(len(s.mesh.faces) for e in world.entries for s in e.shapes if s.mesh is not None)


def bounds(world: World) -> NDArray[np.float64]:
    boxes = [
        s.mesh.moved(e.pose).bounds
        for e in world.entries
        for s in e.shapes
        if s.mesh is not None and e.pose is not None
    ]
    return np.array([np.min(boxes, axis=(0, 1)), np.max(boxes, axis=(0, 1))])


def models(world: World) -> Counter[object]:
    return Counter(e.properties["model"] for e in world.entries)


def test_small_house_is_whole(small_house: World) -> None:
    assert len(small_house.entries) == 87
    assert len(models(small_house)) == 63
    assert small_house.skipped == []
    assert all(e.kind == "object" and len(e.shapes) == 1 for e in small_house.entries)
    assert small_house.name == "small_house"


def test_small_house_has_its_triangles_and_size(small_house: World, worlds: Path) -> None:
    assert triangles(small_house) == 146_484
    np.testing.assert_allclose(np.ptp(bounds(small_house), axis=0), (19.0, 11.4, 3.0), atol=0.01)
    collision = read_sdf(small_house.source, geometry="collision")
    assert triangles(collision) == 4_771
    assert all(s.role == "collision" for e in collision.entries for s in e.shapes)


def test_small_house_furniture_is_of_the_size_of_furniture(small_house: World) -> None:
    """Units: in centimetres read as metres a chair would be 100 m tall, in millimetres 1 mm."""
    sizes = {
        e.name: np.ptp(s.mesh.bounds, axis=0)
        for e in small_house.entries
        for s in e.shapes
        if s.mesh is not None
    }
    heights = {name: size[2] for name, size in sizes.items()}
    assert 0.7 < heights["KitchenTable_01_001"] < 1.1
    assert all(0.6 < heights[n] < 1.3 for n in heights if n.startswith("Chair"))
    assert 1.5 < heights["Refrigerator_01_001"] < 2.2
    assert max(sizes["Bed_01_001"]) < 2.6


def test_small_house_instances_share_their_meshes(small_house: World) -> None:
    meshes = {id(s.mesh) for e in small_house.entries for s in e.shapes}
    assert len(meshes) == 63


def test_small_house_as_other_tools_write_it(small_house: World, tmp_path: Path) -> None:
    """Poses in the includes, which nests all models, and XML that only Gazebo reads."""
    text = small_house.source.read_text()
    nested, count = re.subn(
        r"</include>\s*<pose[^>]*>([^<]*)</pose>", r"<pose>\1</pose></include>", text
    )
    assert count == 88  # one is in a comment
    lax = nested.replace("<world", "<!-- a -- b --><gz:made_by/><world", 1)
    path = tmp_path / "house.world"
    path.write_text(f"<!-- nested -->\n{lax}")
    models = small_house.source.parents[1] / "models"
    house = read_sdf(path, model_path=[models])
    assert house.skipped == []
    for entry, other in zip(small_house.entries, house.entries, strict=True):
        assert (other.name, other.type) == (entry.name, entry.type)
        assert other.pose is not None
        assert entry.pose is not None
        np.testing.assert_allclose(other.pose, entry.pose, atol=1e-9)
    assert len({id(s.mesh) for e in house.entries for s in e.shapes}) == 63


@pytest.mark.parametrize(
    ("removed", "options", "problem"),
    [
        ("<model name=.*</model>", (), "has nothing that a map can hold"),
        ("(?<=model://)aws_", ("--strict",), "robomaker_.* is not found"),
    ],
    ids=["models", "files"],
)
def test_an_import_that_brings_nothing_of_the_small_house_leaves_no_map(
    removed: str,
    options: tuple[str, ...],
    problem: str,
    bare_house: Engine,
    small_house: World,
    tmp_path: Path,
) -> None:
    """Neither a new map, nor a change of the one that has the whole house."""
    url = bare_house.url.render_as_string(hide_password=False)
    path = tmp_path / "small_house.world"
    whole = small_house.source.read_text()
    path.write_text(re.sub(removed, "", whole, flags=re.DOTALL))
    before = everything(bare_house)
    assert len(before) == 87
    for name in ("empty", "house"):
        with pytest.raises(WorldError, match=problem):
            semmap_command(url, "import", path, "--map", name, *options)
        with semmap.connect(url) as database:
            assert database.maps == ["house"]
        assert everything(bare_house) == before


def everything(engine: Engine) -> list[object]:
    """The rows of all objects of all maps, with their places."""
    with engine.connect() as connection:
        return [
            *connection.execute(
                text(
                    "SELECT m.name, e.*, p.*, w.* FROM entity e JOIN map m ON m.id = e.map_id "
                    "JOIN placement p ON p.entity_id = e.id JOIN world w ON w.entity_id = e.id "
                    "ORDER BY e.id"
                )
            ).all()
        ]


def test_small_house_types(small_house: World) -> None:
    types = Counter(e.type for e in small_house.entries)
    assert types[None] == 0
    assert types["chair"] == 8
    assert types["window"] == 9
    assert types["bed"] == types["refrigerator"] == types["kitchen_table"] == 1
    assert types["sofa"] == types["floor"] == 1
    assert types["wall"] == types["trash_can"] == types["carpet"] == types["ball"] == 2
    assert types["nightstand"] == 2


def test_bookstore_is_whole_but_for_the_runaway_and_the_missing(bookstore: World) -> None:
    assert len(bookstore.entries) == 139 - 1
    assert len(models(bookstore)) == 26
    said = {s.element.rpartition("model ")[2].split(":")[0]: s for s in bookstore.skipped}
    assert said.keys() == {
        "BookE_01_009",
        "aws_robomaker_retail_BookshelfA_01",
        "aws_robomaker_retail_Spotlight_01",
    }
    assert "343,583" in said["BookE_01_009"].problem
    missing = said["aws_robomaker_retail_BookshelfA_01"]
    assert "aws_BookshelfA_01_visual.DAE is not found" in missing.problem
    assert "upper and lower case" in said["aws_robomaker_retail_Spotlight_01"].fix


def test_bookstore_has_its_size(bookstore: World) -> None:
    np.testing.assert_allclose(np.ptp(bounds(bookstore), axis=0), (15.7, 14.6, 3.7), atol=0.05)


def test_bookstore_shapes(bookstore: World) -> None:
    """Bookshelf A keeps its collision geometry; of bookshelf B a comment hides no visual."""
    roles = {e.properties["model"]: [s.role for s in e.shapes] for e in bookstore.entries}
    prefix = "aws_robomaker_retail_"
    assert roles.pop(f"{prefix}BookshelfA_01") == ["collision"]
    assert roles.pop(f"{prefix}Spotlight_01") == []
    assert set(map(tuple, roles.values())) == {("visual",)}


@pytest.mark.parametrize(
    ("name", "spout"),
    [
        ("003_cracker_box", 0.0),
        ("004_sugar_box", 0.0),
        ("005_tomato_soup_can", 0.0),
        ("006_mustard_bottle", 0.031),
        ("009_gelatin_box", 0.0),
        ("010_potted_meat_can", 0.0),
    ],
)
def test_ycb_visuals_lie_where_their_collision_solids_lie(
    worlds: Path, name: str, spout: float
) -> None:
    """glTF is y up: turned any other way, sides of 21, 16 and 7 cm would not fall on each other."""
    path = worlds / "ycb" / f"{name}.sdf"
    visual, collision = (bounds(read_sdf(path, geometry=g)) for g in ("visual", "collision"))
    np.testing.assert_allclose(visual, collision, atol=0.005 + spout)
