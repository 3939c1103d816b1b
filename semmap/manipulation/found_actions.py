"""The answer to a question about actions: grasps, places or pushes of objects."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from semmap.found_rows import FoundRows

if TYPE_CHECKING:
    from semmap.manipulation.arm_motions import ArmMotion


@dataclass(frozen=True)
class FoundActions(FoundRows):
    """Actions as of `actions_on`, the best first; `generated` are entities that had none before."""

    generated: list[str] = field(default_factory=list)
    motion: ArmMotion | None = None
