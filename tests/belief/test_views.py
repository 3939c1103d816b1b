"""What a camera sees of places, against rays; and the place of a point."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
import trimesh

from semmap.belief.error import BeliefError
from semmap.belief.places import (
    BeliefPlace,
    Surface,
    place_around,
    place_at,
    sample_points,
    surface_below,
)
from semmap.belief.views import camera_at, visible_points, visible_shares


def box_place(name: str, x: float, y: float, top: float, size: float = 1.0) -> BeliefPlace:
    outline = shapely.box(x - size / 2, y - size / 2, x + size / 2, y + size / 2)
    low = np.array([x - size / 2, y - size / 2, 0])
    return BeliefPlace(
        name, "object", (Surface(outline, top),), low, low + np.array([size, size, top]), outline
    )


def box(low: tuple[float, ...], high: tuple[float, ...]) -> np.ndarray:
    mesh = trimesh.creation.box(bounds=[low, high])
    return np.asarray(mesh.triangles)


@pytest.mark.parametrize("seed", range(4))
def test_visible_points_are_those_that_rays_reach(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene: Any = trimesh.util.concatenate(
        [
            trimesh.creation.box(bounds=[c - s, c + s])
            for c, s in zip(
                rng.uniform((-2, -2, 0), (2, 2, 1.5), (12, 3)),
                rng.uniform(0.05, 0.4, (12, 3)),
                strict=True,
            )
        ]
    )
    points = rng.uniform((-2, -2, 0), (2, 2, 1.5), (300, 3))
    eye = np.array([-3.5, rng.uniform(-1, 1), 1.2])
    camera = camera_at(eye, 0.1, 0.15, size=(640, 480), field_of_view=1.2)
    seen = visible_points(camera, points, camera.image(np.asarray(scene.triangles))[0], 4.5)

    offset = points - eye
    right, down, ahead = camera.pose[:3, :3].T @ offset.T
    tangent = math.tan(0.6)
    inside = (np.abs(right) < tangent * ahead) & (np.abs(down) < tangent * 0.75 * ahead)
    inside &= np.linalg.norm(offset, axis=1) <= 4.5
    hits, rays, _ = scene.ray.intersects_location(
        np.tile(eye, (300, 1)), offset / np.linalg.norm(offset, axis=1)[:, None]
    )
    nearest = np.full(300, np.inf)
    np.minimum.at(nearest, rays, np.linalg.norm(hits - eye, axis=1))
    reached = inside & (nearest > np.linalg.norm(offset, axis=1))
    assert 20 < reached.sum() < 280
    assert (seen != reached).mean() < 0.03  # at the edges of boxes, a pixel shows one side


def test_shares_of_a_table_behind_a_box() -> None:
    near, far = box_place("near", 1.5, 0, 0.7), box_place("far", 4, 0, 0.7)
    table = np.concatenate(
        [box((1, -0.5, 0.65), (2, 0.5, 0.7)), box((3.5, -0.5, 0.65), (4.5, 0.5, 0.7))]
    )
    camera = camera_at((0, 0, 1.4), 0, 0.25)

    def shares(*more: np.ndarray, furthest: float = 9) -> dict[str, float]:
        depths, _ = camera.image(np.concatenate([table, *more]))
        return visible_shares([near, far], camera, depths, furthest=furthest)

    free = shares()
    assert free["far"] == 1
    assert free["near"] > 0.6  # its near edge is below the picture
    assert shares(furthest=2.5) == {"near": free["near"]}
    half = shares(box((3, -1, 0), (3.05, 0, 3)))  # a wall before one half
    assert half["far"] == pytest.approx(0.5, abs=0.03)
    assert set(shares(box((2.5, -3, 0), (2.6, 3, 3)))) == {"near"}


def test_points_are_spread_over_the_surfaces_of_a_place() -> None:
    points = sample_points(box_place("table", 1, 2, 0.7), 0.1, 0.05)
    assert len(points.at) == 100
    assert points.at.mean(axis=0) == pytest.approx([1, 2, 0.75])
    assert points.weight == pytest.approx(np.full(100, 0.01))
    assert not points.within.any()
    assert len(sample_points(box_place("pin", 1, 2, 0.7, 0.01), 0.1, 0.0).at) == 1


def test_points_of_a_cabinet_are_at_several_heights_in_it_as_likely_as_the_map_says() -> None:
    cabinet = replace(box_place("cabinet", 1, 2, 0.7), stores=True, inside=3.0)
    points = sample_points(cabinet, 0.1, 0.05)
    heights = points.at[:, 2].round(9)
    assert sorted(set(heights)) == [0.175, 0.525, 0.75]  # twice in it, and on it
    assert (points.within == (heights < 0.7)).all()
    assert points.weight[points.within].sum() == pytest.approx(0.75)
    assert points.weight.sum() == pytest.approx(1)
    nowhere = sample_points(replace(cabinet, surfaces=(), inside=0.0), 0.1, 0.05)
    assert nowhere.weight.sum() == pytest.approx(1)


def test_a_worktop_is_not_within_its_cabinet_though_a_tap_is_above_it() -> None:
    sink = replace(box_place("sink", 0, 0, 0.9), stores=True)
    tap = replace(sink, high=np.array([0.5, 0.5, 1.2]))
    board = replace(tap, surfaces=(*tap.surfaces, Surface(shapely.box(-0.5, -0.5, 0.5, 0.5), 0.4)))
    for place in (sink, tap, board):
        points = sample_points(place, 0.1, 0.05)
        heights = points.at[:, 2].round(9)
        assert not points.within[heights == 0.95].any()
        assert points.within[heights == 0.45].all()


def test_what_is_within_a_place_is_seen_when_it_is_open() -> None:
    """Without a mesh, a camera sees into it unless it is shut; with one, only if it is open."""
    cabinet = replace(box_place("cabinet", 1.5, 0, 0.7), stores=True)
    camera = camera_at((0, 0, 1.6), 0, 0.6)
    closed = box((1, -0.5, 0), (2, 0.5, 0.7))

    def share(mesh: np.ndarray, **options: Any) -> float:
        depths, _ = camera.image(mesh)
        return visible_shares([cabinet], camera, depths, **options)["cabinet"]

    nothing = np.empty((0, 3, 3))
    assert share(nothing) == pytest.approx(1, abs=0.15)
    for mesh, options in ((nothing, {"shut": {"cabinet"}}), (closed, {})):
        assert share(mesh, **options) == pytest.approx(0.5, abs=0.05)
        assert share(mesh, **options, opened={"cabinet"}) == pytest.approx(1, abs=0.05)


def test_a_point_is_at_the_surface_below_it_else_in_the_room() -> None:
    shelf = box_place("shelf", 1, 1, 0.4)
    board = Surface(shapely.box(0.5, 0.5, 1.5, 1.5), 0.9)
    shelf = BeliefPlace(
        "shelf", "object", (*shelf.surfaces, board), shelf.low, shelf.high, shelf.footprint
    )
    table = box_place("table", 3, 1, 0.75)
    floor = shapely.box(0, 0, 5, 5)
    room = BeliefPlace(
        "room", "room", (Surface(floor, 0.0),), np.zeros(3), np.array([5.0, 5, 2.5]), floor
    )
    bin_ = replace(box_place("bin", 4, 4, 0.6, 0.4), surfaces=(), stores=True)
    places = [room, shelf, table, bin_]
    names = {
        (1, 1, 0.5): "shelf",
        (1, 1, 0.95): "shelf",
        (3, 1, 0.8): "table",
        (3.51, 1, 0.8): "table",
        (4, 4, 0.3): "bin",
        (3, 1, 0.05): "room",
        (4.5, 4.5, 0.1): "room",
        (4.5, 4.5, 9): None,
        (4.5, 4.5, 0.45): "room",
        (4.5, 4.5, 1.0): None,
        (3, 1, 1.2): "table",
        (3, 1, 1.4): None,
        (-1, 0, 0.1): None,
    }
    for point, name in names.items():
        found = place_at(places, point)
        assert (found.name if found else None) == name, point
    assert place_at(places, (4.5, 4.5, 1.0), height=1.1) is room
    assert place_at(places, (3, 1, 1.4), height=1.4) is table
    assert place_around(places, (4.5, 4.5, 1.0)) is room
    assert surface_below(places, (3, 1, 1.4)) == (table, pytest.approx(0.65))
    assert surface_below(places, (9, 9, 1.4)) is None


@pytest.mark.parametrize(
    ("eye", "angle", "opening"), [((0, 0, math.nan), 0, 1), ((0, 0, 1), 2, 1), ((0, 0, 1), 0, 4)]
)
def test_impossible_views_are_refused(eye: tuple[float, ...], angle: float, opening: float) -> None:
    with pytest.raises(BeliefError, match="give"):
        camera_at(eye, 0.0, angle, field_of_view=opening)
