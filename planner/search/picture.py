"""A search on the floor plan: from where the robot looks, in which order."""

from __future__ import annotations

import math
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.patches import Wedge

from planner.search.problem_builder import MapSearch
from planner.search.receding_horizon import Decision
from planner.search.viewpoints import Sight
from semmap.draw.floor_plan import floor_plan
from semmap.draw.view import StoreyView

VIEW = "#e4007c"


def search_picture(
    storey: StoreyView,
    search: MapSearch,
    decision: Decision,
    path: Path,
    *,
    sight: Sight | None = None,
    title: str = "",
    dpi: int = 180,
) -> Path:
    """Draw the looks of a search on a storey as numbered wedges; returns the path of the PNG.

    The darker a wedge, the more of the belief the look shows.
    """
    camera = sight or Sight()
    rooms = {room.name for room in storey.rooms}
    belief = search.belief[0]
    shown = search.problem.visible @ belief
    stops = [
        (number, search.viewpoints[k], float(shown[k]))
        for number, k in enumerate(dict.fromkeys(decision.tour), 1)
        if search.viewpoints[k].room in rooms
    ]

    def over(axes: Axes) -> None:
        most = max((chance for _, _, chance in stops), default=1.0)
        half = math.degrees(camera.field_of_view / 2)
        for number, view, chance in stops:
            at, yaw = (view.pose.x, view.pose.y), math.degrees(view.pose.yaw)
            alpha = 0.12 + 0.4 * math.sqrt(chance / most)
            axes.add_patch(
                Wedge(at, 2.0, yaw - half, yaw + half, color=VIEW, alpha=alpha, lw=0, zorder=6)
            )
            axes.text(  # inside of its wedge: looks from one pose differ in heading
                at[0] + 0.45 * math.cos(view.pose.yaw),
                at[1] + 0.45 * math.sin(view.pose.yaw),
                str(number),
                zorder=7,
                ha="center",
                va="center",
                fontsize=6,
                color="white",
                weight="bold",
                bbox={"boxstyle": "circle,pad=0.25", "fc": VIEW, "ec": "white", "lw": 0.6},
            )

    return floor_plan(storey, path, title=title, dpi=dpi, over=over)
