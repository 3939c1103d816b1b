"""Colours by semantic type: the colour of the type, or of its nearest supertype that has one."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping

INK = "#2b2f36"
PAPER = "#fbfaf7"
PATH = "#d6336c"

ROOMS: Mapping[str, str] = {
    "circulation_space": "#efece3",
    "foyer": "#f6ead0",
    "elevator_cabin": "#d5dbe6",
    "stairwell": "#e3ded6",
    "work_room": "#d3e4f1",
    "office": "#cfe2f3",
    "lab": "#d2ead9",
    "meeting_room": "#dcd7ef",
    "living_area": "#f7dedb",
    "living_room": "#f8ddd6",
    "dining_room": "#fbecc2",
    "bedroom": "#e5dcf1",
    "fitness_room": "#dfe9c9",
    "balcony": "#e4efdc",
    "kitchen": "#fce0c2",
    "restaurant": "#fbe6cd",
    "sanitary_room": "#cfeaec",
    "service_room": "#e2e2dc",
    "shop": "#f3e1ec",
    "care_room": "#d6ecec",
}
_OTHER_ROOMS = ("#dde7f0", "#e9e3d3", "#e0ecd9", "#efdfe2", "#e2dff0", "#d9ebe8")

OBJECTS: Mapping[str, str] = {  # the first that fits is taken: general types stand last
    "toilet": "#86b3c6",  # a fixture, though one sits on it
    "sofa": "#6f7fbf",
    "table": "#c08d57",
    "counter": "#b5a387",
    "seat": "#4f86b5",
    "bed": "#9a80bf",
    "carpet": "#dccbb0",
    "lamp": "#ecc44d",
    "picture": "#a97c9e",
    "mirror": "#a9c3d6",
    "plant": "#4f9d57",
    "kitchenware": "#e39b4b",
    "food": "#d9483b",
    "drink": "#c9662f",
    "appliance": "#5fa3a0",
    "electronics": "#56677d",
    "book": "#a3524a",
    "document": "#c4b89a",
    "tool": "#8b6f5c",
    "personal_thing": "#b56a8c",
    "sports_equipment": "#c77a45",
    "toy": "#e07a9b",
    "musical_instrument": "#7a5240",
    "vehicle": "#5f7f9f",
    "curtain": "#c9a6b5",
    "sign": "#d1b34a",
    "door_leaf": "#a87c50",
    "door_frame": "#8f8a82",
    "window": "#a9cfe0",
    "column": "#b9bcc2",
    "stair_flight": "#b8b2a6",
    "ramp_flight": "#b8b2a6",
    "floor": "#e9e4da",
    "ground": "#e4e2da",
    "person": "#e4572e",
    "animal": "#b98b57",
    "robot": "#e4572e",
    "agent": "#e4572e",
    "board": "#a9c3d6",
    "furnishing": "#b7a99a",
    "container": "#b58457",
    "fixture": "#86b3c6",
    "building_element": "#d3d4d6",
    "storage_furniture": "#8a9a5b",
    "furniture": "#b39a7d",
}
_OTHER_OBJECTS = "#a8a29a"

HIDDEN = {
    "ceiling",
    "roof",
    "beam",
    "wall",
    "floor",
    "ground",
    "window",
    "house",
    "building_shell",
    "door_leaf",
    "door_frame",
    "handle",
    "elevator_shaft",
    "column",
    "railing",
}
"""Types that a floor plan leaves out: parts of the building."""

STATES = {"open": "#3b6ea5", "closed": "#b07a1f", "locked": "#b3261e"}
"""Of doors."""

BOX_COLOURS = (
    "#e6194b",
    "#0082c8",
    "#f58231",
    "#3cb44b",
    "#911eb4",
    "#00a5a5",
    "#c2a800",
    "#e0409f",
    "#6b8e23",
    "#7a4b1e",
    "#3f51d5",
    "#c0392b",
    "#008080",
    "#8e44ad",
)

PART_COLOURS = ("#2e9e4f", "#d6372c", "#2f6fd0", "#e0a21b", "#8a4fc0", "#2aa3a3")
"""Colours of a robot's parts in their order: base green, arm red, pole blue, as in Figure 6."""


def family(types: Iterable[str]) -> str | None:
    """Return the first of an object's types that has a colour; None if none has."""
    known = set(types)
    found = next((t for t in OBJECTS if t in known), None)
    return "fixture" if found == "toilet" else found


def object_colour(types: Iterable[str]) -> str:
    """Return the colour of an object of these types."""
    return OBJECTS.get(family(types) or "", _OTHER_OBJECTS)


def room_colour(types: Iterable[str], name: str) -> str:
    """Return the colour of a room; if no type has one, it follows from the name."""
    for t in types:
        if t in ROOMS:
            return ROOMS[t]
    return _OTHER_ROOMS[zlib.crc32(name.encode()) % len(_OTHER_ROOMS)]
