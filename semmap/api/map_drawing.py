"""Pictures of the map, and its topology as files for other programs."""

from __future__ import annotations

import html
from dataclasses import asdict, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

from semmap.api.checked import EntityName, Positive
from semmap.api.map_pictures import plan_of
from semmap.api.map_tasks import MapTasks
from semmap.whole_file import write_whole

if TYPE_CHECKING:
    from planner.robot_class import RobotClass
    from planner.routing_graph import RoutingGraph
    from planner.topology import Place, PlaceConnector, Topology
    from semmap.api.map import Map
    from semmap.belief.believed_places import BelievedPlaces
    from semmap.draw.picture import Picture
    from semmap.draw.view import StoreyView


class TopologyFormat(StrEnum):
    """File formats of a topology."""

    nav2 = "nav2"
    rmf = "rmf"
    dot = "dot"
    png = "png"
    json = "json"


_ENDINGS = {
    ".geojson": TopologyFormat.nav2,
    ".yaml": TopologyFormat.rmf,
    ".yml": TopologyFormat.rmf,
    ".dot": TopologyFormat.dot,
    ".gv": TopologyFormat.dot,
    ".png": TopologyFormat.png,
    ".json": TopologyFormat.json,
}


_LOWEST = (
    "SELECT e.name FROM entity e JOIN world w ON w.entity_id = e.id "
    "WHERE e.map_id = current_map() AND e.kind = 'storey' ORDER BY w.pose[3], e.name LIMIT 1"
)


