"""Relations of moving entities, compared with sets of voxels, pair by pair."""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from fractions import Fraction
from itertools import combinations, permutations, product

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule
from scipy.spatial import cKDTree

from semmap.database.files import schema_folder
from semmap.fields import Box, Cone, RegionMap, Sphere, voxels_of
from semmap.fields.maps.map_buffer import MapBuffer
from semmap.fields.maps.vocabulary import read_vocabulary
from semmap.fields.queries.catalogue import FieldCatalogue
from semmap.fields.queries.columns import Demand
from semmap.fields.queries.relations import EntityRelation
from semmap.fields.regions.region_map import NamedRegionMap
from semmap.fields.regions.shaped_region import Region
from semmap.fields.relations.facts import RelationEvent, RelationFact
from semmap.fields.relations.rules import RULES, RelationRule
from semmap.fields.relations.tracker import RelationTracker
from semmap.language.schema import Property

SIZE = 0.5
NEAR = 1.0
BODIES = ("mug", "table", "human1", 711)
SPACES = ("kitchen",)
VIEWS = {"eyes": "human1", "left eye": "human2", "right eye": "human2"}
NAMES = {711: "room_711"}

Voxel = tuple[int, int, int]
START = datetime(2026, 1, 1, tzinfo=UTC)

places = st.tuples(*(st.integers(-6, 6).map(lambda i: i * SIZE / 2),) * 3)
regions = st.one_of(
    st.builds(Box, places, st.tuples(*(st.sampled_from([0.0, 0.5, 1.0, 2.0]),) * 3)),
    st.builds(Sphere, places, st.floats(0.2, 1.3)),
    st.lists(places, max_size=5).map(lambda points: np.array(points, dtype=float).reshape(-1, 3)),
)


class Model:
    """All pairs, computed again at each step."""

    def __init__(self) -> None:
        self.voxels: dict[Hashable, set[Voxel]] = {}
        self.standing: set[tuple[str, Hashable, Hashable]] = set()

    def move(self, entity: Hashable, region: Region | None) -> None:
        voxels = [] if region is None else voxels_of(region, SIZE).tolist()
        self.voxels[entity] = {(x, y, z) for x, y, z in voxels}

    def update(self) -> set[RelationFact]:
        present = [entity for entity, voxels in self.voxels.items() if voxels]
        self.standing = {
            (name, a, b)
            for a, b in permutations(present, 2)
            for name in ("in", "on", "touching", "near", "sees")
            if self.holds(name, a, b, (name, a, b) in self.standing)
        }
        return {
            RelationFact(name, *(NAMES.get(each, each) for each in (VIEWS.get(a, a), b)))
            for name, a, b in self.standing
        }

    def holds(self, name: str, a: Hashable, b: Hashable, standing: bool) -> bool:
        of_a, of_b = self.voxels[a], self.voxels[b]
        if name == "sees":
            if a not in VIEWS or b not in BODIES or VIEWS[a] == b:
                return False
            return Fraction(len(of_a & of_b), len(of_b)) >= Fraction(1, 10 if standing else 5)
        if a in VIEWS or b in VIEWS:
            return False
        if name == "in" and (b in SPACES or a not in SPACES):
            share = Fraction(len(of_a & of_b), len(of_a))
            begins, ends = (5, 4) if b in SPACES else (9, 8)
            return share >= Fraction(ends if standing else begins, 10)
        if a in SPACES and b in SPACES:
            return False
        if name == "near":
            squared = Fraction(6, 5) ** 2 * 4 if standing else 4  # (1 m / 0.5 m)^2
            return gap(of_a, of_b) <= squared
        if a in SPACES or b in SPACES:
            return False
        if name == "touching":
            return gap(of_a, of_b) <= (1 if standing else 0)
        return rests(of_a, of_b, standing)


