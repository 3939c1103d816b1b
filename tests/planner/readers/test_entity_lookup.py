import pytest

from planner.readers.entity_lookup import find_entities
from semmap.database.maps import see_map
from tests.seen import seen_by


@pytest.mark.parametrize(
    ("said", "places"),
    [
        ("lab1", ["lab1"]),
        ("muffin1", ["office4"]),  # on desk4 in office4
        ("desk1", ["lab2"]),
        ("kitchen", ["kitchen"]),
        ("lab", ["lab1", "lab2"]),
        ("meeting_room", ["meeting1", "meeting3"]),
        ("sanitary_room", ["restroom1", "restroom3"]),  # of a subtype
        ("nowhere", []),
    ],
)
def test_people_may_name_a_thing_a_label_or_a_type(office_engine, said, places):
    with office_engine.connect() as connection:
        see_map(connection, "office")
        assert sorted({e.place for e in find_entities(seen_by(connection), said)}) == places
