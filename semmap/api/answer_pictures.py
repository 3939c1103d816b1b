"""Pictures of answers of a map, over its floor plans or in its scene; `Map.draw` chooses one."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import cycle
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from semmap.draw.picture import Picture

if TYPE_CHECKING:
    from semmap.api.map import Map
    from semmap.api.map_results import ObjectSearch
    from semmap.arrays import Floats
    from semmap.belief.believed_places import BelievedPlaces
    from semmap.draw.view import ObjectView, StoreyView
    from semmap.geometry.mesh import Mesh

FIELD_COLOURS = ("#d6336c", "#1c7ed6", "#e8a200", "#2b8a3e", "#7048e8", "#0b7285", "#a61e4d")
"""Of the sets of voxels, in their order; then these again."""

MOST_SETS = 20
"""The most sets of voxels that the legend names."""

MOST_ROWS, MOST_VALUES = 2_000_000, 1_000
"""The most rows of an answer that are drawn, and the most sets of voxels."""

MOST_GRASPS = 50
"""The most grasps that are drawn, the best."""

OPAQUE = 100_000
"""Sets of more voxels are drawn as tinted air, through which the others are seen."""

AROUND = 0.6
"""Metres from an object within which others are drawn with its grasps."""

FINGER, ROD = 0.05, 0.003
"""Length of a fork's fingers and thickness of its rods, metres."""


def plan_notes(view: StoreyView) -> list[str]:
    """What the plan of a storey does not show, a sentence for each reason."""
    from semmap.draw.floor_plan import left_out
    from semmap.query.geometry_notes import listed

    return [
        f"{view.name}: {len(names)} {'object is' if len(names) == 1 else 'objects are'} {reason}, "
        f"and not drawn: {listed(names)}"
        for reason, names in left_out(view).items()
    ]


def belief_picture(map: Map, about: str | BelievedPlaces, storey: str | None) -> Picture:
    """A heat map of where a thing probably is; by default on the storey of the best place."""
    from semmap.belief.heat_map import heat_map
    from semmap.belief.reader import read_places
    from semmap.belief.store.beliefs import things_named

    belief = map.where(about) if isinstance(about, str) else about
    with map.snapshot() as seen:
        things = things_named(seen, belief.name)
        of_things = [place for thing in things for place in read_places(seen, thing)]
    places = {place.name: place for place in of_things}.values()
    on_storeys = [place for place in places if place.storey]
    best = max(on_storeys, key=lambda place: belief.get(place.name, 0.0), default=None)
    view = _views(map, storey or (best.storey if best else None))[0]
    here = [place for place in on_storeys if place.storey == view.name] or [*places]
    others = {each.storey: 0.0 for each in on_storeys if each.storey != view.name}
    for each in on_storeys:
        if each.storey in others:
            others[each.storey] += belief.get(each.name, 0.0)
    notes = [
        f"{chance:.0%} is on {other}, another storey"
        for other, chance in others.items()
        if chance >= 0.005
    ]
    return Picture.drawn(lambda path: heat_map(view, here, belief, path, name=belief.name), *notes)


def search_picture(search: ObjectSearch, storey: str | None) -> Picture:
    """The looks of a search, in their order, over its belief, on each storey that has some."""
    from planner.search.picture import looks_over
    from semmap.belief.heat_map import heat_map
    from semmap.belief.reader import read_places

    map = cast("Map", search.map)
    with map.snapshot() as seen:
        places = read_places(seen, search.name)

    def picture(view: StoreyView) -> Picture:
        rooms = {room.name for room in view.rooms}
        here = [place for place in places if place.storey == view.name] or places
        over = looks_over(search.problem, search.decision.tour, rooms)
        return Picture.drawn(
            lambda path: heat_map(view, here, search.belief, path, name=search.name, over=over)
        )

    looked = {look.room for look in search.tour}
    views = _views(map, storey)
    shown = [view for view in views if looked & {room.name for room in view.rooms}]
    if storey and not looked & {room.name for view in views for room in view.rooms}:
        raise LookupError(f"no look for {search.name} is on {storey}")
    if not looked:
        raise LookupError(f"no look for {search.name} is worth its time: draw its belief")
    return Picture.stacked(picture(view) for view in shown)


