import itertools

from matplotlib.colors import to_rgb

from semmap.draw.palette import BOX_COLOURS, OBJECTS, ROOMS, family, object_colour, room_colour


def test_all_colours_are_valid():
    for colour in (*OBJECTS.values(), *ROOMS.values(), *BOX_COLOURS):
        assert len(to_rgb(colour)) == 3


def test_boxes_of_neighbouring_rooms_differ_clearly():
    for a, b in itertools.combinations(BOX_COLOURS, 2):
        assert max(abs(x - y) for x, y in zip(to_rgb(a), to_rgb(b), strict=True)) > 0.12


def test_the_nearest_type_with_a_colour_decides():
    assert family(("potted_plant", "furnishing", "plant", "object")) == "plant"
    assert family(("tv_cabinet", "support_furniture", "storage_furniture")) == "storage_furniture"
    assert family(("toilet", "seat", "fixture")) == "fixture"
    assert family(("unheard_of",)) is None
    assert object_colour(("desk", "table")) == OBJECTS["table"]


def test_a_room_without_a_known_type_keeps_its_colour():
    assert room_colour(("kitchen", "room"), "k") == ROOMS["kitchen"]
    assert room_colour((), "room7") == room_colour(("room",), "room7")
