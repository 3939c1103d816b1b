"""The service on the small house with a folder of images, and with a package nobody here knows."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from scipy.spatial import cKDTree
from sqlalchemy import Engine

from semmap.fields.sources.percepts import Segmentation
from semmap.fields.sources.synthetic_scene import ScenePerson, SyntheticScene
from semmap.fields.store.reader import read_visible_objects
from tests.seen import seen_by
from tests.worlds.field_server import Server, eventually, fields

PREFIX = "PREFIX : <urn:semmap:ontology#> "
TIME = datetime(2026, 1, 1, 12, tzinfo=UTC)
CUP = (7.153, 0.983, 0.85)
ANNA = ScenePerson("anna", 6.5, -1.0, 0.0, CUP)
HALF = 0.025 + 1e-3
"""Half a voxel, metres, and what rounding may add."""
CAMERA = ((6.0, -2.5, 1.5), (7.0, 0.6, 0.9))


@pytest.fixture(scope="module")
def url(house: Engine) -> str:
    """The URL of a database that has the house and its rooms."""
    return house.url.set(drivername="postgresql").render_as_string(hide_password=False)


@pytest.fixture
def served() -> Iterator[Callable[..., Server]]:
    """Starts services, and stops them in the end."""
    running: list[Server] = []

    def serve(*words: str, **more: Any) -> Server:
        running.append(Server(*words, **more))
        return running[-1]

    yield serve
    for each in running:
        each.stop()


def rows(url: str, query: str) -> set[tuple[str, ...]]:
    return {tuple(row) for row in fields(url, "query", PREFIX + query)["rows"]}


def known(url: str, query: str) -> set[tuple[str, ...]] | None:
    """The rows of an answer; None while no source provides what the query names."""
    try:
        return rows(url, query)
    except ValueError as error:
        if "no source provides" not in str(error):
            raise
        return None


def points_of(image: Segmentation, name: str) -> NDArray[np.float64]:
    """The points of a label, (N, 3) in metres, by numpy alone."""
    (label,) = [number for number, each in image.names.items() if each == name]
    v, u = np.nonzero((image.labels == label) & (image.depth <= 10))
    depth = image.depth[v, u].astype(float)
    fx, fy, cx, cy = np.asarray(image.intrinsics, float)
    optical = np.stack([(u - cx) / fx * depth, (v - cy) / fy * depth, depth, np.ones_like(depth)])
    points: NDArray[np.float64] = (np.asarray(image.pose) @ optical)[:3].T
    return points


def distances(wanted: ArrayLike, among: ArrayLike) -> NDArray[np.float64]:
    """How far each point is from the nearest of others, along the axis on which that is most."""
    found: NDArray[np.float64] = cKDTree(np.asarray(among)).query(wanted, p=np.inf)[0]
    return found


def write_lines(folder: Path, name: str, percept: dict[str, Any]) -> None:
    """Write a percept that comes at the beginning and after a minute."""
    times = [(TIME + timedelta(minutes=minute)).isoformat() for minute in (0, 1)]
    lines = "".join(json.dumps({"time": time, **percept}) + "\n" for time in times)
    (folder / f"{name}.jsonl").write_text(lines)


def record(folder: Path, name: str, image: Segmentation, depth: str) -> None:
    """Write an image as a camera driver does: depth as numbers or 16 bit millimetres, labels."""
    if depth == "png":
        rounded = np.nan_to_num(1e3 * image.depth).round().astype(np.uint16)
        Image.fromarray(rounded).save(folder / f"{name}.png")
    else:
        np.save(folder / f"{name}.npy", image.depth)
    np.save(folder / f"{name}_labels.npy", image.labels)
    percept = {
        "depth": f"{name}.{depth}",
        "labels": f"{name}_labels.npy",
        "names": {str(number): each for number, each in image.names.items()},
        "intrinsics": np.asarray(image.intrinsics).tolist(),
        "pose": np.asarray(image.pose).tolist(),
    }
    write_lines(folder, name, percept)


def test_a_folder_of_images_gaze_and_poses(
    house: Engine, url: str, served: Callable[..., Server], tmp_path: Path
) -> None:
    """A camera sees Anna at the kitchen's table, and what she looks at."""
    with house.connect() as connection:
        objects = read_visible_objects(seen_by(connection))
    scene = SyntheticScene(objects, [ANNA], TIME)
    things = scene.image(*CAMERA)
    people = scene.image_of_people(scene.image(*CAMERA, label=lambda each: each.name))
    record(tmp_path, "objects", things, "npy")
    record(tmp_path, "people", people, "png")
    write_lines(tmp_path, "gaze", {"poses": {"anna": {"from": ANNA.eyes, "to": CUP}}})
    names = ("objects", "people", "gaze")
    served(url, *(w for n in names for w in ("--source", f"{n}=recording:{tmp_path}")))

    where = "SELECT DISTINCT ?room { ?v :containsPerson :anna . ?v :inRoom ?room }"
    eventually(lambda: known(url, where), {("kitchen",)})
    found = fields(url, "query", PREFIX + "SELECT ?v ?o { ?v :containsObject ?o }")["rows"]
    seen_points = np.concatenate([points_of(things, each) for each in {o for _, o in found}])
    assert distances(seen_points, [v for v, _ in found]).max() < HALF
    for kind in ("kitchen_table", "chair", "wall"):
        assert distances([v for v, o in found if o == kind], points_of(things, kind)).max() < HALF
    sees = "SELECT ?x { :anna :sees ?x }"
    eventually(lambda: ("Tableware_01_001",) in (known(url, sees) or ()), True)


