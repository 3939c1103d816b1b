"""A can on the kitchen table of the small house: a camera's cloud becomes an observation."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import Engine

import semmap
from semmap.belief.reader import read_occluders
from semmap.belief.views import camera_at
from semmap.database import open_engine
from semmap.database.maps import see_map
from semmap.geometry.pose import Pose
from semmap.ingest.meshes.mesh_file import read_mesh
from semmap.perception.models import depth_points
from tests.command_line import semmap as semmap_command
from tests.seen import seen_by
from tests.stored import stored

TABLE = "KitchenTable_01_001"
VIEW = (5.5, 1.1, 1.45, 0.0, 0.75)


@pytest.fixture(scope="module")
def url(house: Engine, worlds: Path) -> str:
    """A database that has the small house, with a can and a sugar box."""
    text = house.url.render_as_string(hide_password=False)
    with semmap.connect(text) as database:
        home = database.map("house")
        _, _, top = home.spot(home[TABLE], "on")
        for name, kind, file, y in (
            ("can", "can", "005_tomato_soup_can", 1.1),
            ("sugar", "box", "004_sugar_box", 0.9),
        ):
            mesh = read_mesh(worlds / "ycb" / "meshes" / f"{file}_textured.gltf", center=True)
            low = mesh.bounds[0, 2]
            home.add_object(
                name, type=kind, on=TABLE, mesh=mesh, pose=(6.2, y, float(top - low), 0.4)
            )
    return text


def photographed(url: str, without: list[str]) -> np.ndarray:
    """The cloud of the view, in the optical frame, with noise."""
    engine = open_engine(url)
    with engine.connect() as connection:
        see_map(connection, "house")
        triangles = read_occluders(seen_by(connection), without)
    engine.dispose()
    camera = camera_at(VIEW[:3], *VIEW[3:], size=(640, 480))
    depths, _ = camera.image(triangles)
    return depth_points(camera, depths + np.random.default_rng(2).normal(0, 0.001, depths.shape))


def test_a_cloud_says_what_is_on_the_table_and_what_is_not(url: str, tmp_path: Path) -> None:
    cloud = tmp_path / "view.npy"
    np.save(cloud, photographed(url, ["sugar"]))  # someone took the sugar

    def belief(name: str) -> dict[str, float]:
        (found,) = json.loads(semmap_command(url, "where", name, "--map", "house", "--json").stdout)
        return {row["place"]: row["probability"] for row in found["belief"]}

    before = {name: belief(name) for name in ("can", "sugar")}
    words = ("--cloud", cloud, "--looked-for", "can", "--looked-for", "sugar", "--map", "house")
    view = ",".join(map(str, VIEW))
    done = semmap_command(url, "observe", "--view", view, *words, "--json")
    assert done.exit_code == 0
    rows = json.loads(done.stdout)
    seen = [row for row in rows if row["seen"]]
    assert [(row["object"], row["place"]) for row in seen] == [("can", TABLE)]
    assert belief("can")[TABLE] > max(0.9, before["can"][TABLE])
    assert belief("sugar")[TABLE] < before["sugar"][TABLE]
    with semmap.connect(url) as database:
        house = database.map("house")
        ((at, place),) = house.execute(
            "SELECT o.position, w.pose FROM observation o JOIN world w ON w.entity_id = o.place_id "
            "WHERE o.seen ORDER BY o.id DESC LIMIT 1"
        )
    assert Pose(*place).apply([at])[0][:2] == pytest.approx((6.2, 1.1), abs=0.01)


def test_the_table_of_the_map_can_be_removed_from_the_cloud(url: str, tmp_path: Path) -> None:
    cloud = tmp_path / "view.npy"
    np.save(cloud, photographed(url, [])[::2, ::2])
    words = ("--cloud", cloud, "--without", TABLE, "--looked-for", "can", "--looked-for", "sugar")
    view = ",".join(map(str, VIEW))
    done = semmap_command(url, "observe", "--view", view, *words, "--map", "house", "--json")
    seen = {row["object"]: row["place"] for row in json.loads(done.stdout) if row["seen"]}
    assert seen == {"can": TABLE, "sugar": TABLE}


def test_a_cloud_of_nothing_changes_nothing(url: str, tmp_path: Path) -> None:
    cloud = tmp_path / "empty.npy"
    np.save(cloud, np.full((480, 640, 3), np.nan))
    view = ",".join(map(str, VIEW))
    before = stored(url)
    with pytest.raises(ValueError, match="0 finite points of 307200"):
        semmap_command(
            url,
            "observe",
            "--view",
            view,
            "--cloud",
            cloud,
            "--looked-for",
            "can",
            "--map",
            "house",
        )
    assert stored(url) == before