class MapDrawing(MapTasks):
    """The part of `Map` that draws, and writes the topology."""

    def draw(
        self,
        storey: EntityName | None = None,
        *,
        route: EntityName | None = None,
        belief: EntityName | BelievedPlaces | None = None,
        search: EntityName | None = None,
        costmap: str | None = None,
        field: str | None = None,
        grasps: EntityName | None = None,
        start: EntityName | None = None,
        robot: str | None = None,
        walls: bool = True,
        title: str = "",
        assume_sizes: bool = False,
    ) -> Picture:
        """The floor plan of a storey, those of all one below another, or an answer of the map.

        Parameters
        ----------
        storey : only this one
        route : the way to it, from `start`
        belief : where this object, agent or type probably is, as a heat map; or what `where` found
        search : the looks of a search for it, numbered, over where it probably is
        costmap : the costs of this robot
        field : voxels: a property of fields such as ``inRoom``, or a query with voxels
        grasps : the best stored grasps of this object
        start, robot : of a route or a search, as for `route` and `search`
        walls : of a plan: the occupied cells between the rooms, too; else outlines alone
        title : of a plan, in place of the storey's name
        assume_sizes : of a plan: typical boxes, dashed, for objects without geometry

        Raises
        ------
        LookupError, ValueError
            There is no such storey, thing, robot or property, or nothing to draw; more than one
            answer, or arguments of another one.
        """
        asked = {
            "route": route,
            "belief": belief,
            "search": search,
            "costmap": costmap,
            "field": field,
            "grasps": grasps,
        }
        given = [kind for kind, about in asked.items() if about is not None]
        if len(given) > 1:
            raise ValueError(f"{' and '.join(given)} are several pictures: draw one at a time")
        if (start or robot) and not {"route", "search"} & {*given}:
            raise ValueError("start and robot are those of a route or a search: name it")
        if given and (title or assume_sizes or not walls):
            raise ValueError("title, walls and assume_sizes are for a plan without an answer")
        if storey is not None and grasps is not None:
            raise ValueError("grasps are drawn where the object is: leave out storey")
        if given:
            return self._draw_answer(given[0], asked[given[0]], storey, start, robot)
        return self._draw_plan(storey, walls, title, assume_sizes)

    def _draw_answer(
        self, kind: str, about: Any, storey: str | None, start: str | None, robot: str | None
    ) -> Picture:
        from semmap.api import answer_pictures as pictures
        from semmap.draw.picture import Picture

        map = cast("Map", self)
        match kind:
            case "route":
                if start is None:
                    raise ValueError("a route begins somewhere: give start")
                return self.route(start, about, robot=robot).plot(storey)
            case "belief":
                return pictures.belief_picture(map, about, storey)
            case "search":
                found = self.search(about, start=start, robot=robot)
                return pictures.search_picture(found, storey)
            case "costmap":
                made = self.costmaps(about, storey=storey)
                return Picture.stacked(m.plot(f"costs of {about}") for m in made)
            case "field":
                return pictures.field_picture(map, about, storey)
        return pictures.grasps_picture(map, about)

    def _draw_plan(
        self, storey: str | None, walls: bool, title: str, assume_sizes: bool
    ) -> Picture:
        from navgrid.grid_output import with_grid
        from semmap.api.answer_pictures import plan_notes
        from semmap.draw.floor_plan import floor_plan
        from semmap.draw.picture import Picture

        views = (
            [with_grid(made) for made in self.grids(storey=storey, assume_sizes=assume_sizes)]
            if walls
            else self.views(storey, assume_sizes=assume_sizes)
        )
        if not views:
            raise LookupError(f"the map {self.name} has nothing to draw: import a world file")
        return Picture.stacked(
            Picture.drawn(partial(floor_plan, view, title=title), *plan_notes(view))
            for view in views
        )

    def draw_3d(
        self,
        *,
        cut: Positive | None = None,
        width: int = 2200,
        title: str = "",
        assume_sizes: bool = False,
    ) -> Picture:
        """All storeys in 3D, with their furniture; walls are cut `cut` metres above each floor.

        `assume_sizes` draws typical boxes for objects without geometry; `width` is pixels, 100 to
        20,000.
        """
        from semmap.draw.picture import Picture
        from semmap.draw.scene3d import scene3d

        if not 100 <= width <= 20_000:
            raise ValueError(f"width is {width}: give from 100 to 20,000 pixels")

        views = self.views(assume_sizes=assume_sizes)
        options: dict[str, Any] = {} if cut is None else {"cut": cut}
        return Picture.drawn(
            lambda path: scene3d(views, path, width=width, title=title or self.name, **options)
        )

    def _repr_svg_(self) -> str:
        """The floor plan of the lowest storey: rooms, regions, doors and furniture."""
        from semmap.query.entity_shapes import read_shapes

        rows = read_shapes(self._seen)
        lowest = self._rows(_LOWEST)
        storey = lowest[0][0] if lowest else None
        shown = [row for row in rows if row["storey"] in (storey, None)]
        title = self.name if storey is None else f"{self.name}, {storey}"
        return plan_of(self, shown, title=title)

    def _repr_html_(self) -> str:
        """The name of the map, how many entities it has, and its floor plan."""
        rows = self._rows(
            "SELECT kind, count(*) FROM entity WHERE map_id = current_map() "
            "GROUP BY kind ORDER BY count(*) DESC, kind"
        )
        counts = ", ".join(f"{count} {kind}{'s' if count > 1 else ''}" for kind, count in rows)
        title = f"<div><b>{html.escape(self.name)}</b>: {counts or 'empty'}</div>"
        return title + self._repr_svg_()

    def views(
        self, storey: EntityName | None = None, *, assume_sizes: bool = False
    ) -> list[StoreyView]:
        """The content of each storey for `semmap.draw`, the lowest first."""
        from semmap.draw.view import storey_view
        from semmap.query.storey_reader import read_storeys

        with self.snapshot() as seen:
            scenes = read_storeys(seen, storey, assume_sizes=assume_sizes)
            return [storey_view(scene) for scene in scenes]

    def write_topology(
        self,
        file: Path | str,
        *,
        format: Literal["nav2", "rmf", "dot", "png", "json"] | None = None,
        storey: EntityName | None = None,
        robot: str | RobotClass | None = None,
        unlocks: bool = False,
        speed: float = 0.5,
    ) -> list[Path]:
        """Write the topology: a route graph for Nav2 or Open-RMF, DOT, a picture or JSON.

        Returns the files that were written.

        Parameters
        ----------
        file : its ending says the format
        format : by default that of the file's ending
        storey : only this one
        robot : a stored class whose paths and times are used, in place of straight lines
        unlocks : the robot unlocks doors, where none is named
        speed : metres a second, where no robot is named

        Raises
        ------
        ValueError
            The map has no connectors, or the ending stands for no format.
        """
        import json

        from planner.exchange.dot import dot
        from planner.exchange.nav2_route import write_nav2
        from planner.exchange.reader import read_building_outline
        from planner.exchange.rmf_nav import write_rmf_nav

        file = Path(file)
        chosen = topology_format(file, format)
        graph = self.routing_graph(robot, unlocks=unlocks, speed=speed)
        options: Any = {"storey": storey, "name": self.name}
        if chosen in (TopologyFormat.nav2, TopologyFormat.rmf):
            with self.snapshot() as seen:
                options["building"] = read_building_outline(seen)
            if chosen is TopologyFormat.nav2:
                return write_nav2(graph, file, **options)
            return [write_rmf_nav(graph, file, **options)]
        if chosen is TopologyFormat.png:
            return self._draw_topology(graph.topology, file, storey)
        if chosen is TopologyFormat.dot:
            text = dot(graph.topology, **options)
        else:
            text = json.dumps(topology_as_json(graph.topology, storey), indent=1)
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, text.rstrip("\n") + "\n")
        return [file]

    def routing_graph(
        self,
        robot: str | RobotClass | None = None,
        *,
        unlocks: bool = False,
        speed: float = 0.5,
    ) -> RoutingGraph:
        """The topology as a graph of travel times; options are those of `write_topology`."""
        from planner.exchange.route_graph import ExchangeError
        from planner.robot_class import RobotClass

        shape = self._driver(robot) or RobotClass(speed=speed, unlocks=unlocks)
        graph = self.live_topology(shape, body=False).graph
        if not graph.topology.connectors:
            raise ExchangeError(
                f"the map {self.name} has no connectors: import an annotation that has them "
                "(GeoJSON, GeoPackage) or an Open-RMF building"
            )
        return graph

    def _draw_topology(self, topology: Topology, file: Path, storey: str | None) -> list[Path]:
        from navgrid.grid import file_name
        from planner.exchange.picture import topology_plan

        written = []
        views = self.views(storey)
        for view in views:
            path, title = file, f"{self.name}: topology"
            if len(views) > 1:
                path = file.with_name(f"{file.stem}.{file_name(view.name)}{file.suffix or '.png'}")
            if view.name != self.name:
                title = f"{self.name}, {view.name}: topology"
            bare = replace(view, objects=[])
            written.append(topology_plan(topology, bare, path, title=title))
        return written