def gap(a: set[Voxel], b: set[Voxel]) -> int:
    """The smallest squared gap of cubes."""
    return min(
        sum(max(abs(u - v) - 1, 0) ** 2 for u, v in zip(p, q, strict=True))
        for p, q in product(a, b)
    )


def rests(a: set[Voxel], b: set[Voxel], standing: bool) -> bool:
    bottom, top = min(z for *_, z in a), max(z for *_, z in a)
    low, high = min(z for *_, z in b), max(z for *_, z in b)
    slack = 1 if standing else 0
    if not (low < bottom or (low <= bottom + slack and high < top)):
        return False
    layer = [(x, y) for x, y, z in a if z == bottom]

    def rests_at(x: int, y: int, z: int) -> bool:
        """Return whether a voxel rests on b where the lowest layer is at z."""
        return ((x, y, z - 1) in b or (x, y, z) in b) and (x, y, z + 1) not in b

    def loosely(x: int, y: int) -> bool:
        here = [(x, y, bottom + k) in b for k in (-2, -1, 0, 1)]
        return any(here) and not ((x, y, bottom + 1) in b and (x, y, bottom + 2) in b)

    resting = sum(loosely(x, y) if standing else rests_at(x, y, bottom) for x, y in layer)
    return Fraction(resting, len(layer)) >= Fraction(1, 20 if standing else 10)


def near_rule(distance: float) -> RelationRule:
    (rule,) = [each for each in RULES if each.name == "near"]
    return replace(rule, begin=distance, end=1.2 * distance)


class Moving(RuleBasedStateMachine):
    """Entities are inserted, moved and removed, one or several at once."""

    def __init__(self) -> None:
        super().__init__()
        self.model = Model()
        self.map = RegionMap(SIZE)
        rules = [near_rule(NEAR) if each.name == "near" else each for each in RULES]
        self.tracker = RelationTracker(
            self.map, views=VIEWS, spaces=SPACES, names=NAMES, rules=rules
        )
        self.time = START
        self.heard: list[RelationEvent] = []
        self.waiting: set[Hashable] = set()

    @rule(entity=st.sampled_from([*BODIES, *SPACES, *VIEWS]), region=regions)
    def move(self, entity: Hashable, region: Region) -> None:
        self.model.move(entity, region)
        self.map.move(entity, region)
        self.update(entity)

    @rule(
        entity=st.sampled_from(BODIES[:2]),
        below=st.sampled_from(BODIES[1:]),
        side=st.sampled_from([0.0, 0.5, 1.0]),
        by=st.tuples(*(st.integers(-2, 2).map(lambda i: i * SIZE / 2),) * 3),
    )
    def put_about_on(
        self, entity: Hashable, below: Hashable, side: float, by: tuple[float, ...]
    ) -> None:
        """Regions at thresholds."""
        voxels = self.model.voxels.get(below)
        if voxels and entity != below:
            top = np.array(max(voxels, key=lambda voxel: voxel[2])) + np.array((0.5, 0.5, 1.0))
            place = top * SIZE + np.array((0, 0, side / 2)) + np.array(by)
            self.move(entity, Box(place, (side, side, side)))

    @rule(entity=st.sampled_from(BODIES[:2]), region=regions)
    def move_unseen(self, entity: Hashable, region: Region) -> None:
        """Pass an entity to the next update."""
        self.model.move(entity, region)
        self.map.move(entity, region)
        self.waiting.add(entity)

    @rule(entity=st.sampled_from([*BODIES, *VIEWS]))
    def vanish(self, entity: Hashable) -> None:
        self.model.move(entity, None)
        self.map.remove(entity)
        self.update(entity)

    def update(self, entity: Hashable) -> None:
        self.time += timedelta(seconds=1)
        events = self.tracker.update([*self.waiting, entity], self.time)
        self.waiting.clear()
        facts = [event.fact for event in events]
        assert len(set(facts)) == len(facts), "a fact has one event an update"
        assert [e.began for e in events] == sorted(e.began for e in events), "ends come first"
        assert {event.time for event in events} <= {self.time}
        self.heard += events
        assert set(self.tracker.holding()) == self.model.update()

    @invariant()
    def events_tell_all(self) -> None:
        """The events, replayed, give the facts that are true; each fact begins and ends in turn."""
        replayed: dict[RelationFact, datetime] = {}
        for event in self.heard:
            assert event.began == (event.fact not in replayed)
            if event.began:
                replayed[event.fact] = event.time
            else:
                del replayed[event.fact]
        assert replayed == self.tracker.holding()