def field_picture(map: Map, query: str, storey: str | None) -> Picture:
    """The voxels that answer a query, or all of a property, in the scene; a colour for each set.

    Those of a property are coarser where they are too many.
    """
    from matplotlib.colors import to_rgb

    from semmap.draw.fields import FieldView, fields_picture
    from semmap.draw.palette import HIDDEN, object_colour

    text, fields = query, map.fields
    if re.fullmatch(r"\w+", query):
        text = f"SELECT ?v ?o {{ ?v :{query} ?o }}"
        counts = f"SELECT ?o (COUNT(?v) AS ?n) {{ ?v :{query} ?o }} GROUP BY ?o"
        count = sum(row[-1] for row in fields.query(counts).rows)
        while count > MOST_ROWS:
            fields, count = fields.with_voxel_size(2 * fields.voxel_size), count / 7
    answer = fields.query(text, limit=MOST_ROWS)
    if answer.total > len(answer):
        raise ValueError(
            f"{answer.total} rows answer {query}, and {MOST_ROWS} are drawn at most: ask for fewer,"
            " such as the voxels of one room: SELECT ?v { ?v :inRoom :kitchen }"
        )
    views = _views(map, storey)
    low, high = _levels(map, views[0]) if storey else (-np.inf, np.inf)
    sets: dict[str, set[Any]] = {}
    named: set[str] = set()
    for row in answer.rows:
        others = [str(v) for v in row if v is not None and not isinstance(v, tuple)]
        centres = [value for value in row if isinstance(value, tuple) and low <= value[2] < high]
        if centres:
            named.update(others)
            sets.setdefault(" ".join(others), set()).update(centres)
    if len(sets) > MOST_VALUES:
        raise ValueError(f"{query} has {len(sets)} values, each of which would have a colour")
    if not sets:
        where = f" on {storey}" if storey else ""
        raise LookupError(f"no voxel{where} answers {query}: there is nothing to draw")
    size = fields.voxel_size
    shown = [
        FieldView(
            np.floor(np.array([*centres]) / size).astype(np.int32),
            size,
            colour,
            of or query,
            1.0 if len(centres) <= OPAQUE else 0.2,
        )
        for (of, centres), colour in zip(sorted(sets.items()), cycle(FIELD_COLOURS))
    ]
    more = len(shown) - MOST_SETS
    if more > 0:
        shown[MOST_SETS - 1] = replace(shown[MOST_SETS - 1], label=f"... and {more + 1} more")
        shown[MOST_SETS:] = [replace(each, label="") for each in shown[MOST_SETS:]]
    coarse = "" if size == map.fields.voxel_size else f", voxels of {size:g} m"
    unknown = f"\n{len(answer.left_out)} entities have no voxels" if answer.left_out else ""
    things = [
        (each.mesh.triangles, 0.4 * np.array(to_rgb(object_colour(each.types))) + 0.6)
        for view in views
        for each in view.objects
        if each.mesh is not None and each.name not in named  # its voxels stand for it
        if not (HIDDEN | {"wall", "window"}) & set(each.types)
    ]
    triangles = np.concatenate([np.zeros((0, 3, 3)), *(faces for faces, _ in things)])
    colours = [np.tile(colour, (len(faces), 1)) for faces, colour in things]
    painted = np.concatenate([np.zeros((0, 3)), *colours])
    return Picture.drawn(
        lambda path: fields_picture(triangles, painted, shown, path, title=query + coarse + unknown)
    )


def grasps_picture(map: Map, name: str) -> Picture:
    """The stored grasps of an object as forks, the likelier the greener, among what is near.

    Of a type, those of the object with the best grasp.
    """
    from matplotlib.colors import hsv_to_rgb, to_hex

    from semmap.draw.scene3d import scene3d
    from semmap.draw.view import ObjectView, StoreyView
    from semmap.geometry.pose import Pose

    found = map.grasps(name, stored=True, check=False, limit=MOST_GRASPS)
    if not found:
        why = "; ".join(found.problems) or "no grasp is stored"
        raise LookupError(f"{name}: {why}: semmap grasp {name} looks for some")
    rows = [row for row in found if row["entity"] == found[0]["entity"]]
    forks = [
        ObjectView(
            "grasp",
            (),
            grasp_fork(row["width"] or FINGER).moved(Pose(*row["pose"])),
            colour=to_hex(tuple(hsv_to_rgb([0.33 * (row["expected"] or 0.0), 0.85, 0.75]))),
        )
        for row in reversed(rows)
    ]
    near = np.concatenate([fork.mesh.vertices for fork in forks if fork.mesh is not None])
    views = _views(map, None)
    things = [each for view in views for each in view.objects if _is_near(each, near)]
    floor = float(near[:, 2].min())
    best = "best " if len(found) == MOST_GRASPS else ""
    told = f"{rows[0]['entity']}: {best}{len(forks)} grasps, the likelier the greener"
    scene = StoreyView(name, floor, objects=[*things, *forks])
    return Picture.drawn(
        lambda path: scene3d([scene], path, title=told, boxes=False, cut=9.0, width=1400)
    )


def grasp_fork(width: float) -> Mesh:
    """A fork of two fingers in the grasp frame: they move along z, and close along x."""
    from semmap.geometry.mesh import box_mesh, join

    half = width / 2
    rods: Sequence[tuple[tuple[float, float, float], tuple[float, float, float]]] = (
        ((-half, 0, -FINGER), (-half, 0, 0)),
        ((half, 0, -FINGER), (half, 0, 0)),
        ((-half, 0, -FINGER), (half, 0, -FINGER)),
        ((0, 0, -2 * FINGER), (0, 0, -FINGER)),
    )
    grown = [(np.array(low) - ROD / 2, np.array(high) + ROD / 2) for low, high in rods]
    return join([box_mesh(tuple(low), tuple(high)) for low, high in grown])


def _views(map: Map, storey: str | None) -> list[StoreyView]:
    views = map.views(storey)
    if not views:
        raise LookupError(f"the map {map.name} has nothing to draw: import a world file")
    return views


def _levels(map: Map, view: StoreyView) -> tuple[float, float]:
    """From where to where, metres, a storey reaches: up to the floor of the next one."""
    above = [each.elevation for each in map.views() if each.elevation > view.elevation]
    return view.elevation - 0.3, min(above, default=np.inf) - 0.3


def _is_near(each: ObjectView, points: Floats) -> bool:
    """Whether the box of an object is within reach of points, and small enough to be shown."""
    if each.mesh is None:
        return False
    low, high = each.mesh.bounds
    inside = (points > low - AROUND).all(axis=1) & (points < high + AROUND).all(axis=1)
    return bool(inside.any()) and float(np.max((high - low)[:2])) < 4.0
