"""Representation maps as layers: cells by brute force; laid on, moved and taken off again."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navgrid.costmap import Costmap, Inflation
from navgrid.field_layer import FieldVoxels
from navgrid.grid import Grid
from navgrid.voxel_cells import voxel_cells
from semmap.database.files import schema_folder
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import read_vocabulary
from semmap.fields.regions.shaped_region import Box, Sphere
from semmap.fields.sources import People, PersonalSpaceSource, PersonMotion
from tests.navgrid.scenes import ARM, BASE, room, scene, solid

VOCABULARY = read_vocabulary([schema_folder() / "ontology" / "fields.ttl"])
NOW = datetime(2026, 11, 21, tzinfo=UTC)
GRID = Grid((0.0, 0.0), 0.1, (40, 60))
PARTS = (BASE, ARM)
HALLS = (room("hall", 0, 0, 3, 4), room("dais", 3, 0, 6, 4, 0.4))


@settings(max_examples=30)
@given(
    size=st.sampled_from([0.05, 0.08, 0.2]),
    resolution=st.sampled_from([0.05, 0.07, 0.1]),
    origin=st.tuples(st.sampled_from([0.0, -0.31]), st.sampled_from([0.0, 0.13])),
    low=st.sampled_from([-0.1, 0.0, 0.15, 0.33]),
    tall=st.sampled_from([0.0, 0.05, 0.4]),
    seed=st.integers(0, 99),
)
def test_layer_cells_equal_brute_force(
    size: float, resolution: float, origin: tuple[float, float], low: float, tall: float, seed: int
) -> None:
    """A cell has the largest value of the voxels whose box it overlaps."""
    rng = np.random.default_rng(seed)
    boxes = [
        (Box(rng.uniform(0, 1, 3), rng.uniform(0.05, 0.4, 3)), float(v)) for v in (0.2, 0.9, 0.5)
    ]
    made = RepresentationMap.of_regions(
        VOCABULARY["personalSpace"], boxes, size, value_type="float32"
    )
    field = FieldVoxels.of_map(made)
    grid = Grid(origin, resolution, (20, 24))
    got = voxel_cells(field.voxels, (low, low + tall), grid, field.values)
    want = np.zeros((20, 24), np.float32)
    for voxel, value in zip(made.voxels().tolist(), made.values().tolist(), strict=True):
        if voxel[2] * size > low + tall or (voxel[2] + 1) * size < low:
            continue
        for r in range(20):
            for c in range(24):
                x, y = origin[0] + c * resolution, origin[1] + r * resolution
                if (
                    x < (voxel[0] + 1) * size - 1e-9
                    and x + resolution > voxel[0] * size + 1e-9
                    and y < (voxel[1] + 1) * size - 1e-9
                    and y + resolution > voxel[1] * size + 1e-9
                ):
                    want[r, c] = max(want[r, c], value)
    np.testing.assert_array_equal(got, want)


def person(x: float, y: float, low: float, high: float) -> RepresentationMap:
    body = Box((x, y, (low + high) / 2), (0.4, 0.3, high - low))
    return RepresentationMap.of_regions(
        VOCABULARY["containsPerson"], [(body, True)], 0.05, about="human1"
    )


def space(x: float, y: float, vx: float) -> RepresentationMap:
    (made,) = PersonalSpaceSource(VOCABULARY)(
        People({"human1": PersonMotion(x, y, 0.0, vx, 0.0)}, NOW)
    )
    return made


def costmap(**fields: RepresentationMap) -> Costmap:
    storey = scene(solid(1, (2, 3, 0), (4, 3.5, 1)), floors=HALLS)
    return Costmap(storey, PARTS, GRID, inflation=Inflation(0.4, 3.0), fields=fields)


def same(a: Costmap, b: Costmap) -> None:
    np.testing.assert_array_equal(a.costs, b.costs)
    np.testing.assert_array_equal(a.master, b.master)


def test_people_are_obstacles_for_the_parts_at_their_height() -> None:
    """Only what is within a part's interval above the floor there."""
    bare = costmap()
    low, high = ARM.interval
    raised = costmap(people=person(1.0, 1.0, low + 0.05, high))
    row, column = raised.grid.cell(1.0, 1.0)
    assert raised.costs[1, row, column] == 254
    assert raised.costs[0, row, column] == bare.costs[0, row, column]
    (cause,) = raised.explain(1.0, 1.0)
    assert (cause.field, cause.layer) == ("people", "lethal_obstacles")
    assert cause.entities == ("human1",)
    # On the dais the same height is lower above the floor.
    there = costmap(people=person(5.0, 1.0, 0.4 + low + 0.05, 0.4 + high))
    assert there.costs[1, *there.grid.cell(5.0, 1.0)] == 254


def test_social_costs_are_higher_ahead_of_a_person() -> None:
    made = costmap(social=space(1.5, 1.5, 0.8))
    row, column = made.grid.cell(1.5, 1.5)
    assert 200 < made.master[row, column] < 253
    ahead, behind = made.master[row, column + 8], made.master[row, column - 8]
    assert ahead > behind
    assert made.explain(1.5, 1.5)[0].entities == ("human1",)
    assert made.explain(1.5, 1.5)[0].cost == made.master[row, column]


@settings(max_examples=10)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["people", "social"]),
            st.sampled_from(["lay", "take"]),
            st.floats(-1, 7),
            st.floats(-1, 5),
        ),
        max_size=5,
    )
)
def test_set_field_equals_a_new_costmap(
    steps: list[tuple[str, str, float, float]],
) -> None:
    made = costmap()
    there: dict[str, RepresentationMap] = {}
    for name, what, x, y in steps:
        if what == "lay":
            there[name] = person(x, y, 0, 1.7) if name == "people" else space(x, y, 0.5)
        else:
            there.pop(name, None)
        made.set_field(name, there.get(name))
        same(made, costmap(**there))
    made.update([solid(1, (1, 1, 0), (1.5, 1.5, 1))])
    moved = costmap(**there)
    moved.update([solid(1, (1, 1, 0), (1.5, 1.5, 1))])
    same(made, moved)


def test_a_field_with_the_name_of_a_layer_is_refused() -> None:
    with pytest.raises(ValueError, match="another layer has this name"):
        costmap(lethal_obstacles=person(1, 1, 0, 1))
    with pytest.raises(ValueError, match="another layer has this name"):
        costmap().set_field("lethal_obstacles", None)
    assert costmap().set_field("nothing", None) is None


def test_a_turned_map_is_placed_by_its_pose() -> None:
    """A map in a sensor's frame lies where its frame is."""
    pose = np.array([[0, -1, 0, 2.0], [1, 0, 0, 1.0], [0, 0, 1, 0.5], [0, 0, 0, 1]])
    ball = RepresentationMap.of_regions(
        VOCABULARY["containsPerson"], [(Sphere((1.0, 0, 0), 0.2), True)], 0.05, about="h"
    )
    cells = voxel_cells(FieldVoxels.of_map(ball.placed(pose)).voxels, (0, 1), GRID)
    rows, columns = np.nonzero(cells)
    assert (rows.mean() + 0.5) * 0.1 == pytest.approx(2.0, abs=0.06)
    assert (columns.mean() + 0.5) * 0.1 == pytest.approx(2.0, abs=0.06)