Moving.TestCase.settings = settings(
    deadline=None,
    max_examples=40,
    stateful_step_count=25,
    suppress_health_check=[HealthCheck.too_slow],
)
test_moving = Moving.TestCase


def test_neighbours_of_many_blocks() -> None:
    """Gaps against a k-d tree of the voxels of each entity."""
    random = np.random.default_rng(4)
    here = RegionMap(0.1)
    for i in range(30):
        size = random.uniform(0.05, 2, 3)
        place = random.uniform(-2.5, 2.5, 3)
        shape = Box(place, size) if i % 2 else Sphere(place, size[0] / 2)
        here.insert(i, shape)
    around = np.array([*product((-1, 0, 1), repeat=3)])
    voxels = {i: here.voxels(i) for i in here.entities()}
    grown = {
        i: cKDTree(np.unique((v[:, None] + around).reshape(-1, 3), axis=0), balanced_tree=False)
        for i, v in voxels.items()
    }
    squared = {
        (a, b): round(float(np.min(grown[a].query(voxels[b])[0]) ** 2))
        for a, b in combinations(voxels, 2)
    }
    for reach in (0.0, 0.3, 1.7):
        found = 0
        for a in voxels:
            wanted = {}
            for b in voxels:
                apart = squared.get((a, b), squared.get((b, a), math.inf))
                if apart <= (reach / 0.1) ** 2 + 1e-6:
                    wanted[b] = (here.overlap(a, b).voxels, pytest.approx(apart**0.5))
            near = here.neighbours(a, reach)
            assert {b: tuple(each) for b, each in near.items()} == wanted
            shared = {b: each for b, each in near.items() if each.shared}
            assert here.neighbours(a) == shared
            found += len(wanted)
        assert found > 50


def test_neighbours_through_tiles() -> None:
    """Blocks that one entity fills, and one far away at the other end of the grid."""
    here = RegionMap(1.0)
    here.insert("room", Box((40, 40, 40), (80, 80, 80)))
    here.insert("ball", Sphere((100.5, 40.5, 40.5), 10.2))
    here.insert("point", np.array([(-1e8, 1e8, 1e8)]))
    assert here.neighbours("ball", 20) == {"room": (0, 10.0)}
    assert here.neighbours("room", 20) == {"ball": (0, 10.0)}
    assert here.neighbours("ball", 9.9) == {}
    assert here.neighbours("point", 50) == {}
    assert here.neighbours("nobody", 50) == {}
    with pytest.raises(ValueError, match="1000 voxels"):
        here.neighbours("ball", 1001)


def scene() -> tuple[RegionMap, RelationTracker]:
    here = RegionMap(0.05)
    here.insert("table", Box((0, 0, 0.375), (1.2, 0.8, 0.75)))
    here.insert("eyes", Cone((-2, 0, 1.6), (1, 0, -0.4), 0.9, 3.0))
    return here, RelationTracker(here, views={"eyes": "human1"}, spaces={"kitchen"})


def sentences(events: list[RelationEvent]) -> set[str]:
    return {str(event) for event in events}


