"""Routes, plans and searches on their map: drawn, shown in a notebook, and carried out."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from planner.plan import Plan
from planner.route import Route

if TYPE_CHECKING:
    from navgrid.occupancy_grid import StoreyGrid
    from planner.live_topology import LiveTopology
    from planner.route import RouteStep
    from planner.search.problem_builder import MapSearch, Viewpoint
    from planner.search.receding_horizon import Decision
    from planner.simulated_run import SimulatedMission
    from planner.topology import Topology
    from semmap.api.map_driving import MapDriving
    from semmap.api.map_tasks import MapTasks
    from semmap.arrays import Floats
    from semmap.draw.picture import Picture

_AT_A_DOOR = ("from", "to", "approach", "leave")
"""The values of a step that a door of a route has as JSON."""


@dataclass(frozen=True, repr=False)
class MapRoute(Route):
    """A `planner.Route` that `Map.route` found, with the map and topology where it was planned.

    `assumed_body` says which body was assumed for a robot without shape.
    """

    map: MapDriving = field(repr=False, compare=False, kw_only=True)
    topology: Topology = field(repr=False, compare=False, kw_only=True)
    assumed_body: str | None = field(default=None, repr=False, compare=False, kw_only=True)

    @classmethod
    def of(cls, map: MapDriving, live: LiveTopology, route: Route) -> Self:
        """Return a route with the map that it was planned on."""
        values = {each.name: getattr(route, each.name) for each in fields(Route)}
        body = live.assumed_body
        return cls(**values, map=map, topology=live.topology, assumed_body=body)

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

    def as_json(self) -> dict[str, Any]:
        """The route as plain values; poses are x, y, z and quaternion."""
        return {
            "from": self.start,
            "to": self.goal,
            "cost": self.seconds,
            "seconds": self.seconds,
            "metres": self.metres,
            "assumed_body": self.assumed_body,
            "doors": [
                {"name": step.connector.name}
                | {key: value for key, value in _step_as_json(step).items() if key in _AT_A_DOOR}
                for step in self.doors
                if step.connector is not None
            ],
            "transitions": [_step_as_json(step) for step in self.transitions],
            "steps": [
                _step_as_json(step)
                | {"seconds": step.seconds, "metres": step.metres}
                | {"frame": step.frame, "map": step.map}
                for step in self.steps
            ],
        }

    def plot(self, storey: str | None = None) -> Picture:
        """Draw the way on the floor plan of each storey that it leads through, one below another.

        `storey`: only this one. ValueError if the places of the route have no outlines, LookupError
        if it does not lead through the storey.
        """
        from navgrid.grid_output import with_grid
        from semmap.draw.floor_plan import floor_plan
        from semmap.draw.picture import Picture
        from semmap.query.geometry_notes import names_note

        grids = self._grids()
        lines = self._lines(grids)
        if not lines:
            raise ValueError(f"the storey of {self.start} has no floor plan to draw on")
        if storey is not None and storey not in lines:
            raise LookupError(
                f"the way does not lead through {storey}, but through {', '.join(lines)}"
            )
        notes = [self.assumed_body] if self.assumed_body else []
        unknown = self.without_geometry()
        notes += [names_note(unknown)] if unknown else []
        return Picture.stacked(
            Picture.drawn(partial(floor_plan, replace(with_grid(grids[name]), path=path)), *notes)
            for name, path in lines.items()
            if storey in (name, None)
        )

    def ways(self) -> list[dict[str, Any]]:
        """The way as lines: the `storey` of each and its `points` (x, y, z), metres, on its floor.

        In rooms it is the shortest way on the grid, through doors that of the route.
        """
        grids = self._grids()
        return [
            {"storey": storey, "points": [[*point, z] for point in line.tolist()]}
            for storey, lines in self._lines(grids).items()
            for z in [grids[storey].scene.elevation]
            for line in lines
        ]

    def _grids(self) -> dict[str, StoreyGrid]:
        return {made.scene.storey: made for made in self.map.grids()}

    def _lines(self, grids: dict[str, StoreyGrid]) -> dict[str, list[Floats]]:
        from planner.route_lines import route_lines

        return route_lines(self, self.topology, grids, None)

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


@dataclass(frozen=True, repr=False)
class MapPlan(Plan):
    """A `planner.Plan` that `Map.plan` made.

    `reasons` has a sentence for each object that is searched for, why it goes where it goes, and
    for each one whose grasps are not judged.
    `assumed` are the objects of the plan for which the typical box of their type was assumed;
    `assumed_body` is as for routes.
    """

    assumed: tuple[str, ...] = field(default=(), kw_only=True)
    assumed_body: str | None = field(default=None, kw_only=True)
    reasons: tuple[str, ...] = field(default=(), kw_only=True)
    map: MapTasks = field(repr=False, compare=False, kw_only=True)
    options: dict[str, Any] = field(default_factory=dict, repr=False, compare=False, kw_only=True)

    @classmethod
    def of(cls, map: MapTasks, plan: Plan, **more: Any) -> Self:
        """Return a plan with the map that it was made on."""
        return cls(**{f.name: getattr(plan, f.name) for f in fields(Plan)}, map=map, **more)

    def as_json(self) -> dict[str, Any]:
        """The plan as plain values; poses are x, y, z and quaternion."""
        return {
            "goal": self.goal,
            "seconds": self.seconds,
            "bound": self.bound,
            "optimal": self.optimal,
            "assumed_sizes": [*self.assumed],
            "assumed_body": self.assumed_body,
            "actions": [
                {
                    "name": action.name,
                    "arguments": list(action.arguments),
                    "entities": list(action.names),
                    "seconds": action.seconds,
                    "at": None if action.at is None else action.at._asdict(),
                    "steps": [
                        _step_as_json(step) | {"seconds": step.seconds, "map": step.map}
                        for step in action.steps
                    ],
                }
                for action in self.actions
            ],
        }

    def run(self, **options: Any) -> SimulatedMission:
        """Carry it out; options are those of `Map.run`."""
        return self.map.run(self.goal, **self.options | options)

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{number}</td><td>{escape(str(action))}</td>"
            f"<td>{action.seconds:.1f} s</td></tr>"
            for number, action in enumerate(self.actions, 1)
        )
        return (
            f"<p>{escape(self.goal)}: {self.seconds:.1f} s ({self.proof})</p><table>{rows}</table>"
        )


@dataclass(frozen=True)
class ObjectSearch:
    """Where to look for an object, and why (O'Neill, section 4.4.2).

    `problem` has places, viewpoints, travel times and rates; `decision` says what to do next, and
    the tour while nothing is found. `belief` says how probable each place is, as `Map.where` does.
    Looks are planned by one who doubts it: in `doubted`, half of each chance is the prior.
    `assumed_body` and `assumed_camera` say what was assumed for a robot without its URDF.
    """

    name: str
    belief: dict[str, float] = field(repr=False)
    problem: MapSearch = field(repr=False)
    decision: Decision
    map: MapTasks = field(repr=False, compare=False)
    options: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)
    assumed_body: str | None = field(default=None, repr=False)
    assumed_camera: str | None = field(default=None, repr=False)

    @property
    def seconds(self) -> float:
        """Expected seconds of the tour, until the object is found."""
        from planner.search.receding_horizon import tour_seconds

        return tour_seconds(self.problem.problem, self.problem.belief, self.decision.tour)

    @property
    def tour(self) -> list[Viewpoint]:
        """Where to look, in order, while the object is not found."""
        return [self.problem.viewpoints[number] for number in self.decision.tour]

    @property
    def doubted(self) -> dict[str, float]:
        """How probable each place is to who plans the looks."""
        search = self.problem.problem
        chances = search.by_place(self.problem.belief)[0].tolist()
        return dict(zip(search.places, chances, strict=True))

    @property
    def reason(self) -> str:
        """Why it begins where it begins, in sentences."""
        from planner.search.reader import DOUBTED
        from planner.search.search_mission import explain

        return explain(self.problem, self.problem.belief, self.decision) + DOUBTED

    def as_json(self) -> dict[str, Any]:
        """The search as plain values; poses are x, y, z and quaternion."""
        return {
            "object": self.name,
            "assumed_body": self.assumed_body,
            "assumed_camera": self.assumed_camera,
            "belief": self.belief,
            "doubted": self.doubted,
            "action": self.decision.action,
            "seconds": self.seconds,
            "unseen": self.problem.unseen,
            "tour": [
                {
                    "viewpoint": view.name,
                    "room": view.room,
                    "pose": view.pose._asdict(),
                    "camera": self.problem.sight.pose(view.pose, view.aim)._asdict(),
                    "shows": dict(view.shows),
                    "opens": view.opens,
                }
                for view in self.tour
            ],
        }

    def compare(self, trials: int, seed: int = 0) -> dict[str, Any]:
        """Seconds and rates of this and other strategies over random objects."""
        from planner.search.problem_builder import Detector
        from planner.search.trials import compare

        detector = self.options.get("detector") or Detector()
        return compare(self.problem, trials, seed, limit=detector.limit)

    def write_pomdp(self, path: Path | str, most_states: int = 1000) -> Path:
        """Write it as a ``.pomdp`` file for other solvers, with at most so many states.

        Spots that are seen alike are joined, and viewpoints left out, that cost the least; a
        comment in the file says how many. ValueError if there are too many still.
        """
        from planner.search.aggregation import aggregate
        from planner.search.pomdp import write_pomdp
        from planner.search.search_problem import as_pomdp

        small = aggregate(self.problem.problem, self.problem.belief, most_states)
        pomdp = as_pomdp(small.problem, small.belief, most_states=most_states)
        return write_pomdp(pomdp, Path(path), comment=str(small))

    def run(self, **options: Any) -> SimulatedMission:
        """Let a robot search; options are those of `Map.run`."""
        return self.map.run(f'found("{self.name}")', **self.options | options)

    def plot(self, storey: str | None = None) -> Picture:
        """Draw its looks, in their order, over the belief, on each storey that has some.

        `storey`: only this one.
        """
        from semmap.api.answer_pictures import search_picture

        return search_picture(self, storey)

    def _repr_png_(self) -> bytes:
        return self.plot().png

    def __repr__(self) -> str:
        return f"<search for {self.name}: {len(self.tour)} looks, {self.seconds:.0f} s expected>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{escape(view.name)}</td><td>{view.pose.x:.2f}, {view.pose.y:.2f}</td></tr>"
            for view in self.tour
        )
        return f"<p>{escape(self.reason)}</p><table>{rows}</table>"


def _step_as_json(step: RouteStep) -> dict[str, Any]:
    approach, leave = (None if p is None else p._asdict() for p in (step.approach, step.leave))
    return {
        "behaviour": step.behaviour,
        "connector": step.connector.name if step.connector else None,
        "elevator": step.elevator,
        "from": step.from_place,
        "to": step.to_place,
        "approach": approach,
        "leave": leave,
    }
