"""Regions of a map: drawn, or found in the geometry of rooms and objects."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Any, Literal

from semmap.api.checked import EntityName, Properties
from semmap.api.map_questions import MapQuestions, aware
from semmap.finite_number import finite_numbers

if TYPE_CHECKING:
    import shapely

    from semmap.found_rows import FoundRows


class MapRegions(MapQuestions):
    """The part of `Map` about regions."""

    def find_regions(
        self,
        sort: Literal["surfaces", "floor", "observation"],
        names: EntityName | Sequence[EntityName] = (),
        *,
        type: str | None = None,
        near: float = 0.5,
        far: float = 1.2,
        headroom: float = 2.0,
        max_step: float = 0.03,
    ) -> FoundRows:
        """Find regions in the geometry of rooms or objects, and store them.

        A region of the same name is updated; its room or object holds it.

        Returns rows as of `list_regions`; `problems` has the reasons for those of the type that
        have no such region.

        Parameters
        ----------
        sort : ``surfaces`` where other objects can stand; ``floor``, the walkable floor of a room
            as it is now; ``observation``, the ring around an object from which to observe it
        names : rooms for ``floor``, else objects
        type : all of this type: table, kitchen, room
        near : of ``observation``: least distance from the object, metres
        far : of ``observation``: largest distance from the object, metres
        headroom : of ``floor``: free height above it, metres
        max_step : of ``floor``: the highest step up or down, metres

        Raises
        ------
        LookupError
            The map has no such entity or type.
        ValueError
            Neither `names` nor `type`, a sort that is not known, or one of `names` without such a
            region.
        """
        from semmap.ingest.regions.region_search import find_regions

        if not names and type is None:
            raise ValueError("name rooms or objects, or give their type")
        chosen = [names] if isinstance(names, str) else names
        options: dict[str, dict[str, float]] = {
            "floor": {"headroom": headroom, "max_step": max_step},
            "observation": {"near": near, "far": far},
        }
        with self._change() as seen:
            return find_regions(seen, sort, chosen, type, **options.get(sort, {}))

    def draw_region(
        self,
        name: str,
        polygon: shapely.Polygon | Sequence[Sequence[float]] | None = None,
        *,
        box: Sequence[float] | None = None,
        type: str = "region",
        holder: EntityName | None = None,
        properties: Properties | None = None,
        since: datetime | None = None,
        until: datetime | None = None,
    ) -> dict[str, Any]:
        """Draw or redraw a region: a polygon from floor to ceiling, or a box.

        Returns the region, as of `list_regions`.

        Parameters
        ----------
        polygon : corners (x, y) in the map's frame, metres
        box : instead, (x0, y0, z0, x1, y1, z1) in the map's frame, metres
        type : a semantic type, such as ``blocked_region``
        holder : room or object that holds it, and with which it moves
        properties : added to those that it has
        since, until : when it is valid; local without a time zone

        Raises
        ------
        LookupError
            There is no such type or holder.
        ValueError
            Both or neither of polygon and box, one without extent, or a name that is taken.
        """
        from semmap.ingest.regions.extraction import draw_region
        from semmap.query.entity_query import list_regions

        if not name:
            raise ValueError("a region needs a name")
        if name == holder:
            raise ValueError(f"{name}: a region is not in itself: name a room or object as holder")
        valid = None if since is None and until is None else (aware(since), aware(until))
        with self._change() as seen:
            made = draw_region(
                seen.connection,
                self._rows("SELECT current_map()")[0][0],
                name,
                None if polygon is None else _outline(polygon),
                box=None if box is None else _box(name, box),
                type=type,
                holder=None if holder is None else self[holder].id,
                properties=dict(properties or {}),
                valid=valid,
            )
            return list_regions(self._seen, [made])[0]

    def list_regions(self) -> list[dict[str, Any]]:
        """The regions: `name`, `type`, `origin`, `of`, `holder`, `area`, `low`, `high`, `faces`.

        Metres and square metres in the map's frame; `of` is the room or object of which a region
        is a part.
        """
        from semmap.query.entity_query import list_regions

        return list_regions(self._seen)


def _outline(given: Any) -> Any:
    """The polygon of some corners."""
    import shapely

    from semmap.api.additions import polygon_of

    polygon = polygon_of(given)
    if polygon.geom_type not in ("Polygon", "MultiPolygon") or polygon.is_empty:
        kind = "nothing" if polygon.is_empty else f"a {polygon.geom_type}"
        raise ValueError(f"the region is drawn as {kind}, not as a polygon")
    if polygon is given:
        return polygon
    if not polygon.is_valid:
        reason = shapely.is_valid_reason(polygon)
        raise ValueError(f"the polygon crosses its own border: {reason}")
    return polygon


def _box(name: str, given: Sequence[float]) -> Any:
    numbers = finite_numbers(given, 6)
    if numbers is None:
        raise ValueError(f"{name}: a box is (x0, y0, z0, x1, y1, z1), not {tuple(given)}")
    return numbers