def test_a_mug_is_carried() -> None:
    """The mug is put onto the table, shifted and taken off; each event occurs once."""
    here, tracker = scene()
    here.insert("mug", Box((3, 0, 0.80), (0.1, 0.1, 0.1)))
    assert sentences(tracker.update(["mug", "table", "eyes"])) == {"human1 sees table begins"}
    here.move("mug", Box((0, 0, 0.80), (0.1, 0.1, 0.1)))
    assert sentences(tracker.update(["mug"])) == {
        "mug on table begins",
        "mug touching table begins",
        "table touching mug begins",
        "mug near table begins",
        "table near mug begins",
        "human1 sees mug begins",
    }
    for x in np.linspace(0, 0.5, 11):
        here.move("mug", Box((x, 0, 0.80), (0.1, 0.1, 0.1)))
        assert sentences(tracker.update(["mug"])) == set()
    since = tracker.holding("on")[RelationFact("on", "mug", "table")]
    here.remove("mug")
    events = tracker.update(["mug"])
    assert sentences(events) == {
        "mug on table ends",
        "mug touching table ends",
        "table touching mug ends",
        "mug near table ends",
        "table near mug ends",
        "human1 sees mug ends",
    }
    assert all(event.time >= since for event in events)
    assert set(tracker.holding()) == {RelationFact("sees", "human1", "table")}
    assert tracker.update(["mug", "nobody"]) == []


def test_small_movements_cause_no_events() -> None:
    """A millimetre to and fro across each threshold, 200 times: at most one event a fact."""
    here, tracker = scene()
    tracker.update(["table", "eyes"])
    here.insert("kitchen", Box((2, 0, 1), (2, 2, 2)))
    tracker.update(["kitchen"])
    random = np.random.default_rng(1)
    for still in [
        (0.0, 0.0, 0.825),
        (0.0, 0.0, 0.80),
        (0.675, 0.0, 0.80),
        (1.125, 0.0, 0.5),
        (1.0, 0.0, 0.5),
        (-1.3, 0.25, 1.3),
    ]:
        events: list[RelationEvent] = []
        for _ in range(200):
            trembling = np.array(still) + random.uniform(-0.004, 0.004, 3)
            here.move("mug", Box(trembling, (0.1, 0.1, 0.1)))
            events += tracker.update(["mug"])
        facts = [event.fact for event in events if event.began]
        ended = [event.fact for event in events if not event.began]
        assert len(facts) == len(set(facts))
        assert len(ended) == len(set(ended))
        here.remove("mug")
        tracker.update(["mug"])


def test_without_hysteresis_small_movements_cause_events() -> None:
    """The same trembling floods where a relation ends a hair from where it begins."""
    here, _ = scene()
    rules = [replace(r, end=1e-6) if r.name == "touching" else r for r in RULES]
    tracker = RelationTracker(here, rules=rules)
    random = np.random.default_rng(1)
    events: list[RelationEvent] = []
    for _ in range(200):
        here.move("mug", Box((0, 0, 0.825 + random.uniform(-0.004, 0.004)), (0.1, 0.1, 0.1)))
        events += tracker.update(["mug"])
    assert sum(event.relation == "touching" for event in events) > 50


def test_spaces_and_views_have_their_own_relations() -> None:
    here, tracker = scene()
    here.insert("kitchen", Box((0, 0, 1), (3, 3, 2)))
    here.insert("human1", Box((-2, 0, 0.85), (0.4, 0.4, 1.7)))
    events = tracker.update(["table", "eyes", "kitchen", "human1"])
    assert sentences(events) == {
        "table in kitchen begins",
        "table near kitchen begins",
        "kitchen near table begins",
        "human1 sees table begins",
        "human1 near kitchen begins",
        "kitchen near human1 begins",
    }


def test_two_eyes_see_one_entity_once() -> None:
    here = RegionMap(0.1)
    views = {"left": "human1", "right": "human1"}
    tracker = RelationTracker(here, views=views)
    here.insert("mug", Sphere((2, 0, 0), 0.3))
    here.insert("left", Cone((0, 0.1, 0), (1, 0, 0), 0.6, 5.0))
    here.insert("right", Cone((0, -0.1, 0), (1, 0, 0), 0.6, 5.0))
    assert sentences(tracker.update(["mug", "left", "right"])) == {"human1 sees mug begins"}
    here.move("left", Cone((0, 0.1, 0), (-1, 0, 0), 0.6, 5.0))
    assert tracker.update(["left"]) == []
    here.remove("right")
    here.move("left", Cone((0, 0.1, 0), (1, 0, 0), 0.6, 5.0))
    assert tracker.update(["left", "right"]) == []
    here.remove("left")
    assert sentences(tracker.update(["left"])) == {"human1 sees mug ends"}


