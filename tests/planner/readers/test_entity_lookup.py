import pytest
import shapely

import semmap
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


def test_similar_names_may_differ_in_their_first_letters(database):
    with semmap.connect(database) as db:
        place = db.create_map("villa")
        for number in range(30):
            place.add_room(f"stanza{number}", shapely.box(number, 0, number + 1, 1))
        place.add_object("bicchiere", size=(0.1, 0.1, 0.1), pose=(0.5, 0.5, 0))
        with pytest.raises(LookupError, match=r"named picchiere; did you mean bicchiere\?"):
            place.route("stanza0", "picchiere")
        with pytest.raises(LookupError, match="named qqq; `semmap ls` lists the names"):
            place.route("stanza0", "qqq")
