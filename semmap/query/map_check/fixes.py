"""Moves that repair a finding: each is tried on a copy of its place, by the same rules."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from semmap.query.map_check.reader import CheckedEntity
from semmap.query.map_check.support import SupportedBuilding

REACH = 0.6
"""Metres beside an object within which its move can make or repair a fault."""

MOST_TRIALS = 200
"""Of one check; later findings get their moves when it is done again."""

Floats = NDArray[np.float64]
Offset = Sequence[float] | Floats
Named = frozenset[tuple[str, tuple[str, ...]]]
"""The kinds and names of findings."""


@dataclass(frozen=True)
class Moves:
    """The moves (dx, dy, dz) of an entity that may repair a finding, the best first."""

    entity: CheckedEntity
    by: Sequence[Offset]
    else_: str  # what a person does where none of them passes


Found = Iterator[tuple[tuple[str, ...], str, str | Moves]]
"""The entities, the sentence and the fix of each finding of a rule; moves are tried first."""


class Trials:
    """Tries moves in a building; `judge` returns the findings that a move can change."""

    def __init__(
        self, building: SupportedBuilding, judge: Callable[[SupportedBuilding], Named]
    ) -> None:
        self.building, self.judge, self.left = building, judge, MOST_TRIALS
        self._loose = [*building.objects, *building.agents, *building.doors]
        wide = np.array([(e.row["width"] or 0.0) / 2 for e in self._loose])[:, None]  # of a door
        self._low = np.array([e.low[:2] for e in self._loose]).reshape(-1, 2) - wide
        self._high = np.array([e.high[:2] for e in self._loose]).reshape(-1, 2) + wide
        loose = {*self._loose}
        self._fixed = [e for e in building.entities if e not in loose]

    def fix(self, kind: str, names: tuple[str, ...], moves: Moves) -> str:
        """Return the call of the first move after which the finding is gone and none is new."""
        for by in moves.by:
            if self.left and self._repairs(kind, names, moves.entity, np.asarray(by, float)):
                return _move_to(moves.entity, by)
            self.left -= bool(self.left)
        return f"by hand: {moves.else_}"

    def _repairs(
        self, kind: str, names: tuple[str, ...], entity: CheckedEntity, by: Floats
    ) -> bool:
        moving = [e for e in self.building.entities if _goes_with(e, entity)]
        moved = {e.name: _moved(e, by) for e in moving}
        around = self._around([*moving, *moved.values()])
        before = self.judge(SupportedBuilding([*self._fixed, *around]))
        now = [moved.get(e.name, e) for e in (*self._fixed, *around)]
        after = self.judge(SupportedBuilding(now))
        return not any(
            (what, who) == (kind, names) or not (what == kind and set(who) < set(names))
            for what, who in after - (before - {(kind, names)})
        )

    def _around(self, moving: Iterable[CheckedEntity]) -> list[CheckedEntity]:
        """What is above, below and beside places of a move."""
        met = np.zeros(len(self._loose), bool)
        for entity in moving:
            over = (self._high >= entity.low[:2] - REACH) & (self._low <= entity.high[:2] + REACH)
            met |= over.all(axis=1)
        return [e for e, near in zip(self._loose, met, strict=True) if near]


def _goes_with(entity: CheckedEntity, moved: CheckedEntity) -> bool:
    return entity.pose is not None and (entity is moved or moved in entity.chain)


def _moved(entity: CheckedEntity, by: Floats) -> CheckedEntity:
    assert entity.pose is not None
    x, y, z = entity.pose.translation + by
    outline = entity.outline
    return replace(
        entity,
        pose=entity.pose._replace(x=x, y=y, z=z),
        triangles=entity.triangles + by,
        hull=entity.hull + by,
        outline=None if outline is None else shapely.transform(outline, lambda xy: xy + by[:2]),
    )


def _move_to(entity: CheckedEntity, by: Offset) -> str:
    assert entity.pose is not None
    x, y, z = entity.pose.translation + np.asarray(by, float)
    return f"map[{entity.name!r}].move_to({x:.3f}, {y:.3f}, {z:.3f})"
