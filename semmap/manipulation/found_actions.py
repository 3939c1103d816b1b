"""The answer to a question about actions: grasps, places or pushes of objects."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from semmap.found_rows import FoundRows

if TYPE_CHECKING:
    from semmap.manipulation.arm_motions import ArmMotion


@dataclass(frozen=True)
class FoundActions(FoundRows):
    """Actions, the best first: rows with the keys that `Map.grasps` names."""

    generated: list[str] = field(default_factory=list)  # entities that had no actions before
    motion: ArmMotion | None = None  # of a robot, where `plan` asked for it
