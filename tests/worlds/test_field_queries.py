"""The papers' queries in the small house: a camera, two people, a mug on a table."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from datetime import timedelta

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from sqlalchemy import Engine

from semmap.cli.demo.fields import PAPERS_QUERY, arrange_scene, perceived_maps
from semmap.fields.maps.map_buffer import MapBuffer
from semmap.fields.queries import QueryError, SelectResult, StoreResult, query
from semmap.fields.queries.catalogue import FieldCatalogue
from semmap.fields.regions.region_map import NamedRegionMap, RegionMap
from semmap.fields.regions.shaped_region import Cylinder, SurfaceRegion
from semmap.fields.sources import Segmentation
from semmap.fields.sources.synthetic_scene import SyntheticScene, VisibleObject
from semmap.fields.store.names import read_map_vocabulary, read_names
from semmap.fields.store.reader import read_visible_objects
from semmap.geometry.mesh import Mesh
from semmap.geometry.surfaces import support_surfaces
from semmap.geometry.tin import to_mesh
from semmap.language.names import NameIndex
from tests.seen import seen_by

SIZE = 0.02


@dataclass(frozen=True, eq=False)
class HouseScene:
    synthetic: SyntheticScene
    maps: MapBuffer
    names: NameIndex
    catalogue: FieldCatalogue
    seen: Segmentation
    table: VisibleObject
    mug: VisibleObject


@pytest.fixture(scope="module")
def scene(bare_house: Engine) -> HouseScene:
    """The maps of sources in the house, from a place where the mug is visible."""
    with bare_house.connect() as connection:
        names, objects = read_names(seen_by(connection)), read_visible_objects(seen_by(connection))
    table, top = table_of(objects)
    cup = trimesh.creation.cylinder(radius=0.04, height=0.1, sections=24)
    cup.apply_translation((*top[:2], top[2] + 0.05))
    mug = VisibleObject("mug1", "mug", np.asarray(cup.triangles, np.float64))
    names = replace(names, entities={**names.entities, "mug1": "mug"})
    found = arrange_scene([*objects, mug], names, [])
    assert found is not None
    synthetic, target, eye = found
    assert target is mug, "mugs are the preferred type"
    maps = perceived_maps(synthetic, eye, mug, [], SIZE)
    regions = RegionMap(SIZE)
    regions.insert("mug1", Cylinder((*top[:2], top[2] + 0.05), 0.04, 0.1))
    mesh: Mesh = to_mesh(table.triangles)
    regions.insert(table.name, SurfaceRegion(mesh.vertices, mesh.faces))
    catalogue = FieldCatalogue(
        read_map_vocabulary(), maps, names, occupancy=NamedRegionMap(regions), voxel_size=SIZE
    )
    seen = synthetic.image(eye, mug.triangles.reshape(-1, 3).mean(axis=0))
    return HouseScene(synthetic, maps, names, catalogue, seen, table, mug)


def table_of(objects: list[VisibleObject]) -> tuple[VisibleObject, NDArray[np.float64]]:
    """The table with the largest top between 0.4 and 1.1 m, and the middle of that."""
    best = None
    for each in objects:
        if "table" not in each.type:
            continue
        for surface in support_surfaces(to_mesh(each.triangles)):
            if 0.4 < surface.height < 1.1 and (best is None or surface.area > best[2].area):
                best = (each, surface.outline.representative_point(), surface)
    assert best is not None
    return best[0], np.array([best[1].x, best[1].y, best[2].height])


def seen_voxels(scene: HouseScene) -> dict[tuple[int, ...], Counter[str]]:
    """Count for each voxel the labels of its pixels, pixel by pixel."""
    seen = scene.seen
    depth, labels = np.asarray(seen.depth, float), np.asarray(seen.labels)
    fx, fy, cx, cy = np.asarray(seen.intrinsics, float)
    rows, columns = np.nonzero((labels > 0) & np.isfinite(depth) & (depth <= 10))
    d = depth[rows, columns]
    points = np.column_stack([(columns - cx) / fx * d, (rows - cy) / fy * d, d])
    pose = np.asarray(seen.pose, float)
    voxels = np.floor((points @ pose[:3, :3].T + pose[:3, 3]) / SIZE).astype(int)
    votes: dict[tuple[int, ...], Counter[str]] = {}
    for voxel, label in zip(voxels.tolist(), labels[rows, columns].tolist(), strict=True):
        if seen.names[label] != "person":
            votes.setdefault(tuple(voxel), Counter())[seen.names[label]] += 1
    return votes


def looked_at(scene: HouseScene, name: str, voxels: NDArray[np.int_]) -> NDArray[np.bool_]:
    """Return which centres of voxels are in the field of view of a person."""
    pose = np.asarray(scene.synthetic.gazes().poses[name], float)
    off = (voxels + 0.5) * SIZE - pose[:3, 3]
    along = off @ pose[:3, 2]
    angle = np.arccos(np.clip(along / np.linalg.norm(off, axis=1), -1, 1))
    inside: NDArray[np.bool_] = (angle <= 0.25) & (along <= 3.0)
    return inside


def as_set(voxels: NDArray[np.int_]) -> set[tuple[int, ...]]:
    return {tuple(v) for v in voxels.tolist()}


def test_the_query_of_figure_5_right(scene: HouseScene) -> None:
    """The query of Figure 5, right: visible voxels of the mug in the field of view."""
    answer = query(scene.catalogue, PAPERS_QUERY.format(type="mug"))
    assert isinstance(answer, StoreResult)
    votes = seen_voxels(scene)
    most = {v for v, count in votes.items() if 2 * count["mug"] > count.total()}
    some = {v for v, count in votes.items() if count["mug"]}
    cells = np.array(sorted(some))
    inside = as_set(cells[looked_at(scene, "human1", cells)])
    got = as_set(answer.voxels)
    assert len(got) > 20
    assert most & inside <= got <= inside
    assert answer.property.name == "containsObject"
    # human2 looks away.
    nothing = query(scene.catalogue, PAPERS_QUERY.format(type="mug").replace("human1", "human2"))
    assert isinstance(nothing, StoreResult)
    assert len(nothing.voxels) == 0


def test_the_query_of_figure_5_left(scene: HouseScene) -> None:
    """Figure 5, left."""
    answer = query(
        scene.catalogue,
        "PREFIX : <http://kb.openrobots.org/>\n"
        "SELECT ?voxels WHERE { ?voxels :containsObject ?object } STORE :containsObject",
    )
    assert isinstance(answer, StoreResult)
    assert as_set(answer.voxels) == set(seen_voxels(scene))


def test_a_property_of_another_namespace_is_named(scene: HouseScene) -> None:
    with pytest.raises(QueryError, match="did you mean <urn:semmap:ontology#inRoom>"):
        query(scene.catalogue, "PREFIX : <http://kb.openrobots.org/> ASK { ?x :inRoom ?y }")


def test_objects_in_a_field_of_view(scene: HouseScene) -> None:
    """'What objects are currently in the field of view of this human?' (paper 2, section IV)."""
    answer = query(
        scene.catalogue,
        "PREFIX : <http://kb.openrobots.org/>\n"
        "SELECT DISTINCT ?object WHERE { ?v :inFieldOfView :human1 . ?v :containsObject ?object }",
    )
    assert isinstance(answer, SelectResult)
    votes = seen_voxels(scene)
    voxels = np.array(list(votes))
    inside = [tuple(v) for v in voxels[looked_at(scene, "human1", voxels)].tolist()]
    sure = {votes[v].most_common(1)[0][0] for v in inside if len(votes[v]) == 1}
    got = {object_ for (object_,) in answer}
    assert "mug" in got
    assert sure <= got <= {name for v in inside for name in votes[v]}


def test_things_above_others(scene: HouseScene) -> None:
    """'What are all the objects on top of the table' by the voxels that entities have."""
    answer = query(
        scene.catalogue,
        "PREFIX : <urn:semmap:ontology#>\n"
        "SELECT DISTINCT ?thing WHERE {"
        f" ?a :occupiedBy :{scene.table.name} . ?b :occupiedBy ?thing . ?thing a :Drinkware ."
        " FILTER(:z(?b) > :z(?a) && :distance(?a, ?b) < 0.1) }",
    )
    assert isinstance(answer, SelectResult)
    assert list(answer) == [("mug1",)]


def test_free_of_people(scene: HouseScene) -> None:
    """Voxels of the mug's surroundings further than 1.2 m from everybody that was seen."""
    answer = query(
        scene.catalogue,
        "PREFIX : <urn:semmap:ontology#>\n"
        "SELECT ?v WHERE { ?v :inFieldOfView :human1 ."
        " FILTER NOT EXISTS { ?v :distanceToPerson ?d FILTER(?d <= 1.2) } }",
    )
    assert isinstance(answer, SelectResult)
    people = next(m for m in scene.maps.now() if m.property.name == "containsPerson")
    gaze = next(m for m in scene.maps.now() if m.about == "human1")
    centres, bodies = gaze.points(), people.points()
    if len(bodies) == 0:
        far = np.ones(len(centres), np.bool_)
    else:
        from scipy.spatial import cKDTree

        far = cKDTree(bodies).query(centres)[0] > 1.2 + 1e-9
    assert as_set(answer.voxels("v")) == as_set(gaze.voxels()[far])


def test_moments(scene: HouseScene) -> None:
    """What is taken out is still known of the past."""
    now = scene.synthetic.time
    then = MapBuffer(timedelta(minutes=1))
    then.put("all", scene.maps.now(), now)
    then.withdraw("all", now + timedelta(seconds=5))
    catalogue = FieldCatalogue(read_map_vocabulary(), then, scene.names, voxel_size=SIZE)
    text = PAPERS_QUERY.format(type="mug")
    later = now + timedelta(seconds=8)
    full = query(scene.catalogue, text)
    for clause, there in (('DURING "PT10S"', True), ('DURING "PT2S"', False)):
        given = text.replace(
            "STORE", f"{clause}^^<http://www.w3.org/2001/XMLSchema#duration>\nSTORE"
        )
        if not there:
            with pytest.raises(QueryError, match="no source provides"):
                query(catalogue, given, later)
            continue
        answer = query(catalogue, given, later)
        assert isinstance(answer, StoreResult)
        assert isinstance(full, StoreResult)
        assert as_set(answer.voxels) == as_set(full.voxels)