STRANGER = '''
"""A laser that counts legs, and a stove whose heat is a property of its own."""
from datetime import datetime, timezone

import numpy as np

from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.sources.percepts import People, PersonMotion
from semmap_vdb import Int32Grid


class Legs:
    def __init__(self, name, x, y):
        self.people = {name: PersonMotion(x, y, 0.0)}

    def __call__(self):
        return People(self.people, datetime.now(timezone.utc))


class Column:
    provides = ("containsPerson",)

    def __init__(self, vocabulary, *, voxels=10):
        self.property, self.voxels = vocabulary["containsPerson"], voxels

    def __call__(self, percept):
        grid, legend = Int32Grid(0.05, 0), {}
        for number, (name, at) in enumerate(percept.people.items(), 1):
            low = np.floor(np.array([at.x, at.y, 1.0]) / 0.05 + 0.5).astype(np.int32)
            column = low + np.arange(self.voxels)[:, None] * np.array([0, 0, 1], np.int32)
            grid.set(column.astype(np.int32), np.full(self.voxels, number, np.int32))
            legend[number] = name
        return [RepresentationMap(self.property, grid, legend=legend, time=percept.time)]
'''


def test_a_package_brings_a_source_and_its_percepts(
    url: str, served: Callable[..., Server], tmp_path: Path
) -> None:
    """Both are found by their entry points; nothing of semmap names them."""
    package = tmp_path / "site"
    about = package / "stranger-1.0.dist-info"
    about.mkdir(parents=True)
    (package / "stranger.py").write_text(STRANGER)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(
        "[semmap.percepts]\nlegs = stranger:Legs\n[semmap.sources]\ncolumn = stranger:Column\n"
    )
    percepts = {"plugin": "legs", "name": "bo", "x": 7.0, "y": -3.0}
    source = {"source": "column", "percepts": percepts, "rate": 10, "options": {"voxels": 12}}
    config = tmp_path / "service.yaml"
    config.write_text(yaml.safe_dump({"sources": {"laser": source}}))
    served(url, "--config", str(config), env={"PYTHONPATH": str(package)})
    count = "SELECT ?who (COUNT(*) AS ?n) { ?v :containsPerson ?who } GROUP BY ?who"
    eventually(lambda: {(w, int(n)) for w, n in known(url, count) or ()}, {("bo", 12)})
    assert rows(url, "SELECT DISTINCT ?r { ?v :containsPerson :bo ; :inRoom ?r }") == {("kitchen",)}
    listed = {row["name"]: row for row in fields(url, "source", "ls")}
    assert listed["laser"]["provides"] == ["containsPerson"]
    assert listed["laser"]["error"] is None
