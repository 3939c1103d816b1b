"""What does not fit its holder, or its kind, is refused by SQL and by the API; nothing changes."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import shapely

import semmap


@pytest.fixture
def bothy(database: str) -> Iterator[semmap.Map]:
    with semmap.connect(database) as db:
        made = db.create_map("bothy")
        made.add_room("scullery", shapely.box(0, 0, 6, 5), floor=0, ceiling=2.6)
        made.add_room("byre", shapely.box(6.2, 0, 9, 5), floor=0, ceiling=2.6)
        made.add_door("hatch", "scullery", "byre", ((6.1, 1), (6.1, 2)))
        made.add_object("trestle", type="table", size=(1.4, 0.7, 0.7), pose=(2, 2, 0))
        made.add_object("beaker", type="mug", size=(0.08, 0.08, 0.1), pose=(4, 4, 0))
        yield made


@pytest.mark.parametrize(
    ("sides", "fits"),
    [((0.4, 0.3), True), ((0.25, 0.25), True), ((0.5, 0.5), False), ((1.4, 0.7), False)],
    ids=["tray", "plate", "chair", "table"],
)
@pytest.mark.parametrize("how", ["put_on", "sql", "add"])
def test_what_is_far_larger_than_its_holder_is_refused(
    bothy: semmap.Map, sides: tuple[float, float], fits: bool, how: str
) -> None:
    assert fits == (sides[0] * sides[1] <= 25 * 0.08**2)
    if how != "add":
        pose = (4, 4, 0.1) if how == "sql" else (1, 4, 0)
        bothy.add_object("thing", size=(*sides, 0.02), pose=pose)
        before = bothy["thing"].pose, bothy["thing"].holder

    def put() -> None:
        if how == "put_on":
            bothy["thing"].put_on("beaker")
        elif how == "sql":
            bothy.execute("SELECT put(entity_id('thing'), entity_id('beaker'), 'on')")
        else:
            bothy.add_object("thing", size=(*sides, 0.02), on="beaker")

    if fits:
        put()
        assert bothy["thing"].holder == bothy["beaker"]
        return
    with pytest.raises(ValueError, match=r"thing is too large .* on or in beaker: .* only 0\.006"):
        put()
    if how == "add":
        assert "thing" not in [entity.name for entity in bothy.find()]
    else:
        assert (bothy["thing"].pose, bothy["thing"].holder) == before


def test_a_towel_hangs_from_a_hook(bothy: semmap.Map) -> None:
    bothy.add_object("hook", size=(0.02, 0.05, 0.04), pose=(0.01, 3, 1.5))
    bothy.add_object("towel", size=(0.1, 0.6, 0.9), pose=(0.075, 3, 0.62))
    bothy.execute("SELECT put(entity_id('towel'), entity_id('hook'), 'on')")
    assert bothy["towel"].holder == bothy["hook"]


@pytest.mark.parametrize(
    ("name", "type_", "fits"),
    [
        ("scullery", "mug", False),
        ("scullery", "door", False),
        ("scullery", "kitchen", True),
        ("scullery", "robot", False),
        ("beaker", "kitchen", False),
        ("beaker", "bowl", True),
        ("beaker", "door", True),  # the leaf of a door is an object
        ("hatch", "kitchen", False),
        ("hatch", "fire_door", True),
    ],
)
@pytest.mark.parametrize("how", ["api", "sql"])
def test_a_type_is_of_the_kind_of_its_entity(
    bothy: semmap.Map, name: str, type_: str, fits: bool, how: str
) -> None:
    before = bothy[name].type

    def retype() -> None:
        if how == "api":
            bothy[name].type = type_
        else:
            bothy.execute("UPDATE entity SET type = %s WHERE name = %s", type_, name)

    if fits:
        retype()
    else:
        with pytest.raises(ValueError, match=f"{name} is of the kind .* {type_} is a type of"):
            retype()
    assert bothy[name].type == (type_ if fits else before)