def topology_format(file: Path, given: str | None) -> TopologyFormat:
    """Return the format of a file: the one given, or that of its ending."""
    if given is not None:
        return TopologyFormat(given)
    found = _ENDINGS.get(file.suffix.lower())
    if found is None:
        raise ValueError(
            f"{file.name}: its ending stands for no format: give format=, one of "
            f"{', '.join(TopologyFormat)}"
        )
    return found


def topology_as_json(topology: Topology, storey: str | None = None) -> dict[str, Any]:
    """Return places and connectors as plain values; poses as x, y, z and quaternion."""
    places = topology.places_on(storey)
    names = {p.name for p in places}
    connectors = [c for c in topology.connectors.values() if names & set(c.places)]
    return {
        "places": [_plain(p) for p in places],
        "connectors": [
            _plain(c)
            | {"poses": [p._asdict() for p in c.poses], "permissions": sorted(c.permissions)}
            | {"narrowed": c.narrowed and {"width": c.narrowed.width, "by": [*c.narrowed.objects]}}
            for c in connectors
        ],
        "elevators": topology.cabins(),
    }


def _plain(entity: Place | PlaceConnector) -> dict[str, Any]:
    """The attributes without the id, which has a meaning only in the database."""
    return {key: value for key, value in asdict(entity).items() if key != "id"}
