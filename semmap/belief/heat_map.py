"""A belief over the floor plan: the warmer a place, the more probable."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.patheffects as effects
import shapely
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Curve

from semmap.belief.places import BeliefPlace
from semmap.belief.store.beliefs import ELSEWHERE
from semmap.draw.floor_plan import FLAT, floor_plan, middle_of_object, shown_objects
from semmap.draw.view import StoreyView

LEAST_SHOWN = 0.005
"""A place below this probability is not coloured."""

LEAST_WRITTEN = 0.02
"""A place below this probability has no number."""

PALE = "#f4f4f1"


def heat_map(
    storey: StoreyView,
    places: Sequence[BeliefPlace],
    belief: Mapping[str, float],
    path: Path | str,
    *,
    name: str = "",
    dpi: int = 200,
    over: Callable[[Axes], None] | None = None,
) -> Path:
    """Draw where an object probably is, and save the picture; return its path.

    Places of the storey are coloured by their probabilities; `name` is for the title, and `over`
    draws more, as for `floor_plan`.
    """
    colours = colormaps["YlOrRd"]
    most = max([p for place, p in belief.items() if place != ELSEWHERE and p > 0] or [1.0])
    shown = [
        (belief.get(place.name, 0.0), place)
        for place in places
        if place.footprint is not None and belief.get(place.name, 0.0) >= LEAST_SHOWN
    ]
    shown.sort(key=lambda found: found[1].kind != "room")  # furniture over its room

    furniture = [o for o in shown_objects(storey) if not FLAT & set(o.types)]

    def places_over(axes: Axes) -> None:
        for room in storey.rooms:
            _fill(axes, room.outline, fc=PALE, ec="none", zorder=1.2)
        for each in furniture:
            if each.footprint is not None:
                _fill(axes, each.footprint, fc="#e6e6e1", ec="#bdbdb6", lw=0.7, zorder=3.2)
        for probability, place in shown:
            room_like = place.kind == "room"
            _fill(
                axes,
                place.footprint,
                fc=colours(0.1 + 0.9 * probability / most),
                ec="none" if room_like else "#7a1f10",
                lw=0.8,
                zorder=1.5 if room_like else 5.0,
            )
            if probability >= LEAST_WRITTEN:
                label = "" if room_like else f"{place.name}\n"
                _write(axes, place.footprint, f"{label}{100 * probability:.0f} %", room_like)
        if over is not None:
            over(axes)

    here = sum(belief.get(place.name, 0.0) for place in places)
    nowhere = belief.get(ELSEWHERE, 0.0)
    others = sum(p for p in belief.values() if p > 0) - here - nowhere
    title = (
        f"{storey.name}: where {name or 'the object'} probably is ({100 * here:.0f} % on this "
        f"storey, {100 * max(others, 0):.0f} % on others, {100 * nowhere:.0f} % in no known place)"
    )
    plain = replace(storey, objects=[replace(o, types=()) for o in furniture], regions=[])
    return floor_plan(plain, path, title=title, dpi=dpi, over=places_over)


def _fill(axes: Axes, area: shapely.Geometry, **style: Any) -> None:
    for outline in shapely.get_parts(area):
        rings = [outline.exterior, *outline.interiors]
        curves = (Curve(shapely.get_coordinates(ring), closed=True) for ring in rings)
        axes.add_patch(PathPatch(Curve.make_compound_path(*curves), **style))


def _write(axes: Axes, area: shapely.Geometry, text: str, below: bool) -> None:
    """A text in the middle of an area, or below the name that the plan has there."""
    middle = area.representative_point() if below else middle_of_object(area)
    axes.annotate(
        text,
        (middle.x, middle.y),
        xytext=(0, -11 if below else 0),
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=7.5,
        weight="bold",
        color="#3a0d05",
        zorder=12,
        path_effects=[effects.withStroke(linewidth=2.2, foreground="white")],
    )
