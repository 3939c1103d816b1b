"""Where an object probably is: a probability for each place, with the reasons."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from semmap.belief.occlusion import infer_with_occlusion
from semmap.belief.reader import read_columns, read_model
from semmap.found_rows import html_table
from semmap.query.snapshot import Snapshot


@dataclass(frozen=True, eq=False)
class BelievedPlaces(Mapping[str, float]):
    """The probability of each place, the most probable first; they sum to 1.

    `elsewhere` is no place of the map.

    Attributes
    ----------
    name : of the object or agent
    rows : `place`, `probability`, `prior`, `holder` of the place, `last_seen` there and
        `last_missed`
    at : the time of the belief; None for the present

    Examples
    --------
    >>> found = BelievedPlaces("mug", [{"place": "desk", "probability": 0.9}, {"place": "sink",
    ...                                                                        "probability": 0.1}])
    >>> found.best, found["sink"], dict(found)
    ('desk', 0.1, {'desk': 0.9, 'sink': 0.1})
    """

    name: str
    rows: list[dict[str, Any]]
    at: datetime | None = None

    @property
    def best(self) -> str:
        """The most probable place."""
        return next(iter(self))

    def as_json(self) -> dict[str, Any]:
        """The belief as plain values."""
        return {"name": self.name, "belief": self.rows}

    def revised(self, probability: Mapping[str, float]) -> BelievedPlaces:
        """Return the same places with other probabilities, in their order."""
        rows = [row | {"probability": probability[row["place"]]} for row in self.rows]
        rows.sort(key=lambda row: -row["probability"])
        return BelievedPlaces(self.name, rows, self.at)

    def __getitem__(self, place: str) -> float:
        """The probability of a place."""
        for row in self.rows:
            if row["place"] == place:
                return float(row["probability"])
        raise KeyError(place)

    def __iter__(self) -> Iterator[str]:
        """The names of the places, the most probable first."""
        return (row["place"] for row in self.rows)

    def __len__(self) -> int:
        """How many places there are."""
        return len(self.rows)

    def _repr_html_(self) -> str:
        return html_table(self.rows)


def belief_with_occlusion(
    seen: Snapshot, names: Sequence[str], at: datetime | None = None
) -> dict[str, dict[str, float]]:
    """Return the belief of each object, if the larger ones among them may hide the smaller ones.

    They have not moved since the first observation after the map was told where they are.
    `BeliefError` if a volume is unknown, or too many objects and places depend on each other.
    """
    columns, model = read_columns(seen, names, at), read_model(seen)
    probability = infer_with_occlusion(
        columns.prior, columns.observations, columns.mobility, columns.known_volume(), model=model
    )
    return {
        name: dict(zip(columns.places, row, strict=True))
        for name, row in zip(columns.objects, probability.tolist(), strict=True)
    }
