"""The looks of a search over a floor plan: where the robot stands, and its camera's range.

Walls and furniture may hide a part of the range: `Viewpoint.shows` says what is seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.patches import Wedge

from planner.search.problem_builder import MapSearch

LOOK = "#1c5fb0"

AHEAD = 0.45
"""Metres from the robot to the number of a look: those from one pose differ in heading."""


def looks_over(
    search: MapSearch, tour: Sequence[int], rooms: Collection[str]
) -> Callable[[Axes], None]:
    """Return what draws the looks in some rooms, for `over` of `floor_plan`; axes are metres.

    They have their numbers in the tour of viewpoints, which counts each once. The darker the range
    of a look, the more of the belief it shows.
    """
    shown = search.problem.visible @ search.belief[0]
    looks = [
        (number, search.viewpoints[k], float(shown[k]))
        for number, k in enumerate(dict.fromkeys(tour), 1)
        if search.viewpoints[k].room in rooms
    ]

    def over(axes: Axes) -> None:
        sight = search.sight
        most = max((chance for *_, chance in looks), default=0.0) or 1.0
        half, deep = math.degrees(sight.field_of_view) / 2, sight.furthest - sight.nearest
        style: dict[str, Any] = {"color": "white", "weight": "bold", "fontsize": 6, "zorder": 13}
        style["bbox"] = {"boxstyle": "circle,pad=0.25", "fc": LOOK, "ec": "white", "lw": 0.6}
        for number, look, chance in looks:
            ahead, alpha = look.pose.yaw + look.aim.pan, 0.06 + 0.3 * math.sqrt(chance / most)
            at, yaw = (look.pose.x, look.pose.y), math.degrees(ahead)
            cone = Wedge(at, sight.furthest, yaw - half, yaw + half, width=deep)
            cone.set(facecolor=LOOK, edgecolor="none", alpha=alpha, zorder=6)
            axes.add_patch(cone)
            x, y = at[0] + AHEAD * math.cos(ahead), at[1] + AHEAD * math.sin(ahead)
            axes.text(x, y, str(number), ha="center", va="center", **style)

    return over
