"""The looks of a search over a floor plan: where the robot stands, and its camera's range.

Walls and furniture may hide a part of the range: `Viewpoint.shows` says what is seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.patches import Wedge

from planner.search.problem_builder import Viewpoint
from planner.search.viewpoints import Sight

LOOK = "#1c5fb0"

FIRST, FADES, LAST = 0.3, 0.85, 0.06
"""How opaque the first look is, by how much each later one less, and at least."""


def looks_over(looks: Sequence[tuple[int, Viewpoint]], sight: Sight) -> Callable[[Axes], None]:
    """Return what draws looks with their numbers; for `over` of `floor_plan`, metres."""

    numbers: dict[tuple[float, float], list[str]] = {}
    for number, look in looks:
        numbers.setdefault((look.pose.x, look.pose.y), []).append(str(number))

    def over(axes: Axes) -> None:
        for number, look in looks:
            pose, half = look.pose, math.degrees(sight.field_of_view) / 2
            ahead, deep = math.degrees(pose.yaw), sight.furthest - sight.nearest
            ends = ahead - half, ahead + half
            cone = Wedge((pose.x, pose.y), sight.furthest, *ends, width=deep)
            cone.set(
                facecolor=LOOK,
                edgecolor="none",
                alpha=max(LAST, FIRST * FADES ** (number - 1)),
                zorder=6,
            )
            axes.add_patch(cone)
        style: dict[str, Any] = {"color": "white", "weight": "bold", "zorder": 13}
        style["bbox"] = {"boxstyle": "round,pad=0.25,rounding_size=0.6", "fc": LOOK, "ec": "white"}
        for (x, y), told in numbers.items():
            axes.text(x, y, ", ".join(told), ha="center", va="center", fontsize=7, **style)

    return over
