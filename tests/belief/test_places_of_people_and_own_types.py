"""People are on seats and beds, and things on whatever bears them, also of an own type."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import shapely

import semmap
from semmap.belief.identify import Detection


@pytest.fixture
def db(database: str) -> Iterator[semmap.Database]:
    with semmap.connect(database) as found:
        yield found


def ward(db: semmap.Database) -> semmap.Map:
    here = db.create_map("Station")
    here.add_room("Zimmer", shapely.box(0, 0, 6, 4), floor=1, ceiling=3.7)
    return here


@pytest.mark.parametrize("above", [0.02, 0.1, 0.3])
@pytest.mark.parametrize(("type_", "high"), [("bed", 0.6), ("armchair", 0.45)])
def test_people_lie_in_beds_and_sit(
    db: semmap.Database, type_: str, high: float, above: float
) -> None:
    here = ward(db)
    here.add_object("Möbel", type=type_, size=(2, 1, high), pose=(4, 3, 1, 0))
    top = 1 + high
    lying = Detection("person", (4, 3, top + above), (1.7, 0.5, 0.25))
    standing = Detection("person", (1, 1, 1.9), (0.5, 0.4, 1.8))
    said = here.observe_objects([lying, standing])
    assert [row["new"] for row in said] == [True, True]
    assert [row["place"] for row in said] == ["Möbel", "Zimmer"]
    poses = [here[str(row["object"])].pose for row in said]
    assert [round(p.z, 6) for p in poses if p is not None] == [top, 1]
    here.add_agent("ann", type="person", size=(0.5, 0.4, 1.7), pose=(2, 3, 1, 0))
    here.observe_point("ann", (4, 3, top + above))
    assert here["ann"].pose is not None
    assert here["ann"].pose.z == pytest.approx(top)
    assert here["ann"].room == here["Zimmer"]


def test_a_robot_is_on_no_bed(db: semmap.Database) -> None:
    here = ward(db)
    here.add_object("Bett", type="bed", size=(2, 1, 0.6), pose=(4, 3, 1, 0))
    here.add_agent("Robi", type="robot", size=(0.5, 0.5, 1), pose=(1, 1, 1, 0))
    assert "Bett" not in here.where("Robi")


@pytest.mark.parametrize("type_", ["gurney", "Fensterbank", "conveyor", None])
def test_things_are_on_what_bears_them_whatever_its_type(
    db: semmap.Database, type_: str | None
) -> None:
    here = ward(db)
    here.add_object("Träger", type=type_, size=(1.9, 0.6, 0.8), pose=(2, 2, 1, 0), define=True)
    here.add_object("Tasse", type="mug", size=(0.08, 0.08, 0.1), pose=(5, 3, 1, 0))
    said = here.observe_point("Tasse", (2.5, 2, 1.85))
    assert said["place"] == "Träger"
    cup = here["Tasse"]
    assert cup.pose is not None
    assert cup.pose.z == pytest.approx(1.8)
    assert (cup.relation, cup.holder) == ("on", here["Träger"])
    assert here.where("Tasse")["Träger"] > 0.9


def test_an_element_of_a_building_bears_nothing(db: semmap.Database) -> None:
    here = ward(db)
    size = (1.9, 0.6, 0.8)
    here.add_object("Fundament", type="building_element", size=size, pose=(2, 2, 1, 0))
    here.add_object("Tasse", type="mug", size=(0.08, 0.08, 0.1), pose=(5, 3, 1, 0))
    assert "Fundament" not in here.where("Tasse")
