"""The semantic types that names of models and instances suggest."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np

from semmap.geometry.pose import IDENTITY
from semmap.ingest.ontology.tbox import own_tbox
from semmap.ingest.world import Entry, Kind

GUESS = "type_guess"
"""The property with the type and the confidence of a guess."""

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
    "ramp_flight": "ramp",
    "range_hood": "rangehood, cooker hood",
    "refrigerator": "freezer",
    "shelf": "shelves",
    "sink": "basin",
    "stair_flight": "stairs, staircase, stair, stairway",
    "toilet": "wc",
    "trash_can": "trash, trashcan, garbage, garbage can, dustbin",
    "utensils": "utensil",
    "wall": "walls",
}
"""Words in names of models for a type, beside its label and synonyms in the T-Box.

The models of a door and of stairs are objects; those that a robot passes are connectors."""

TRAILING = frozenset(
    word
    for words in (
        "model mesh visual collision object instance copy clone new old static",
        "left right front back top bottom open closed",
        "short long tall low high small medium med large big mini round square single double",
        "wood wooden metal plastic leather steel dark",
        "black white grey gray red green blue brown yellow",
    )
    for word in words.split()
)
"""Words after the head of a name that describe it."""

OTHERS = frozenset({("elevator", "car"), ("lift", "car"), ("cable", "car")})
"""Phrases for which the T-Box's objects have no type, although they have one for the last word."""

SIZES: dict[str, tuple[float, float, float]] = {
    "floor": (1.0, 0.0, 0.5),
    "ground": (1.0, 0.0, 0.5),
    "ceiling": (1.0, 0.0, 0.5),
    "carpet": (0.3, 0.0, 0.15),
    "stair_flight": (0.4, 0.3, 10.0),
    "ramp_flight": (0.4, 0.0, 3.0),
    "car": (1.0, 0.9, 2.6),
    "bus": (1.5, 2.0, 4.5),
    "truck": (1.2, 1.2, 4.5),
}
"""Least width, least and largest height of what robots drive on, and of vehicles, metres.

A wrong guess of the former would take an obstacle off the costmap: a floor is flat, wide and low.
"""


def words(name: str) -> list[str]:
    """Return the words of a name, in lower case, without numbers, ordinals and single letters.

    Letters are without their accents, as in many names of files.

    >>> words("aws_robomaker_residential_KitchenTable_01"), words("Kühlschrank")
    (['aws', 'robomaker', 'residential', 'kitchen', 'table'], ['kuhlschrank'])
    """
    letters = unicodedata.normalize("NFKD", name.replace("ß", "ss"))
    name = "".join(letter for letter in letters if not unicodedata.combining(letter))
    name = re.sub(r"\d(st|nd|rd|th)(?![a-z])", "", name)
    found = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)
    return [word.lower() for word in found if len(word) > 1]


SURE = 0.8
"""The confidence from which a guess is not called uncertain."""


@dataclass(frozen=True)
class TypeGuess:
    """A type that a name suggests: whole phrases (0.9) rank over endings (0.8) and words (0.6)."""

    type: str
    confidence: float


def guess_type(name: str, kind: Kind = "object") -> TypeGuess | None:
    """Return the type that the longest known phrase at the end of a name means.

    Known are the labels and synonyms of the T-Box's types of a kind and, of objects, `TYPE_WORDS`.
    English puts the head of a compound last: a `DeskPortrait` is a picture, and a `floor_2_pump` is
    not a floor. Words that only describe (`TRAILING`) may follow, and so may the room of an object.

    >>> guess_type("DeskPortraitA_01"), guess_type("floor_2_pump"), guess_type("chair_left").type
    (TypeGuess(type='picture', confidence=0.6), None, 'chair')
    >>> guess_type("sofa_living_room").type
    'sofa'
    """
    phrases = _phrases(kind)
    tokens = words(name)
    last = len(tokens)
    while last > 0:
        for start in range(last):
            phrase = tuple(tokens[start:last])
            if phrase in OTHERS:
                return None
            if phrase in phrases:
                alone = start == 0 and last == len(tokens)
                return TypeGuess(phrases[phrase], 0.9 if alone else 0.8 if len(phrase) > 1 else 0.6)
        last -= _describing(tokens[:last], kind)
    return None


def _describing(tokens: Sequence[str], kind: Kind) -> int:
    """Return how many words at the end of a name only describe; all where the last is unknown."""
    if tokens[-1] in TRAILING:
        return 1
    rooms = _phrases("room") if kind == "object" else {}
    lengths = (
        len(tokens) - start for start in range(len(tokens)) if tuple(tokens[start:]) in rooms
    )
    return next(lengths, len(tokens))


def give_type(entry: Entry, names: Iterable[str]) -> None:
    """Give an entry the type that the first of some names suggests and its size allows."""
    guesses = [guess for guess in map(guess_type, names) if guess is not None]
    type_ = next((guess.type for guess in guesses if _fits(entry, guess.type)), None)
    if type_ is not None:
        sure = max(guess.confidence for guess in guesses if guess.type == type_)
        entry.type = type_
        entry.properties[GUESS] = {"type": type_, "confidence": sure}


def _fits(entry: Entry, type_: str) -> bool:
    """Return whether the size of an entry's meshes is one that a type can have."""
    meshes = [shape.mesh for shape in entry.shapes if shape.mesh is not None]
    if type_ not in SIZES or not meshes:
        return True
    corners = np.array([c for mesh in meshes for c in product(*mesh.bounds.T)])
    x, y, height = np.ptp((entry.pose or IDENTITY).apply(corners), axis=0)
    least, lowest, highest = SIZES[type_]
    return bool(min(x, y) >= least and lowest <= height <= highest)


@cache
def _phrases(kind: Kind) -> dict[tuple[str, ...], str]:
    """The type that each phrase means."""
    known = {
        tuple(phrase.split()): type_
        for type_, phrases in (TYPE_WORDS.items() if kind == "object" else ())
        for phrase in phrases.split(", ")
    }
    for record in own_tbox():
        if record.kind == kind and record.name != kind:
            for phrase in (record.label, *record.synonyms):
                known[tuple(words(phrase))] = record.name
    known.pop((), None)
    return known
