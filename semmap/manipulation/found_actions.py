"""The answer to a question about actions: grasps, places or pushes of objects."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from semmap.found_rows import FoundRows

if TYPE_CHECKING:
    from semmap.manipulation.arm_motions import ArmMotion


@dataclass(frozen=True)
class FoundActions(FoundRows):
    """Actions on objects, the best first.

    Attributes
    ----------
    rows : as `semmap.manipulation.reader.actions_on` returns them; the first one is that of the
        motion, where one was planned
    problems : why there is none for some objects
    generated : names of entities whose models had no stored action of the kind before
    motion : of a robot's arm that does the first action; None where none was planned or found
    """

    generated: list[str] = field(default_factory=list)
    motion: ArmMotion | None = None
