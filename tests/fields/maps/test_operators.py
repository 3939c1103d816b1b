"""Operators compared with arrays, everywhere and within a box; wrong combinations are refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.spatial.transform import Rotation

from semmap.fields.maps import operators as op
from semmap.fields.maps.grids import DTYPES, ValueType, empty_grid
from semmap.fields.maps.lattice import Lattice, VoxelBox
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.regions.shaped_region import Box, Sphere, voxels_of
from semmap.language.schema import Property

SEES = Property("urn:t#sees", "sees", "Region", "Agent", "voxel", "entity", measure="attention")
HOLDS = Property("urn:t#holds", "holds", "Object", "Object", "voxel", "entity")
COST = Property("urn:t#cost", "cost", "Region", None, "voxel", "number")
LOW, SIDE = -14, 28
SIZE = 0.05
BOX = VoxelBox((-9, -5, -7), (6, 10, 3))

Dense = tuple[NDArray[np.bool_], NDArray[Any]]  # active, values


def dense_of(grid: Any) -> Dense:
    active = grid.active().read_box((LOW,) * 3, (SIDE,) * 3)
    return active, np.where(active, grid.read_box((LOW,) * 3, (SIDE,) * 3), 0)


def map_of(
    dense: Dense, value_type: ValueType, property: Property = COST, **more: Any
) -> RepresentationMap:
    grid: Any = empty_grid(value_type, Lattice(SIZE))
    active, values = dense
    voxels = (np.argwhere(active) + LOW).astype(np.int32)
    grid.set(voxels, values[active].astype(DTYPES[value_type]))
    grid.prune()
    return RepresentationMap(property, grid, **more)


@st.composite
def denses(draw: st.DrawFn, value_type: ValueType = "float32") -> Dense:
    """Boxes of a value, some of whole blocks, in a cube of 20 voxels about the origin."""
    active = np.zeros((SIDE,) * 3, np.bool_)
    values = np.zeros((SIDE,) * 3, DTYPES[value_type])
    pick = {
        "bool": st.just(True),
        "int32": st.integers(1, 3),
        "float32": st.sampled_from([-1.5, 0.25, 2.0]),
    }[value_type]
    for _ in range(draw(st.integers(0, 3))):
        low = np.array(draw(st.tuples(*(st.sampled_from([4, 5, 6, 11, 14]),) * 3)))
        size = np.array(draw(st.tuples(*(st.sampled_from([1, 3, 8, 10]),) * 3)))
        at = tuple(slice(a, min(a + n, 24)) for a, n in zip(low, size, strict=True))
        active[at], values[at] = True, draw(pick)
    return active, values


def agree(made: RepresentationMap, want: Dense) -> None:
    """Compare a box of the map, computed first, and then the whole map."""
    inside = np.zeros((SIDE,) * 3, np.bool_)
    low, high = np.subtract(BOX.low, LOW), np.subtract(BOX.high, LOW)
    inside[tuple(slice(a, b + 1) for a, b in zip(low, high, strict=True))] = True
    for grid, cut in ((made.within(BOX), inside), (made.grid, np.ones_like(inside))):
        active, values = dense_of(grid)
        np.testing.assert_array_equal(active, want[0] & cut)
        np.testing.assert_allclose(values, np.where(want[0] & cut, want[1], 0), rtol=1e-6)
        assert len(grid) == (want[0] & cut).sum()


JOINS: dict[op.How, Callable[[Any, Any], Any]] = {
    "first": lambda a, b: a,
    "last": lambda a, b: b,
    "max": np.maximum,
    "min": np.minimum,
    "sum": np.add,
}


@pytest.mark.parametrize("value_type", ["float32", "int32"])
@pytest.mark.parametrize("how", JOINS)
@settings(max_examples=10)
@given(data=st.data())
def test_combine(how: op.How, value_type: ValueType, data: st.DataObject) -> None:
    (a, va), (b, vb) = data.draw(denses(value_type)), data.draw(denses(value_type))
    both = JOINS[how](va, vb).astype(va.dtype)
    want = a | b, np.where(a & b, both, np.where(a, va, vb))
    one, other = map_of((a, va), value_type), map_of((b, vb), value_type)
    agree(op.combine(one, other, how=how), want)


@settings(max_examples=20)
@given(denses("int32"), denses("bool"), denses("bool"))
def test_masks(a: Dense, b: Dense, c: Dense) -> None:
    objects = map_of(a, "int32", HOLDS, legend={1: "Mug", 2: "Table", 3: "Door"})
    seen, also = (map_of(each, "bool", SEES, about="human1") for each in (b, c))
    agree(op.mask(objects, seen), (a[0] & b[0], a[1]))
    agree(op.difference(objects, seen), (a[0] & ~b[0], a[1]))
    agree(op.intersection(seen, also), (b[0] & c[0], b[1]))
    agree(op.union(seen, also), (b[0] | c[0], b[1] | c[1]))
    agree(op.difference(op.mask(objects, seen), also), (a[0] & b[0] & ~c[0], a[1]))
    masked = op.mask(objects, seen)
    assert (masked.rdf_class, masked.property) == ("Object", HOLDS)
    assert masked.legend == objects.legend


@pytest.mark.parametrize("value_type", ["float32", "int32", "bool"])
@settings(max_examples=10)
@given(data=st.data())
def test_thresholds_and_values(value_type: ValueType, data: st.DataObject) -> None:
    active, values = data.draw(denses(value_type))
    property = replace(SEES) if value_type == "bool" else COST
    made = map_of((active, values), value_type, property)
    for low, high in ((0.3, 5), (-2, 1.5), (-np.inf, np.inf), (7, 9), (1, 1), (2, 1)):
        holds = active & (values.astype(float) >= low) & (values.astype(float) <= high)
        agree(op.threshold(made, low, high, as_=SEES), (holds, holds))
    doubled = op.map_values(made, lambda v: v * 2.0 + 1, value_type="float32", as_=COST)
    agree(doubled, (active, values * 2.0 + 1))


@pytest.mark.parametrize("metres", [0.0, 0.05, 0.075, 0.15])
@settings(max_examples=8)
@given(data=st.data())
def test_nearness(metres: float, data: st.DataObject) -> None:
    active, values = data.draw(denses("int32"))
    made = map_of((active, values), "int32")
    reach = round(metres / SIZE, 9)
    if active.any():
        far = distance_transform_edt(~active)
        within = far <= reach + 1e-9
    else:
        far, within = np.full(active.shape, np.inf), active
    agree(op.distance(made, metres), (within, np.where(within, far * SIZE, 0)))
    padded = distance_transform_edt(np.pad(active, 1))[1:-1, 1:-1, 1:-1]
    agree(op.erode(made, metres), (active & (padded > reach + 1e-9), values))
    grown = op.dilate(made, metres)
    np.testing.assert_array_equal(dense_of(grown.grid)[0], within)
    # The nearest may be several: the value is that of one as near.
    got = dense_of(grown.grid)[1]
    for value in (1, 2, 3):
        of = active & (values == value)
        near = distance_transform_edt(~of) if of.any() else np.full(active.shape, np.inf)
        assert (near[within & (got == value)] <= far[within & (got == value)] + 1e-9).all()
    assert (
        dense_of(op.dilate(map_of((active, active), "bool", SEES), metres).grid)[0] == within
    ).all()


def test_distances_across_tiles() -> None:
    """Distances over an extent of several dense boxes."""
    regions = [Sphere((0, 0, 0), 0.3), Sphere((9, 0.1, 0), 0.2), Box((4, 3, 0), (0.1, 0.1, 3))]
    made = RepresentationMap.of_regions(SEES, [(r, True) for r in regions], SIZE)
    far = op.distance(made, 1.0)
    rng = np.random.default_rng(1)
    points = rng.uniform((-1, -1, -2), (10, 4, 2), (3000, 3))
    centres = made.points()
    own = (np.floor(points / SIZE) + 0.5) * SIZE
    nearest = np.array([np.linalg.norm(centres - p, axis=1).min() for p in own])
    got = far.at(points)
    within = nearest <= 1.0 + 1e-9
    np.testing.assert_allclose(got[within], nearest[within], atol=1e-6)
    assert (got[~within] == 0).all()


def pose(seed: int) -> NDArray[np.float64]:
    m = np.eye(4)
    m[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    m[:3, 3] = np.random.default_rng(seed).uniform(-2, 2, 3)
    return m


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("size", [0.05, 0.08, 0.02])
def test_frames(seed: int, size: float) -> None:
    """A turned map in another lattice has at each centre the value of that point."""
    made = RepresentationMap.of_regions(
        COST,
        [(Box((0.1, -0.2, 0.3), (0.4, 0.9, 0.3)), 1.0), (Sphere((0, 0, 0), 0.2), 2.0)],
        SIZE,
        value_type="float32",
    ).placed(pose(seed))
    here = made.resampled(Lattice(size))
    assert len(here) > 0
    points = here.points()
    np.testing.assert_array_equal(made.at(points), here.values())
    # No hole: each centre near the map that lies in it is there.
    low, high = points.min(axis=0) - 0.2, points.max(axis=0) + 0.2
    grid = np.stack(
        np.meshgrid(
            *(
                np.arange(a, b)
                for a, b in zip(np.floor(low / size), np.floor(high / size), strict=True)
            ),
            indexing="ij",
        ),
        -1,
    )
    centres = (grid.reshape(-1, 3) + 0.5) * size
    assert (made.at(centres) != 0).sum() == len(here)
    # A part of it is the same part.
    ends = np.floor([(low + 0.3) / size, (high - 0.3) / size]).astype(int).tolist()
    box = VoxelBox(*map(tuple, ends))
    part, _ = here.within(box).read()
    alone = made.resampled(Lattice(size)).within(box).read()[0]
    np.testing.assert_array_equal(np.sort(part, axis=0), np.sort(alone, axis=0))
    other = RepresentationMap.of_regions(SEES, [(Sphere((0, 0, 0.2), 1.5), True)], size)
    seen = op.mask(made, other)
    assert seen.lattice == made.lattice
    assert set(map(tuple, seen.voxels())) == {
        tuple(v) for v, p in zip(made.voxels(), made.points(), strict=True) if other.at([p])[0]
    }


def test_only_the_box_is_computed() -> None:
    """A chain that is read in a box reads its sources in that box and within reach of it only."""
    boxes: list[VoxelBox | None] = []
    whole = RepresentationMap.of_regions(SEES, [(Box((0, 0, 0), (50, 50, 1)), True)], SIZE)

    def evaluate(box: VoxelBox | None) -> Any:
        boxes.append(box)
        return whole.within(box) if box is not None else whole.grid

    lazy = whole.like(evaluate)
    chain = op.difference(op.erode(op.dilate(lazy, 0.1), 0.2), lazy)
    assert boxes == []
    chain.within(VoxelBox((0, 0, 0), (7, 7, 7)))
    grown = VoxelBox((0, 0, 0), (7, 7, 7)).grown(6)
    assert boxes
    for box in boxes:
        assert box is not None
        assert np.all(np.array(box.low) >= grown.low)
        assert np.all(np.array(box.high) <= grown.high)
    voxels, _ = whole.within(VoxelBox((-1, -1, -1), (4, 4, 4))).read()
    assert 0 < len(voxels) <= 6**3


def test_legends_are_merged() -> None:
    a = RepresentationMap.of_regions(
        HOLDS, [(Sphere((0, 0, 0), 0.2), 1)], SIZE, value_type="int32", legend={1: "Mug"}
    )
    regions = [(Sphere((1, 0, 0), 0.2), 1), (Sphere((2, 0, 0), 0.2), 2)]
    b = RepresentationMap.of_regions(
        HOLDS, regions, SIZE, value_type="int32", legend={1: "Table", 2: "Mug"}
    )
    both = op.union(a, b)
    named = [both.legend[int(v)] for v in both.at([(0, 0, 0), (1, 0, 0), (2, 0, 0)])]
    assert named == ["Mug", "Table", "Mug"]


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda a, b, c: op.union(a, c), "have different properties"),
        (lambda a, b, c: op.combine(a, b, as_=SEES), "bring them to one type"),
        (lambda a, b, c: op.combine(c, c, how="max"), "entities have no max"),
        (lambda a, b, c: op.threshold(c, 1), "has entities for values"),
        (lambda a, b, c: op.threshold(b, 1), "its objects are numbers"),
        (lambda a, b, c: op.map_values(a, lambda v: v * 2, value_type="int32"), "legend"),
        (lambda a, b, c: op.union(), "at least one map"),
    ],
)
def test_wrong_combinations_are_refused(make: Callable[..., Any], says: str) -> None:
    sphere = Sphere((0, 0, 0), 0.2)
    a = RepresentationMap.of_regions(SEES, [(sphere, True)], SIZE, about="human1")
    b = RepresentationMap.of_regions(COST, [(sphere, 2.0)], SIZE, value_type="float32")
    c = RepresentationMap.of_regions(
        HOLDS, [(sphere, 1)], SIZE, value_type="int32", legend={1: "Mug"}
    )
    with pytest.raises(TypeError, match=says):
        make(a, b, c)


@pytest.mark.parametrize(
    ("property", "value_type", "more", "says"),
    [
        (COST, "bool", {}, "numbers"),
        (HOLDS, "float32", {"about": "x"}, "no measure"),
        (HOLDS, "int32", {}, "name them in the legend"),
        (HOLDS, "bool", {"legend": {1: "Mug"}}, "only int32"),
        (HOLDS, "int32", {"legend": {1: "Mug"}, "about": "x"}, "leave out the entity"),
        (COST, "int32", {"legend": {1: "Mug"}}, "leave out the legend"),
        (replace(COST, subject="entity"), "float32", {}, "not voxels"),
    ],
)
def test_values_that_a_property_cannot_have_are_refused(
    property: Property, value_type: ValueType, more: dict[str, Any], says: str
) -> None:
    with pytest.raises(TypeError, match=says):
        RepresentationMap(property, empty_grid(value_type, Lattice(SIZE)), **more)


def test_the_attributes_of_a_map() -> None:
    now = datetime(2026, 11, 21, tzinfo=UTC)
    region = Box((0.5, 0, 0), (0.3, 0.4, 0.2))
    made = RepresentationMap.of_regions(SEES, [(region, True)], SIZE, about="human1", time=now)
    assert (made.rdf_class, made.about, made.time, len(made)) == (
        "Region",
        "human1",
        now,
        len(voxels_of(region, SIZE)),
    )
    np.testing.assert_allclose(made.points(), (made.voxels() + 0.5) * SIZE)
    assert made.values().all()


@pytest.mark.parametrize("seed", range(3))
def test_labels_of_an_image(seed: int) -> None:
    """Each voxel has a label of its pixels, and that of more than half of them."""
    from collections import Counter

    from semmap_vdb import Int32Grid

    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.4, 0.6, (60, 80)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.1] = np.nan
    labels = rng.choice([0, 1, 1, 1, 2], depth.shape).astype(np.int32)
    fx, fy, cx, cy = 100.0, 110.0, 39.5, 29.5
    m = pose(seed)
    grid = Int32Grid.of_labels(depth, labels, (fx, fy, cx, cy), m[:3].tolist(), 0.55, SIZE)
    votes: dict[tuple[int, ...], Counter[int]] = {}
    for row, column in np.argwhere((labels > 0) & (depth <= 0.55)):
        d = float(depth[row, column])
        p = m @ np.array([(column - cx) / fx * d, (row - cy) / fy * d, d, 1])
        votes.setdefault(tuple(np.floor(p[:3] / SIZE).astype(int)), Counter())[
            int(labels[row, column])
        ] += 1
    voxels, values = grid.read()
    assert {tuple(v) for v in voxels.tolist()} == set(votes)
    for voxel, value in zip(voxels.tolist(), values.tolist(), strict=True):
        count = votes[tuple(voxel)]
        assert value in count
        top, lead = count.most_common(1)[0]
        if 2 * lead > count.total():
            assert value == top