def test_a_fact_ends_with_the_name_that_it_began_with() -> None:
    """A removed entity has lost its name; a renamed one ends and begins a fact."""
    here = RegionMap(0.1)
    names: dict[Hashable, Hashable] = {1: "mug", 2: "table"}
    tracker = RelationTracker(here, names=names, rules=[r for r in RULES if r.name == "on"])
    here.insert(1, Box((0, 0, 0.85), (0.1, 0.1, 0.1)))
    here.insert(2, Box((0, 0, 0.4), (1, 1, 0.8)))
    assert sentences(tracker.update([1, 2])) == {"mug on table begins"}
    names[1] = "cup"
    assert [str(e) for e in tracker.update([1])] == ["mug on table ends", "cup on table begins"]
    here.remove(1)
    del names[1]
    assert sentences(tracker.update([1])) == {"cup on table ends"}


def test_the_statements_of_a_relation() -> None:
    """The pairs that are true, limited on either side."""
    here, tracker = scene()
    for i in range(3):
        here.insert(f"mug{i}", Box((0.2 * i, 0, 0.80), (0.1, 0.1, 0.1)))
    tracker.update(here.entities())
    on = EntityRelation(Property("urn:x#on", "on", None, None, "entity", "entity"), lambda: tracker)

    def rows(**limits: list[str]) -> list[tuple[str, str]]:
        subject, object = on.statements(Demand(**limits))
        return [
            (subject.names[i], object.names[j])  # type: ignore[union-attr]
            for i, j in zip(subject.codes, object.codes, strict=True)  # type: ignore[union-attr]
        ]

    assert rows() == [(f"mug{i}", "table") for i in range(3)]
    assert rows(subjects=["mug1", "nobody"]) == [("mug1", "table")]
    assert rows(objects=["mug1"]) == []
    under = Property("urn:x#under", "under", None, None, "entity", "entity")
    with pytest.raises(LookupError, match="in, on, touching, near, sees"):
        EntityRelation(under, lambda: tracker).statements()


def test_wrong_rules_and_times_are_refused() -> None:
    here, tracker = scene()
    with pytest.raises(ValueError, match="different"):
        replace(RULES[0], end=0.9)
    with pytest.raises(ValueError, match="one rule"):
        RelationTracker(here, rules=[*RULES, near_rule(2)])
    with pytest.raises(ValueError, match="time zone"):
        tracker.update([], datetime(2026, 1, 1))
    tracker.update([], START + timedelta(hours=1))
    with pytest.raises(ValueError, match="before"):
        tracker.update(["table"], START)
    assert tracker.holding() == {}


def test_rules_are_data() -> None:
    """A custom relation is one more rule."""
    here, _ = scene()
    beside = RelationRule("beside", "metres apart", 0.2, 0.3, frozenset({("body", "body")}))
    tracker = RelationTracker(here, views={"eyes": "human1"}, rules=[beside])
    here.insert("chair", Box((0, 0.7, 0.25), (0.4, 0.4, 0.5)))
    assert sentences(tracker.update(["chair"])) == {
        "chair beside table begins",
        "table beside chair begins",
    }


