"""Names of models and instances: the semantic type that they suggest, and their uniqueness."""

from __future__ import annotations

import re
from collections.abc import Container

__all__ = ["guess_type", "unique_name", "words"]

TYPE_WORDS: dict[str, str] = {
    "air_conditioner": "air conditioner, airconditioner, aircon",
    "ball": "ball",
    "basket": "basket",
    "bathtub": "bathtub, bath tub",
    "bed": "bed",
    "bench": "bench",
    "bicycle": "bicycle, bike",
    "book": "book, books",
    "bookshelf": "bookshelf, book shelf, bookcase",
    "bottle": "bottle",
    "bowl": "bowl",
    "box": "box, crate",
    "cabinet": "cabinet, cupboard, sideboard",
    "camera": "camera",
    "can": "can, tin",
    "carpet": "carpet, rug",
    "ceiling": "ceiling",
    "chair": "chair, armchair, stool",
    "clock": "clock, horologe",
    "coffee_table": "coffee table",
    "column": "column, pillar",
    "computer": "computer, pc",
    "counter": "counter, countertop, worktop, cooking bench, kitchen bench",
    "cup": "cup, teacup",
    "curtain": "curtain, blind",
    "desk": "desk",
    "dining_table": "dining table",
    "dishwasher": "dishwasher",
    "door": "door",
    "dumbbell": "dumbbell",
    "elevator": "elevator, lift",
    "fire_extinguisher": "fire extinguisher",
    "floor": "floor",
    "fork": "fork",
    "ground": "ground, ground plane",
    "house": "house",
    "keyboard": "keyboard",
    "kitchen_table": "kitchen table",
    "knife": "knife",
    "lamp": "lamp, light, chandelier, spotlight",
    "laptop": "laptop, notebook",
    "microwave": "microwave",
    "mirror": "mirror",
    "monitor": "monitor, screen, display",
    "mug": "mug",
    "nightstand": "nightstand, night stand, bedside table",
    "oven": "oven",
    "phone": "phone, telephone",
    "picture": "picture, portrait, painting, poster",
    "pillow": "pillow, cushion",
    "plant": "plant, houseplant, potted plant, flower",
    "plate": "plate, dish",
    "printer": "printer",
    "quilt": "quilt, blanket",
    "range_hood": "rangehood, range hood, cooker hood",
    "refrigerator": "refrigerator, fridge, freezer",
    "roof": "roof",
    "shelf": "shelf, shelves, rack, bookshelves",
    "shoe_rack": "shoe rack",
    "sink": "sink, basin, washbasin",
    "sofa": "sofa, couch",
    "speaker": "speaker, loudspeaker",
    "spoon": "spoon",
    "stairs": "stair, stairs, staircase, steps",
    "stove": "stove, cooker, hob",
    "table": "table",
    "tablet": "tablet",
    "tableware": "tableware, crockery",
    "toilet": "toilet, wc",
    "trash_can": "trash, trash can, trashcan, garbage, garbage can, dustbin, bin, waste basket",
    "tray": "tray",
    "tv": "tv, television",
    "utensils": "utensil, utensils, cutlery",
    "vase": "vase",
    "wall": "wall, walls",
    "wardrobe": "wardrobe, closet",
    "washing_machine": "washing machine, washer",
    "whiteboard": "whiteboard, blackboard",
    "window": "window",
}
"""T-Box name: the words in a model's name that suggest it."""

_TYPE_OF = {
    tuple(phrase.split()): type_
    for type_, phrases in TYPE_WORDS.items()
    for phrase in phrases.split(", ")
}
_LONGEST = max(map(len, _TYPE_OF))


def words(name: str) -> list[str]:
    """The words of a model's name, in lower case, without numbers and single letters.

    >>> words("aws_robomaker_residential_KitchenTable_01")
    ['aws', 'robomaker', 'residential', 'kitchen', 'table']
    """
    found = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)
    return [word.lower() for word in found if len(word) > 1]


def guess_type(name: str) -> str | None:
    """The semantic type that a model's name suggests: its longest known phrase, or the last such.

    English puts the head of a compound last, so that a `DeskPortrait` is a picture.

    >>> guess_type("ChairA_01_001"), guess_type("DeskPortraitA_01"), guess_type("Holder_01")
    ('chair', 'picture', None)
    """
    tokens = words(name)
    for length in range(_LONGEST, 0, -1):
        for start in range(len(tokens) - length, -1, -1):
            type_ = _TYPE_OF.get(tuple(tokens[start : start + length]))
            if type_ is not None:
                return type_
    return None


def unique_name(name: str, taken: Container[str]) -> str:
    """`name`, or with the first suffix `_2`, `_3`, ... that is free.

    >>> unique_name("chair", {"chair", "chair_2"})
    'chair_3'
    """
    if name not in taken:
        return name
    number = 2
    while f"{name}_{number}" in taken:
        number += 1
    return f"{name}_{number}"
