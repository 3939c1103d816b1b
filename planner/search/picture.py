"""The looks of a search over a floor plan: where the robot stands, and its camera's range.

The range ends at what is before the camera at its height; `Viewpoint.shows` says what is seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from planner.search.problem_builder import MapSearch, Viewpoint
from semmap.arrays import Floats

LOOK = "#1c5fb0"

AHEAD = 0.45
"""Metres from the robot to the number of a look: those from one pose differ in heading."""

RAYS = 60  # of the outline of a range


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
        most = max((chance for *_, chance in looks), default=0.0) or 1.0
        style: dict[str, Any] = {"color": "white", "weight": "bold", "fontsize": 6, "zorder": 13}
        style["bbox"] = {"boxstyle": "circle,pad=0.25", "fc": LOOK, "ec": "white", "lw": 0.6}
        for number, look, chance in looks:
            alpha = 0.06 + 0.3 * math.sqrt(chance / most)
            cone = Polygon(_range(search, look), closed=True)
            cone.set(facecolor=LOOK, edgecolor="none", alpha=alpha, zorder=6)
            axes.add_patch(cone)
            ahead = look.pose.yaw + look.aim.pan
            x, y = look.pose.x + AHEAD * math.cos(ahead), look.pose.y + AHEAD * math.sin(ahead)
            axes.text(x, y, str(number), ha="center", va="center", **style)

    return over


def _range(search: MapSearch, look: Viewpoint) -> Floats:
    """(N, 2) the outline of what a level camera sees from where it is, metres."""
    sight = search.sight
    eye, ahead = sight.eye(look.pose, look.aim), look.pose.yaw + look.aim.pan
    angles = ahead + np.linspace(-0.5, 0.5, RAYS) * sight.field_of_view
    rays = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(RAYS)])
    far = np.full(RAYS, sight.furthest)
    if search.space is not None:
        far *= search.space.free_shares(eye, eye + sight.furthest * rays)
    near = np.minimum(sight.nearest, far)
    outline: Floats = eye + np.concatenate([far[:, None] * rays, (near[:, None] * rays)[::-1]])
    return outline[:, :2]