def test_queries_read_relations() -> None:
    """Queries read relations by the properties of the ontology."""
    here, tracker = scene()
    here.insert("mug", Box((0, 0, 0.80), (0.1, 0.1, 0.1)))
    tracker.update(here.entities())
    vocabulary = read_vocabulary([schema_folder() / "ontology" / "fields.ttl"])
    stated = [EntityRelation(vocabulary[each.name], lambda: tracker) for each in RULES]
    catalogue = FieldCatalogue(vocabulary, MapBuffer(), relations=stated)
    for name, subject, object in (("on", "mug", "table"), ("sees", "human1", "mug")):
        found = catalogue.relation(vocabulary[name]).statements(Demand([subject]))
        assert object in found.object.names  # type: ignore[union-attr]
        assert set(found.subject.names) == {subject}  # type: ignore[union-attr]


def test_a_body_in_an_opening_is_in_the_room_with_most_of_it() -> None:
    """Rooms with a wall of 40 cm between them, as one of them moves, and as the body does."""
    here = RegionMap(0.1)
    rooms = {"west": (-5.0, 0.0), "east": (0.4, 5.0)}
    for name, (low, high) in rooms.items():
        here.insert(name, Box(((low + high) / 2, 0, 1.25), (high - low, 4, 2.5)))
    tracker = RelationTracker(here, spaces=rooms, rooms=rooms)
    tracker.update(rooms)
    moves = [(round(-1 + 0.1 * step, 1), "table") for step in range(26)]
    for low, _ in moves:
        here.move("table", Box((low + 0.6, 0, 0.35), (1.2, 0.8, 0.7)))
        tracker.update(["table"])
        share = {
            name: max(min(low + 1.2, end) - max(low, begin), 0) / 1.2
            for name, (begin, end) in rooms.items()
        }
        found = {fact.object for fact in tracker.holding("in") if fact.subject == "table"}
        most = max(share.values())
        assert len(found) <= 1
        assert found <= {n for n in rooms if share[n] >= min(0.4, most) - 1e-6}
        if abs(share["west"] - share["east"]) > 1e-6:
            assert max(share, key=lambda name: share[name]) in found
        assert most < 0.5 - 1e-6 or found

    here.move("table", Box((0.3, 0, 0.35), (1.2, 0.8, 0.7)))  # 0.3 m in the west, 0.5 m in the east
    tracker.update(["table"])
    facts = [fact.object for fact in tracker.holding("in") if fact.subject == "table"]
    assert facts == ["east"]
    here.move("east", Box((2.9, 0, 1.25), (4.4, 4, 2.5)))  # the east begins at 0.7 m
    tracker.update(["east"])
    assert not [fact for fact in tracker.holding("in") if fact.subject == "table"]
    here.move("west", Box((-2.3, 0, 1.25), (5.4, 4, 2.5)))  # the west ends at 0.4 m
    tracker.update(["west"])
    facts = [fact.object for fact in tracker.holding("in") if fact.subject == "table"]
    assert facts == ["west"]


def test_the_map_states_the_room_of_a_body_that_voxels_leave_open() -> None:
    """Half of a cup of two voxels is in each room; a source that sees it sees voxels alone."""
    mirror = NamedRegionMap(RegionMap(0.1), roles={1: "room", 2: "room"}, homes={3: 1, 4: None})
    mirror.names.update({1: "west", 2: "east", 3: "cup", 4: "drawing"})
    mirror.regions.insert(1, Box((-1, 0, 1), (2, 4, 2)))
    mirror.regions.insert(2, Box((1, 0, 1), (2, 4, 2)))
    for body in (3, 4):
        mirror.regions.insert(body, Box((0, 0, 0.5), (0.2, 0.2, 0.2)))
    tracker = RelationTracker.of(mirror)

    def rooms() -> set[tuple[Hashable, Hashable]]:
        facts = tracker.holding("in")
        return {(fact.subject, fact.object) for fact in facts if fact.object in ("west", "east")}

    tracker.update([1, 2, 3, 4])
    assert rooms() == {("cup", "west")}
    mirror.homes[3] = 2
    tracker.update([3])
    assert rooms() == {("cup", "east")}
    mirror.show(3, mirror.regions.centres(1)[:10])
    tracker.update([3])
    assert rooms() == {("cup", "west")}
