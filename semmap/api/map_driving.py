"""Where robots drive: occupancy grids, costmaps, routes, the topology, and classes of robots."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from semmap.api.checked import EntityName
from semmap.api.map_questions import MapQuestions, aware

if TYPE_CHECKING:
    from navgrid.costmap import Costmap
    from navgrid.field_layer import FieldVoxels
    from navgrid.occupancy_grid import StoreyGrid
    from planner.live_topology import LiveTopology
    from planner.location import LocationLike
    from planner.robot_class import RobotClass
    from planner.topology import Topology
    from semmap.api.map_results import MapRoute
    from semmap.geometry.voxels import Voxels
    from semmap.query.snapshot import Snapshot
    from semmap.query.storey_scene import Bounds
    from semmap.robot import Part

    RobotLike = str | Path | RobotClass | Sequence[Part]

URDF = (".urdf", ".xml", ".xacro")
"""Endings of files of robots; other names are those of stored classes."""

Progress = Callable[[str, int, int], None]
"""Called with what is done now, its number, and how many there are."""

_CHANGED_REGIONS = """
SELECT e.name FROM region r JOIN entity e ON e.id = r.entity_id
WHERE e.map_id = current_map() AND (r.valid @> now()) <> (r.valid @> %s) ORDER BY 1
"""


class MapDriving(MapQuestions):
    """The part of `Map` about driving."""

    @cached_property
    def _live(self) -> dict[Any, LiveTopology]:
        return {}

    def grids(
        self,
        *,
        storey: EntityName | None = None,
        interval: tuple[float, float] = (0.05, 1.8),
        resolution: float = 0.05,
        increment: float | None = None,
        free_outside: bool = False,
        policy: Path | str | None = None,
        max_step: float = 0.02,
        max_slope: float = 6.0,
        at: datetime | None = None,
        fields: Iterable[str] | None = None,
        voxel_size: float | None = None,
        assume_sizes: bool = False,
    ) -> list[StoreyGrid]:
        """The occupancy grid of each storey, the lowest first.

        Parameters
        ----------
        storey : only this one
        interval : lowest and highest end of obstacles above the floor, metres
        resolution : side of a cell, metres
        increment : cut the meshes by planes so many metres apart, as in the paper; by default exact
        free_outside : cells outside of rooms are free, not unknown
        policy : a YAML file that says which entity is an obstacle
        max_step : the highest step that a robot drives over, metres
        max_slope : the steepest slope that it climbs, degrees
        at : leave out regions that do not hold then; by default now
        fields : names of stored fields that count; by default all, () for none
        voxel_size : take the voxels of the mirror, of this edge in metres, in place of the meshes
        assume_sizes : give objects without geometry a typical box for their type

        Raises
        ------
        LookupError, ValueError
            There is no such storey or field; the interval contains the floor, or there is nothing
            to make a grid of.
        """
        from navgrid.occupancy_grid import storey_grid
        from semmap.query.storey_reader import read_storeys

        with self.snapshot() as seen:
            scenes = read_storeys(
                seen,
                storey,
                moment=aware(at) or datetime.now(UTC),
                voxels=_voxels(self, voxel_size),
                assume_sizes=assume_sizes,
            )
            found = _fields(seen, fields, policy)
        there = [scene for scene in scenes if scene.entities or scene.floors] or scenes
        return [
            storey_grid(
                scene,
                interval,
                resolution,
                increment=increment,
                free_outside=free_outside,
                policy=_policy(policy),
                limits=_limits(max_step, max_slope),
                fields=found,
            )
            for scene in there
        ]

    def grid(self, storey: EntityName | None = None, **options: Any) -> StoreyGrid:
        """The occupancy grid of one storey; `storey` may be left out where there is only one.

        Options and errors are those of `grids`.
        """
        found: StoreyGrid = _only(self.grids(storey=storey, **options), "storey=")
        return found

    def costmaps(
        self,
        robot: RobotLike,
        *,
        posture: str | Mapping[str, float] | None = None,
        parts: Path | str | None = None,
        storey: EntityName | None = None,
        rooms: Sequence[EntityName] | None = None,
        bounds: Bounds | None = None,
        resolution: float = 0.05,
        inflation_radius: float = 0.55,
        cost_scaling_factor: float = 3.0,
        policy: Path | str | None = None,
        static_map: Path | str | None = None,
        max_step: float = 0.02,
        max_slope: float = 6.0,
        at: datetime | None = None,
        fields: Iterable[str] | None = None,
        voxel_size: float | None = None,
        assume_sizes: bool = False,
    ) -> list[Costmap]:
        """The layered costmaps of a robot, one for each storey, the lowest first.

        Parameters
        ----------
        robot : a stored class, a URDF, a `planner.RobotClass` or the parts of a robot
        posture : of its joints: ``{"arm_1_joint": 0.5}``, a state of its SRDF, or JSON; by
            default that of the stored class or robot, or one that is found, near its axis;
            `Costmap.posture` says which
        parts : a YAML file that groups the links of a URDF into parts
        storey : only this one
        rooms : only these
        bounds : only (x0, y0, x1, y1), metres
        inflation_radius : as in costmap_2d, metres
        cost_scaling_factor : as in costmap_2d, 1/metre
        static_map : a ``map.yaml``, such as one from SLAM, as a further layer
        resolution, policy, max_step, max_slope, at, fields, voxel_size, assume_sizes :
            as for `grids`

        Raises
        ------
        LookupError, ValueError
            There is no such robot, storey, room or field, or nothing stands there; or a number is
            out of range.
        """
        from navgrid.costmap import Inflation
        from navgrid.readers.costmaps import read_costmaps

        shape, said = self._shape(robot, posture, parts)
        with self.snapshot() as seen:
            made = read_costmaps(
                seen,
                shape,
                storey=storey,
                rooms=rooms,
                bounds=bounds,
                resolution=resolution,
                policy=_policy(policy),
                inflation=Inflation(inflation_radius, cost_scaling_factor),
                limits=_limits(max_step, max_slope),
                static_map=None if static_map is None else Path(static_map),
                moment=aware(at) or datetime.now(UTC),
                fields=_fields(seen, fields, policy),
                voxels=_voxels(self, voxel_size),
                assume_sizes=assume_sizes,
            )
        for costmap in made:
            costmap.posture = said
        return made

    def costmap(
        self, robot: RobotLike, *, storey: EntityName | None = None, **options: Any
    ) -> Costmap:
        """The layered costmap of a robot on one storey, or in rooms of one storey.

        Options and errors are those of `costmaps`. `Costmap.explain` has the causes of a place's
        cost.
        """
        made = self.costmaps(robot, storey=storey, **options)
        found: Costmap = _only(made, "storey= or rooms=")
        return found

    @property
    def ended_fields(self) -> list[str]:
        """The fields of sources that send no more updates; grids leave them out."""
        from navgrid.readers.fields import read_ended_fields

        with self.snapshot() as seen:
            return read_ended_fields(seen)

    def robot_parts(
        self,
        robot: RobotLike,
        *,
        posture: str | Mapping[str, float] | None = None,
        parts: Path | str | None = None,
    ) -> list[Part]:
        """The parts of a robot with their intervals of height and footprints, as for `costmaps`."""
        return self._shape(robot, posture, parts)[0]

    def _shape(
        self, robot: RobotLike, posture: str | Mapping[str, float] | None, parts: Path | str | None
    ) -> tuple[list[Part], str]:
        """The parts of a robot, and the posture that they are in, in words."""
        from planner.readers.robot_class import read_robot_class, read_robot_urdf
        from planner.robot_class import RobotClass
        from semmap.api.driving_posture import driving_posture
        from semmap.robot import load_robot, robot_parts

        said = ""
        if isinstance(robot, str) and not robot.endswith(URDF):
            with self.snapshot() as seen:
                if posture is None and parts is None:
                    said = f"posture: stored with the class {robot}"
                    robot = read_robot_class(seen, robot).robot
                else:
                    robot = read_robot_urdf(seen, robot)
        if isinstance(robot, str | Path):
            urdf = Path(robot)
            grouped = None if parts is None else Path(parts)
            with self.snapshot() as seen:
                chosen = driving_posture(seen.session, urdf, posture, grouped)
            return robot_parts(load_robot(urdf), chosen.joints, grouped), str(chosen)
        if posture is not None or parts is not None:
            raise ValueError("posture and parts are for a URDF or a stored class: give its name")
        return list(robot.parts if isinstance(robot, RobotClass) else robot), said

    @property
    def robots(self) -> dict[str, RobotClass]:
        """The stored classes of robots by name."""
        from planner.readers.robot_class import read_robot_class, read_robot_class_names

        with self.snapshot() as seen:
            names = read_robot_class_names(seen)
            return {name: read_robot_class(seen, name).robot for name in names}

    # --- routes

    def route(
        self,
        start: LocationLike | EntityName,
        goal: LocationLike | EntityName,
        *,
        robot: str | RobotClass | None = None,
        avoid: Sequence[EntityName] = (),
        at: datetime | None = None,
        rules: Path | str | None = None,
        drawn: bool = False,
        opens: bool | None = None,
        unlocks: bool | None = None,
        outside: bool | None = None,
        assume_sizes: bool = False,
        progress: Progress | None = None,
    ) -> MapRoute:
        """The quickest route, with its doors in order, each with an approach and a leave pose.

        Parameters
        ----------
        start, goal : a room, an object, a region or an agent by its name; a point (x, y) or
            (x, y, z) in the map's frame, metres; for `goal` also a type or a label: the nearest
        robot : a stored class, a URDF or a `planner.RobotClass`, with costmaps and travel times; by
            default a robot 0.6 m wide and 1.5 m high inside of rooms, that passes doors that it
            fits through, and stairs
        avoid : names or types of places, doors and regions that it must not use
        at : the moment, for rules that have hours; by default now. Regions are those of now: a
            moment at which others hold is refused
        rules : a YAML file: the costs of places, doors and regions
        drawn : on the graph that people drew: imported Nav2 edges or Open-RMF lanes
        opens, unlocks : whether the robot opens closed doors, and unlocks locked ones; by default
            as its class, or it opens and does not unlock
        outside : whether it may leave the building; by default as its class, or not
        assume_sizes : give objects without geometry a typical box
        progress : called with a place that is measured, its number, and the number of places

        Raises
        ------
        LookupError
            The map has no such entity or robot; the message suggests similar names.
        ValueError
            There is no route; the message says why.
        """
        from planner.readers.drawn_graph import read_drawn_graph

        self._check_regions(at)
        options: Any = {"avoid": avoid, "at": at or datetime.now()}
        able = {"opens": opens, "unlocks": unlocks, "outside": outside}
        live, planner = self._route_planner(robot, rules, assume_sizes, progress, able)
        if drawn:
            with live.snapshot() as seen:
                graph = read_drawn_graph(seen, live.topology)
            return self._route(live, planner.route_on(graph, start, goal, **options))
        return self._route(live, planner.route(start, goal, **options))

    def routes(
        self,
        start: LocationLike | EntityName,
        goal: LocationLike | EntityName,
        count: int,
        *,
        robot: str | RobotClass | None = None,
        avoid: Sequence[EntityName] = (),
        at: datetime | None = None,
        rules: Path | str | None = None,
        opens: bool | None = None,
        unlocks: bool | None = None,
        outside: bool | None = None,
        assume_sizes: bool = False,
        progress: Progress | None = None,
    ) -> list[MapRoute]:
        """The quickest routes, at most `count`, the quickest first; as `route`."""
        self._check_regions(at)
        able = {"opens": opens, "unlocks": unlocks, "outside": outside}
        live, planner = self._route_planner(robot, rules, assume_sizes, progress, able)
        moment = at or datetime.now()
        found = planner.alternatives(start, goal, count, avoid=avoid, at=moment)
        return [self._route(live, route) for route in found]

    def topology(self, robot: str | RobotClass | None = None) -> Topology:
        """The places of the building and the connectors that join them, as plain data."""
        return self.live_topology(self._driver(robot), body=False).topology

    def live_topology(
        self,
        robot: str | RobotClass | None = None,
        *,
        assume_sizes: bool = False,
        body: bool = True,
        progress: Progress | None = None,
    ) -> LiveTopology:
        """The routing graph of a robot, up to date; it is kept, and follows later changes.

        Inside of rooms, a robot without shape has the default `body` of `route`, or is a point
        without it. ValueError while a transaction of this map is open, whose changes the graph
        would not see.
        """
        from planner.live_topology import LiveTopology

        if self.in_transaction:
            raise ValueError("routes and plans see what is committed: end the transaction first")
        known = robot if robot is None or isinstance(robot, str) else repr(robot)
        key = (known, assume_sizes, body)
        live = self._live.get(key)
        if live is None:
            live = self._live[key] = LiveTopology(
                self, robot, progress=progress, assume_sizes=assume_sizes, body=body
            )
        else:
            live.catch_up()
        return live

    def _check_regions(self, at: datetime | None) -> None:
        """Refuse a moment at which other regions hold than now."""
        changed = self._rows(_CHANGED_REGIONS, aware(at)) if at is not None else []
        if changed:
            names = ", ".join(name for (name,) in changed)
            raise ValueError(
                f"routes are through the regions of now, and at {at:%Y-%m-%d %H:%M} others hold "
                f"({names}): ask again at that time; grids and costmaps take it"
            )

    def _driver(self, robot: str | RobotClass | None) -> str | RobotClass | None:
        """A robot whose ways are sought; that of a URDF has its shape in its driving posture."""
        from planner.robot_class import RobotClass

        if isinstance(robot, str) and robot.endswith(URDF):
            return RobotClass(Path(robot).stem, tuple(self.robot_parts(robot)))
        return robot

    def _route_planner(
        self,
        robot: str | RobotClass | None,
        rules: Path | str | None,
        assume_sizes: bool,
        progress: Progress | None,
        abilities: dict[str, bool | None],
    ) -> tuple[LiveTopology, Any]:
        from planner.cost_rules import CostRules
        from planner.route_planner import RoutePlanner

        able = {name: value for name, value in abilities.items() if value is not None}
        live = self.live_topology(
            _robot_with(**able) if robot is None and able else self._driver(robot),
            assume_sizes=assume_sizes,
            progress=progress,
        )
        costs = None if rules is None else CostRules.read(Path(rules))
        planner = RoutePlanner.of_live(live, rules=costs)
        if robot is not None and able:
            planner.graph = live.graph.with_abilities(**able)
        return live, planner

    def _route(self, live: LiveTopology, route: Any) -> MapRoute:
        from semmap.api.map_results import MapRoute

        return MapRoute.of(self, live, route)


@cache
def _robot_with(**abilities: bool) -> RobotClass:
    """A robot of which nothing but these abilities is known."""
    from planner.robot_class import RobotClass

    return RobotClass(**abilities)  # type: ignore[arg-type]


def _voxels(map: MapDriving, size: float | None) -> dict[int, Voxels] | None:
    from navgrid.readers.fields import read_mirror

    return None if size is None else read_mirror(map, size)


def _fields(
    seen: Snapshot, names: Iterable[str] | None, policy: Path | str | None
) -> dict[str, FieldVoxels]:
    from navgrid.readers.fields import read_fields

    chosen = None if names is None else [*names]
    return {} if chosen == [] else read_fields(seen, chosen, policy=_policy(policy))


def _policy(path: Path | str | None) -> Any:
    from navgrid.policy import Policy

    return None if path is None else Policy.read(Path(path))


def _limits(max_step: float, max_slope: float) -> Any:
    import math

    from navgrid.terrain import DriveLimits

    return DriveLimits(max_step, math.radians(max_slope))


def _only(found: list[Any], choice: str) -> Any:
    """The only grid or costmap; an error that names the storeys where there are several."""
    if len(found) > 1:
        names = ", ".join(each.scene.storey for each in found)
        raise ValueError(f"the map has several storeys: {names}; choose one by {choice}")
    return found[0]
