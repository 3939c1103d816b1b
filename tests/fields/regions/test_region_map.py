"""The region map against a dictionary of voxels, step by step."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule
from numpy.typing import NDArray

from semmap.fields import Box, RegionMap, Sphere, voxels_of
from semmap.fields.regions.shaped_region import Region
from semmap_vdb import Int32Grid
from tests.oracles.region_map import check_region_map

SIZE = 0.5
ENTITIES = ("book_326", "fov_632", 711, ("zone", 943), "human1")

entities = st.sampled_from(ENTITIES)
places = st.tuples(*(st.integers(-12, 12).map(lambda i: i * SIZE),) * 3)
regions = st.one_of(
    st.builds(Box, places, st.tuples(*(st.sampled_from([0.0, 0.5, 1.0, 4.0, 8.0]),) * 3)),
    st.builds(Sphere, places, st.floats(0.2, 3.5)),
    st.lists(places, max_size=5).map(lambda points: np.array(points, dtype=float).reshape(-1, 3)),
)


class Model:
    """Which entities each voxel has."""

    def __init__(self) -> None:
        self.at: dict[tuple[int, ...], set[Hashable]] = defaultdict(set)

    def insert(self, entity: Hashable, region: Region) -> None:
        for voxel in voxels_of(region, SIZE).tolist():
            self.at[tuple(voxel)].add(entity)

    def remove(self, entity: Hashable) -> None:
        for voxel in list(self.at):
            self.at[voxel].discard(entity)
            if not self.at[voxel]:
                del self.at[voxel]

    def voxels(self, entity: Hashable) -> set[tuple[int, ...]]:
        return {voxel for voxel, here in self.at.items() if entity in here}


class Interleavings(RuleBasedStateMachine):
    """Two maps, of one thread and of four, and the model, through the same changes."""

    def __init__(self) -> None:
        super().__init__()
        self.model = Model()
        self.maps = [RegionMap(SIZE, threads=1), RegionMap(SIZE, threads=4)]

    @rule(entity=entities, region=regions)
    def insert(self, entity: Hashable, region: Region) -> None:
        self.model.insert(entity, region)
        for each in self.maps:
            each.insert(entity, region)

    @rule(entity=entities)
    def remove(self, entity: Hashable) -> None:
        self.model.remove(entity)
        for each in self.maps:
            each.remove(entity)

    @rule(entity=entities, region=regions)
    def move(self, entity: Hashable, region: Region) -> None:
        self.model.remove(entity)
        self.model.insert(entity, region)
        for each in self.maps:
            each.move(entity, region)

    @rule(pairs=st.lists(st.tuples(entities, regions), max_size=6))
    def insert_many(self, pairs: list[tuple[Hashable, Region]]) -> None:
        for entity, region in pairs:
            self.model.insert(entity, region)
        for each in self.maps:
            each.insert_many(pairs)

    @rule()
    def restart(self) -> None:
        """Both go on from the state that they left, kept as cubes; sets have their numbers."""
        for i, each in enumerate(self.maps):
            grid, sets = each.state()
            back = Int32Grid(SIZE, 0)
            back.put_blocks(grid.blocks(32), 32)
            self.maps[i] = RegionMap.from_state(back, sets, threads=each._threads)
            numbers = sorted(sets)
            assert self.maps[i].sets(numbers) == each.sets(numbers)

    @invariant()
    def equal(self) -> None:
        known = np.array(sorted(self.model.at), dtype=np.int32).reshape(-1, 3)
        near = np.concatenate([known, known + np.array((1, 0, 0)), known - np.array((0, 0, 1))])
        points = (near + 0.5) * SIZE
        wanted = [self.model.at.get(tuple(voxel), set()) for voxel in near.tolist()]
        numbers = []
        for each in self.maps:
            check_region_map(each._native)
            assert each.entities_at(points) == wanted
            assert each.memory().active_voxels == len(self.model.at)
            numbers.append(each.set_numbers_at(points))
            for entity in ENTITIES:
                found = each.voxels(entity).tolist()
                assert len(found) == len(self.model.voxels(entity))
                assert set(map(tuple, found)) == self.model.voxels(entity)
                assert (entity in each) == bool(found)
            a, b = ENTITIES[0], ENTITIES[1]
            both = len(self.model.voxels(a) & self.model.voxels(b))
            assert each.overlap(a, b).voxels == both
            assert each.overlap(a, b).volume == pytest.approx(both * SIZE**3)
        assert (numbers[0] == numbers[1]).all()


Interleavings.TestCase.settings = settings(
    deadline=None,
    max_examples=15,
    stateful_step_count=10,
    suppress_health_check=[HealthCheck.too_slow],
)
test_interleavings = Interleavings.TestCase


def random_spheres(count: int) -> list[tuple[Hashable, Sphere]]:
    random = np.random.default_rng(4)
    return [(i, Sphere(random.uniform(-25, 25, 3), random.uniform(8, 16))) for i in range(count)]


def test_insert_many_equals_single_insertions() -> None:
    """One pass on one, two or four threads; also into a map that has some and into itself."""
    spheres = random_spheres(24)
    alone = RegionMap(1.0)
    for entity, region in spheres:
        alone.insert(entity, region)
    points = np.random.default_rng(5).uniform(-45, 45, (20_000, 3))
    numbers: list[NDArray[np.int32]] = []
    for threads in (1, 2, 4):
        together = RegionMap(1.0, threads=threads)
        together.insert_many(spheres[:10])
        together.insert_many(dict(spheres))
        check_region_map(together._native)
        assert together.entities_at(points) == alone.entities_at(points)
        numbers.append(together.set_numbers_at(points))
    assert (numbers[0] == numbers[1]).all()
    assert (numbers[0] == numbers[2]).all()


def test_removing_all_entities_frees_the_memory() -> None:
    """After all entities are removed, the map is as small as a new one; numbers are reused."""
    whole = RegionMap(1.0)
    for _ in range(3):
        whole.insert_many(random_spheres(20))
        assert whole.memory().set_count > 50
        for entity in range(20):
            whole.remove(entity)
            check_region_map(whole._native)
        memory = whole.memory()
        assert (memory.active_voxels, memory.leaves, memory.tiles, memory.set_count) == (0, 0, 0, 0)
        assert memory.grid < 2000
        assert len(whole) == 0


def test_a_register_under_churn() -> None:
    """Thousands of sets made and freed in no order; each stays one, with one number."""
    random = np.random.default_rng(7)
    here = RegionMap(1.0)
    for i in range(150):
        entity = int(random.integers(40))
        points = random.integers(0, 24, (random.integers(1, 4000), 3)).astype(float)
        here.move(entity, points)
        if i % 10 == 9:
            check_region_map(here._native)
    assert here.memory().set_count > 2000


def test_sets_have_no_order() -> None:
    """{A, B} and {B, A} are one set with one number."""
    here = RegionMap(0.1)
    here.insert("A", np.array([(0.0, 0, 0), (5, 0, 0)]))
    here.insert("B", np.array([(5.0, 0, 0), (9, 0, 0)]))
    here.insert("B", np.array([(0.0, 0, 0)]))
    here.insert("A", np.array([(9.0, 0, 0)]))
    assert len(set(here.set_numbers_at([(0, 0, 0), (5, 0, 0), (9, 0, 0)]).tolist())) == 1
    assert here.memory().set_count == 1


def test_whole_blocks_are_tiles() -> None:
    """A room of whole blocks has no leaves; entities that move in it split and restore blocks."""
    here = RegionMap(1.0)
    here.insert("room", Box((40, 40, 40), (80, 80, 80)))
    assert (here.memory().leaves, here.memory().tiles) == (0, 1000)
    here.insert("ball", Sphere((40, 40, 40), 6))
    assert here.memory().leaves > 0
    here.remove("ball")
    assert (here.memory().leaves, here.memory().tiles) == (0, 1000)
    check_region_map(here._native)


def test_far_apart() -> None:
    """Entities at both ends of a grid; points beyond are refused."""
    here = RegionMap(0.1)
    for x in (-1e8, 1e8):
        here.insert("A", np.array([(x, -x, x)]))
    assert here.entities_at([(1e8, -1e8, 1e8), (0, 0, 0)]) == [{"A"}, set()]
    check_region_map(here._native)
    here.remove("A")
    check_region_map(here._native)
    with pytest.raises(ValueError, match="larger voxels"):
        here.entities_at([(1e9, 0, 0)])


def test_a_refused_region_changes_nothing() -> None:
    """A region that cannot be rasterised leaves no entity behind."""
    here = RegionMap(0.1)
    here.insert("A", Sphere((0, 0, 0), 1))
    before = here.voxels("A")
    for change in (here.insert, here.move):
        for entity in ("A", "B"):
            with pytest.raises(ValueError, match="nearer frame"):
                change(entity, Sphere((1e12, 0, 0), 1))
    with pytest.raises(ValueError, match="nearer frame"):
        here.insert_many([("C", Sphere((0, 0, 0), 1)), ("B", Sphere((1e12, 0, 0), 1))])
    assert here.entities() == {"A"}
    assert (here.voxels("A") == before).all()
    check_region_map(here._native)


@pytest.mark.parametrize("size", [0, -1, float("nan"), float("inf")])
def test_voxel_size(size: float) -> None:
    """Voxels have a size."""
    with pytest.raises(ValueError, match="voxel_size"):
        RegionMap(size)


def test_unknown_entities() -> None:
    """Removing one does nothing; it has no voxels and shares none."""
    here = RegionMap(0.1)
    here.remove("nobody")
    assert here.voxels("nobody").shape == (0, 3)
    assert here.overlap("nobody", "none").voxels == 0
    assert "nobody" not in here


def test_wrong_states_are_refused() -> None:
    """Grid and sets that do not belong together are refused."""
    regions = RegionMap(SIZE)
    regions.insert("a", Sphere((0, 0, 0), 3))
    regions.insert("b", Box((2, 0, 0), (8, 8, 8)))
    grid, sets = regions.state()
    assert RegionMap.from_state(grid, sets).state()[1] == sets
    other = Int32Grid(SIZE, 0)
    other.fill(Sphere((0, 0, 0), 1).shape, 0)
    unlike = Int32Grid(SIZE, 1)
    one, two, *_ = sets
    for bad_grid, bad_sets in (
        (grid, {}),
        (grid, {n: m for n, m in sets.items() if n != one}),
        (grid, sets | {one: sets[two]}),
        (grid, sets | {77: ["c"]}),
        (grid, sets | {one: []}),
        (grid, {-n: m for n, m in sets.items()}),
        (other, {1: ["a"]}),
        (unlike, {1: ["a"]}),
        (Int32Grid(SIZE, 0), sets),
    ):
        with pytest.raises(ValueError, match="not the state of a region map"):
            RegionMap.from_state(bad_grid, bad_sets)
