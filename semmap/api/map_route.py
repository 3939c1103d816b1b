"""A route on its map: drawn on the floor plans, and shown in a notebook."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import partial
from html import escape
from typing import TYPE_CHECKING, Self

from planner.route import Route

if TYPE_CHECKING:
    from planner.topology import Topology
    from semmap.api.map_driving import MapDriving
    from semmap.draw.picture import Picture


@dataclass(frozen=True)
class MapRoute(Route):
    """A `planner.Route` that `Map.route` found, with the map and topology where it was planned."""

    map: MapDriving = field(repr=False, compare=False, kw_only=True)
    topology: Topology = field(repr=False, compare=False, kw_only=True)

    @classmethod
    def of(cls, map: MapDriving, topology: Topology, route: Route) -> Self:
        """Return a route with the map that it was planned on."""
        values = {each.name: getattr(route, each.name) for each in fields(Route)}
        return cls(**values, map=map, topology=topology)

    @property
    def places(self) -> list[str]:
        """The names of the places on the route, in order."""
        return [*dict.fromkeys([self.start, *(step.to_place for step in self.steps)])]

    def without_geometry(self, *, assume_sizes: bool = False) -> list[str]:
        """The objects on the way whose shape is not known, which are taken for free floor.

        `assume_sizes` leaves out those for whose type a typical size is known.
        """
        from semmap.query.geometry_notes import read_names_without_geometry

        with self.map.snapshot() as seen:
            return read_names_without_geometry(seen, self.places, assume_sizes=assume_sizes)

    def plot(self) -> Picture:
        """Draw the way on the floor plan of each storey that it leads through, one below another.

        ValueError if the places of the route have no outlines.
        """
        from navgrid.grid_output import with_grid
        from planner.route_lines import route_lines
        from semmap.draw.floor_plan import floor_plan
        from semmap.draw.picture import Picture

        grids = {made.scene.storey: made for made in self.map.grids()}
        lines = route_lines(self, self.topology, grids, None)
        if not lines:
            raise ValueError(f"the storey of {self.start} has no floor plan to draw on")
        return Picture.stacked(
            Picture.drawn(partial(floor_plan, replace(with_grid(grids[storey]), path=path)))
            for storey, path in lines.items()
        )

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{escape(step.behaviour)}</td>"
            f"<td>{escape(step.elevator or (step.connector.name if step.connector else ''))}</td>"
            f"<td>{escape(step.from_place)}</td><td>{escape(step.to_place)}</td>"
            f"<td>{step.seconds:.1f} s</td></tr>"
            for step in self.transitions
        )
        head = f"{escape(self.start)} → {escape(self.goal)}: {self.metres:.1f} m"
        return f"<p>{head}, {self.seconds:.0f} s</p><table>{rows}</table>"

    def _repr_png_(self) -> bytes:
        return self.plot().png
