"""Names of models and instances: the semantic type that they suggest, and unique names."""

from __future__ import annotations

import re
from collections.abc import Container
from functools import cache

from semmap.ingest.ontology.tbox import ontology_files, read_tbox

__all__ = ["guess_type", "unique_name", "words"]

TYPE_WORDS: dict[str, str] = {
    "air_conditioner": "airconditioner, aircon",
    "bathtub": "bath tub",
    "book": "books",
    "bookshelf": "book shelf, bookshelves",
    "ceiling_lamp": "ceiling light",
    "clock": "horologe",
    "door_leaf": "door",
    "kitchen_counter": "cooking bench, kitchen bench",
    "lamp": "light, spotlight",
    "monitor": "screen",
    "nightstand": "night stand",
    "plant": "flower",
    "range_hood": "rangehood, cooker hood",
    "refrigerator": "freezer",
    "shelf": "shelves",
    "sink": "basin",
    "toilet": "wc",
    "trash_can": "trash, trashcan, garbage, garbage can, dustbin",
    "utensils": "utensil",
    "wall": "walls",
}
"""Words in names of models for a type, beside its label and synonyms in the T-Box.

The model of a door is an object, its leaf; the door that a robot passes is a connector."""


def words(name: str) -> list[str]:
    """Return the words of a model's name, in lower case, without numbers and single letters.

    >>> words("aws_robomaker_residential_KitchenTable_01")
    ['aws', 'robomaker', 'residential', 'kitchen', 'table']
    """
    found = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)
    return [word.lower() for word in found if len(word) > 1]


def guess_type(name: str) -> str | None:
    """Return the semantic type of a model's name: of its longest known phrase, the last such.

    Known are the labels and synonyms of the T-Box's objects, and `TYPE_WORDS`. English puts the
    head of a compound last, so that a `DeskPortrait` is a picture.

    >>> guess_type("ChairA_01_001"), guess_type("DeskPortraitA_01"), guess_type("Holder_01")
    ('chair', 'picture', None)
    """
    phrases = _phrases()
    tokens = words(name)
    for length in range(max(map(len, phrases)), 0, -1):
        for start in range(len(tokens) - length, -1, -1):
            type_ = phrases.get(tuple(tokens[start : start + length]))
            if type_ is not None:
                return type_
    return None


@cache
def _phrases() -> dict[tuple[str, ...], str]:
    """The type that each phrase means."""
    known = {
        tuple(phrase.split()): type_
        for type_, phrases in TYPE_WORDS.items()
        for phrase in phrases.split(", ")
    }
    for record in read_tbox(ontology_files()):
        if record.kind == "object" and record.name != "object":
            for phrase in (record.label, *record.synonyms):
                known[tuple(words(phrase))] = record.name
    known.pop((), None)
    return known


def unique_name(name: str, taken: Container[str]) -> str:
    """Return `name`, with the first free suffix `_2`, `_3`, ... if it is taken.

    >>> unique_name("chair", {"chair", "chair_2"})
    'chair_3'
    """
    if name not in taken:
        return name
    number = 2
    while f"{name}_{number}" in taken:
        number += 1
    return f"{name}_{number}"
