"""What sources see, on the grid of the map: the example of the paper, voxel by voxel."""

from __future__ import annotations

from typing import Any

from semmap.database.files import schema_folder
from semmap.fields.maps.live_entities import LiveEntities
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import read_vocabulary
from semmap.fields.regions.region_map import NamedRegionMap, RegionMap, Role, WithRole
from semmap.fields.regions.shaped_region import Box, Cone, voxels_of
from semmap.fields.relations.tracker import RelationTracker

VOCABULARY = read_vocabulary([schema_folder() / "ontology" / "fields.ttl"])
SIZE = 0.1
BOOK, ROOM, ZONE = (
    Box((2, 0, 1), (0.4, 0.4, 0.2)),
    Box((1, 0, 1), (4, 4, 2)),
    Box((2, 0, 1), (1, 1, 1)),
)
VIEW = Cone((0, 0, 1), (1, 0, 0), 0.5, 3.0)


def seen(
    property_name: str, *regions: Any, about: str | None = None, **more: Any
) -> RepresentationMap:
    return RepresentationMap.of_regions(
        VOCABULARY[property_name], [(r, 1) for r in regions], SIZE, about=about, **more
    )


def cells(region: Any) -> set[tuple[int, ...]]:
    return {tuple(v) for v in voxels_of(region, SIZE).tolist()}


class Scene:
    def __init__(self) -> None:
        self.regions = RegionMap(SIZE)
        self.names: dict[Any, str] = {1: "book_326", 2: "room_711", 3: "zone_943"}
        self.roles: dict[Any, Role] = {1: "object", 2: "room", 3: "region"}
        self.views: dict[Any, str] = {}
        for number, region in enumerate((BOOK, ROOM, ZONE), 1):
            self.regions.insert(number, region)
        self.live = LiveEntities(NamedRegionMap(self.regions, self.names, self.roles, self.views))

    def named(self, point: tuple[float, float, float]) -> set[str]:
        return {self.names[n] for n in self.regions.entities_at([point])[0]}


def test_one_voxel_has_the_set_of_the_paper() -> None:
    scene = Scene()
    assert scene.live.update([seen("inFieldOfView", VIEW, about="human1")]) == {"human1_view"}
    assert scene.named((2.0, 0.05, 1.05)) == {"book_326", "human1_view", "room_711", "zone_943"}
    shared = cells(VIEW) & cells(BOOK)
    assert shared
    assert scene.regions.overlap("human1_view", 1).voxels == len(shared)
    assert scene.regions.overlap("human1_view", 3).voxels == len(cells(VIEW) & cells(ZONE))


def test_relations_begin_and_end_with_what_is_seen() -> None:
    scene = Scene()
    names: dict[Any, Any] = scene.names
    tracker = RelationTracker(
        scene.regions, names=names, views=scene.views, spaces=WithRole(scene.roles)
    )
    tracker.update(scene.regions.entities())
    held = {str(fact.subject) + " in " + str(fact.object) for fact in tracker.holding("in")}
    assert {"book_326 in room_711", "book_326 in zone_943", "zone_943 in room_711"} <= held

    def events(*maps: RepresentationMap) -> set[str]:
        changed = scene.live.update(maps)
        found = {str(e) for e in tracker.update(changed) if e.relation in ("sees", "in")}
        scene.live.forget(changed)
        return found

    view = seen("inFieldOfView", VIEW, about="human1")
    people = seen(
        "containsPerson",
        Box((0, 0, 0.9), (0.4, 0.4, 1.7)),
        value_type="int32",
        legend={1: "human1"},
    )
    assert events(view, people) == {"human1 sees book_326 begins", "human1 in room_711 begins"}
    assert events(view, people) == set(), "the same maps change nothing"
    away = seen("inFieldOfView", Cone((0, 0, 1), (0, 1, 0), 0.5, 3.0), about="human1")
    assert events(away, people) == {"human1 sees book_326 ends"}
    assert events() == {"human1 in room_711 ends"}
    assert set(scene.names) == {1, 2, 3}
    assert scene.views == {}


def test_types_that_are_seen_are_no_entities() -> None:
    scene = Scene()
    mugs = seen("containsObject", BOOK, value_type="int32", legend={1: "mug"})
    assert scene.live.update([mugs]) == set()


def person(name: str, *regions: Any) -> RepresentationMap:
    return seen("containsPerson", *regions, value_type="int32", legend={1: name})


class SceneWithAnna(Scene):
    """Anna is an agent of the map, who stands outside of the room."""

    HOME, THERE = Box((9, 9, 0.9), (0.4, 0.4, 1.7)), Box((0, 0, 0.9), (0.4, 0.4, 1.7))

    def __init__(self) -> None:
        super().__init__()
        self.names[4], self.roles[4] = "anna", "agent"
        self.regions.insert(4, self.HOME)
        self.tracker = RelationTracker(
            self.regions, names=self.names, views=self.views, spaces=WithRole(self.roles)
        )
        self.tracker.update(self.regions.entities())

    def events(self, *maps: RepresentationMap) -> set[str]:
        changed = self.live.update(maps)
        found = {str(e) for e in self.tracker.update(changed) if e.relation in ("sees", "in")}
        self.live.forget(changed)
        return found

    def anna(self) -> set[tuple[int, ...]]:
        return {tuple(v) for v in self.regions.voxels(4).tolist()}


def test_a_person_whom_the_map_knows_is_one_entity() -> None:
    scene = SceneWithAnna()
    gone = SceneWithAnna.THERE, SceneWithAnna.HOME
    assert scene.events(person("anna", gone[0])) == {"anna in room_711 begins"}
    assert scene.anna() == cells(gone[0])
    assert "anna" not in scene.regions
    assert scene.events(person("bob", gone[0])) == {
        "anna in room_711 ends",
        "bob in room_711 begins",
    }
    assert (scene.anna(), scene.names[4]) == (cells(gone[1]), "anna")
    assert scene.events(person("anna")) == {"bob in room_711 ends"}
    assert scene.anna() == cells(gone[1]), "no voxel of her is seen"
    assert scene.events(person("anna", gone[0])) == {"anna in room_711 begins"}
    assert scene.events() == {"anna in room_711 ends"}
    assert scene.anna() == cells(gone[1])


def test_nobody_sees_themselves() -> None:
    scene = SceneWithAnna()
    view = seen("inFieldOfView", VIEW, about="anna")
    body = person("anna", Box((1, 0, 0.9), (0.3, 0.3, 1.7)))
    assert scene.events(view, body) == {"anna sees book_326 begins", "anna in room_711 begins"}


def test_an_agent_that_the_map_learns_or_forgets_keeps_its_relations() -> None:
    scene = SceneWithAnna()
    body = person("dora", SceneWithAnna.THERE)
    assert scene.events(body) == {"dora in room_711 begins"}
    scene.names[5], scene.roles[5] = "dora", "agent"
    scene.regions.insert(5, SceneWithAnna.HOME)
    assert scene.events(body) == set()
    assert scene.regions.entities() == {1, 2, 3, 4, 5}
    scene.live._on.restore(5)
    scene.regions.remove(5)
    del scene.names[5], scene.roles[5]
    assert scene.events(body) == set()
    assert scene.regions.entities() == {1, 2, 3, 4, "dora"}
