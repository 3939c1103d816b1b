"""A belief over the floor plan: the warmer a place, the more probable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib.patheffects as effects
import shapely
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Curve

from semmap.belief.places import Place
from semmap.belief.store import ELSEWHERE
from semmap.draw.floor_plan import floor_plan
from semmap.draw.view import StoreyView

__all__ = ["heat_map"]

LEAST_SHOWN = 0.005
"""A place below this probability is not coloured."""

LEAST_WRITTEN = 0.02


def heat_map(
    storey: StoreyView,
    places: Sequence[Place],
    belief: Mapping[str, float],
    path: Path | str,
    *,
    name: str = "",
    dpi: int = 200,
) -> Path:
    """Draw where an object probably is, and save the picture as PNG; return its path.

    Parameters
    ----------
    storey
        The plan below.
    places
        Those of the storey are coloured.
    belief
        Probabilities by names of places, as `semmap.belief.store.read_belief` returns them.
    name
        Of the object, for the title.
    """
    colours = colormaps["YlOrRd"]
    most = max([p for place, p in belief.items() if place != ELSEWHERE] or [1.0])
    shown = [
        (belief.get(place.name, 0.0), place)
        for place in places
        if place.footprint is not None and belief.get(place.name, 0.0) >= LEAST_SHOWN
    ]
    shown.sort(key=lambda found: found[1].kind != "room")  # furniture over its room

    def over(axes: Axes) -> None:
        for probability, place in shown:
            level = probability / most if most else 0.0
            room = place.kind == "room"
            for outline in shapely.get_parts(place.footprint):
                rings = [outline.exterior, *outline.interiors]
                curve = Curve.make_compound_path(
                    *(Curve(shapely.get_coordinates(ring), closed=True) for ring in rings)
                )
                axes.add_patch(
                    PathPatch(
                        curve,
                        fc=colours(0.15 + 0.85 * level),
                        ec="#7a1f10" if not room else "none",
                        lw=0.8,
                        alpha=0.45 if room else 0.85,
                        zorder=5.0 if not room else 1.5,
                    )
                )
        for probability, place in shown:
            if probability < LEAST_WRITTEN:
                continue
            middle = place.footprint.representative_point()  # type: ignore[union-attr]
            axes.text(
                middle.x,
                middle.y,
                f"{100 * probability:.0f} %",
                ha="center",
                va="center",
                fontsize=8,
                weight="bold",
                color="#3a0d05",
                zorder=12,
                path_effects=[effects.withStroke(linewidth=2.2, foreground="white")],
            )

    here = sum(belief.get(place.name, 0.0) for place in places)
    title = (
        f"{storey.name}: where {name or 'the object'} probably is "
        f"({100 * here:.0f} % on this storey, {100 * belief.get(ELSEWHERE, 0.0):.0f} % elsewhere)"
    )
    return floor_plan(storey, path, title=title, dpi=dpi, over=over)
