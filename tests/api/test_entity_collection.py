"""The entities of a map by kinds."""

from __future__ import annotations

import pytest

import semmap


def test_collections_have_the_entities_of_their_kind_by_name(flat: semmap.Map) -> None:
    flat.add_region("wet", [(5, 2), (6, 2), (6, 3), (5, 3)])
    flat.add_agent("robot1", size=(0.5, 0.5, 1), pose=(1, 0.6, 0))
    found = {
        "rooms": ["hall", "kitchen"],
        "objects": ["desk4", "mug7"],
        "doors": ["door1"],
        "storeys": ["ground"],
        "regions": ["wet"],
        "agents": ["robot1"],
    }
    for word, names in found.items():
        collection = getattr(flat, word)
        assert [entity.name for entity in collection] == names
        assert len(collection) == len(names)
        assert all(name in collection and flat[name] in collection for name in names)
        assert [collection[name] for name in names] == [flat[name] for name in names]
        counted = word.removesuffix("s") if len(names) == 1 else word
        assert repr(collection) == f"<{len(names)} {counted}: {', '.join(names)}>"
    assert sum(len(getattr(flat, word)) for word in found) == len(flat)
    assert "desk4" not in flat.rooms
    assert flat["desk4"] not in flat.rooms
    assert isinstance(flat.doors["door1"], semmap.Door)


def test_a_name_that_is_not_there_names_similar_ones_of_the_kind(flat: semmap.Map) -> None:
    with pytest.raises(LookupError, match=r"the map has no room kichen; did you mean kitchen\?"):
        flat.rooms["kichen"]
    with pytest.raises(LookupError, match="the map has no object kitchen"):
        flat.objects["kitchen"]
    with pytest.raises(LookupError, match=r"the map has no region x; Map\.regions has them all"):
        flat.regions["x"]


def test_a_long_collection_shows_its_first_names(flat: semmap.Map) -> None:
    assert repr(flat.agents) == "<0 agents>"
    for number in range(7):
        flat.add_agent(f"robot{number}", pose=(1 + 0.1 * number, 0.6, 0))
    assert repr(flat.agents) == "<7 agents: robot0, robot1, robot2, robot3, robot4, ...>"
