"""Builds the search for an object from places, what hides them, and travel times."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from planner.route_search import seconds_between
from planner.routing_graph import Endpoint, RoutingGraph
from planner.search.line_of_sight import line_of_sight
from planner.search.search_problem import SearchProblem
from planner.search.viewpoints import Sight, choose_views, free_positions, views_from
from planner.storey_costmaps import StoreyCostmaps
from planner.topology import OUTSIDE
from semmap.belief.places import BeliefPlace, sample_points
from semmap.belief.views import visible_points
from semmap.geometry.pose import Pose

Floats = NDArray[np.float64]

ELSEWHERE = "elsewhere"

SURFACE_STEP, FLOOR_STEP = 0.12, 0.4
"""Metres between the points of a surface, and of a floor."""

MOST_POINTS = 6000
"""Number of points; beyond, they are further apart."""

OPENING = 8.0
"""Seconds to open a container."""

STANDING = 1.0
"""Metres from a shut container within which the robot can open it."""


@dataclass(frozen=True)
class Detector:
    """How well a robot recognises objects, and what time is worth.

    A wrong answer costs `wrong` seconds: with more, the robot looks longer before it answers.
    """

    hit: float = 0.9  # P(an object is seen | it is in view)
    false_alarm: float = 0.02  # P(an object is seen where it is not)
    look: float = 3.0  # seconds of a look
    wrong: float = 3600.0

    def __post_init__(self) -> None:
        for name in ("hit", "false_alarm"):
            if not 0 < getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name):g}; give a rate in (0, 1)")
        if self.false_alarm >= self.hit:
            raise ValueError(
                f"false_alarm is {self.false_alarm:g}, hit {self.hit:g}; what is there must be "
                "seen more often than what is not"
            )
        for name in ("look", "wrong"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} is {getattr(self, name)} s; give a number above 0")


@dataclass(frozen=True)
class Viewpoint:
    """Where the robot stands to look; its name is the room and a number."""

    name: str
    room: str
    pose: Pose  # of the base, in the map's frame
    shows: tuple[tuple[str, float], ...]  # places and visible shares, the largest first
    opens: str | None = None  # the container to open before the look


@dataclass(frozen=True, eq=False)
class MapSearch:
    """A search in a map, with the belief (1, S) over spots."""

    problem: SearchProblem
    belief: Floats
    viewpoints: tuple[Viewpoint, ...]  # in the order of the problem
    share: Floats  # (S,) the share of its place that each spot is
    graph: RoutingGraph  # of the travel times

    def nearest(self, room: str, pose: Pose) -> int | None:
        """The viewpoint at which a robot is; None if it is at none."""
        for number, viewpoint in enumerate(self.viewpoints):
            away = math.dist(viewpoint.pose[:3], pose[:3])
            turned = math.remainder(viewpoint.pose.yaw - pose.yaw, math.tau)
            if viewpoint.room == room and away < 0.05 and abs(turned) < 0.05:
                return number
        return None

    def from_here(self, start: Endpoint) -> MapSearch:
        """The same search from another place of the robot."""
        ends = _endpoints(self.graph, self.viewpoints)
        seconds = seconds_between(self.graph, [start], ends)[0]
        return replace(self, problem=replace(self.problem, start=seconds))


def build_search(
    name: str,
    belief: Mapping[str, float],
    places: Sequence[BeliefPlace],
    occluders: Floats,
    graph: RoutingGraph,
    start: Endpoint,
    *,
    height: float = 0.1,
    sight: Sight | None = None,
    detector: Detector | None = None,
    shut: frozenset[str] = frozenset(),
    most_viewpoints: int = 30,
    progress: Callable[[str, int, int], None] | None = None,
) -> MapSearch:
    """The search for an object of a height, metres, whose place is believed.

    `belief` is P(place), `ELSEWHERE` at none of them. `places` are those of the belief, with their
    surfaces, and the rooms with their outlines. `occluders` (F, 3, 3), metres in the map's frame,
    hide what is behind them, without the object. The robot must open the places `shut`, and those
    without a surface, before it sees into them. `progress` is called for each place in which
    viewpoints are sought, with its name, its number, and how many there are. Raises ValueError: a
    place of the belief is missing, or the robot can see none of them.
    """
    sight, detector = sight or Sight(), detector or Detector()
    by_name = {place.name: place for place in places}
    unknown = [p for p in belief if p != ELSEWHERE and p not in by_name]
    if unknown:
        raise ValueError(
            f"{unknown[0]}: {name} is believed there, but it is not a place of the map"
        )
    wanted = sorted(
        (p for p in belief if p != ELSEWHERE and belief[p] > 0), key=lambda p: -belief[p]
    )
    shut = shut | {p for p in wanted if by_name[p].kind != "room" and not by_name[p].surfaces}
    points, of = _points([by_name[p] for p in wanted], height)
    inside = np.array([wanted[k] in shut for k in of], np.bool_)
    counts = np.bincount(of, minlength=len(wanted))
    weights = np.array([belief[p] for p in wanted])[of] / counts[of]

    rooms = {p.name: p for p in places if p.kind == "room" and p.footprint is not None}
    poses, in_room, seen, seconds, ends = _candidates(
        rooms, points, inside, occluders, sight, graph, start, progress or (lambda *_: None)
    )
    chosen = choose_views(seen, weights, seconds, most_viewpoints)
    viewpoints: list[tuple[str, Pose, str | None]] = []
    masks: list[NDArray[np.bool_]] = []
    boxes = _boxes(occluders)
    endpoints: list[Endpoint] = []
    opening: list[float] = []
    for number in chosen:
        pose, room = poses[number], in_room[number]
        mask = _seen_on_meshes(sight, pose, points, occluders, boxes) & ~inside
        if mask.any():
            viewpoints.append((room, pose, None))
            masks.append(mask)
            endpoints.append(ends[number])
            opening.append(0.0)
    for place in [p for p in wanted if p in shut]:
        found = _before(by_name[place], poses, seconds)
        if found is not None:
            footprint = by_name[place].footprint
            assert footprint is not None
            middle, here = footprint.centroid, poses[found]
            yaw = math.atan2(middle.y - here.y, middle.x - here.x)
            viewpoints.append((in_room[found], Pose.planar(here.x, here.y, yaw, here.z), place))
            masks.append(np.array([wanted[k] == place for k in of], np.bool_))
            endpoints.append(replace(ends[found], pose=viewpoints[-1][1]))
            opening.append(OPENING)
    if not viewpoints:
        raise ValueError(
            f"no free pose that the robot reaches shows a place where {name} may be: "
            f"{', '.join(wanted[:5])}"
        )
    visible = np.array(masks)
    place_of, spots, share = _spots(of, visible, len(wanted))
    elsewhere = np.array([len(wanted)])
    all_places = (*wanted, ELSEWHERE)
    made = []
    for k, (room, pose, opens) in enumerate(viewpoints):
        shares = np.bincount(of[visible[k]], minlength=len(wanted)) / np.maximum(counts, 1)
        order = np.argsort(-shares, kind="stable")
        shows = tuple((wanted[p], float(shares[p])) for p in order if shares[p] > 0)
        made.append(Viewpoint(f"{room} {k + 1}", room, pose, shows, opens))
    problem = SearchProblem(
        (name,),
        all_places,
        tuple(v.name for v in made),
        np.concatenate([place_of, elsewhere]),
        np.concatenate([spots, np.zeros((len(made), 1))], axis=1),
        _travel(graph, endpoints),
        seconds_between(graph, [start], endpoints)[0],
        detector.look,
        np.array([detector.hit]),
        np.array([detector.false_alarm]),
        detector.wrong,
        np.array(opening),
    )
    shares_of_spots = np.concatenate([share, [1.0]])
    full = {p: belief[p] for p in wanted} | {ELSEWHERE: belief.get(ELSEWHERE, 0.0)}
    return MapSearch(
        problem, problem.spread([full], shares_of_spots), tuple(made), shares_of_spots, graph
    )


def _points(places: Sequence[BeliefPlace], height: float) -> tuple[Floats, NDArray[np.intp]]:
    """Points at which the object may be, (N, 3), and the number of the place of each."""
    wider = 1.0
    while True:
        parts = [
            sample_points(p, wider * (FLOOR_STEP if p.kind == "room" else SURFACE_STEP), height / 2)
            for p in places
        ]
        count = sum(map(len, parts))
        if count <= MOST_POINTS or wider > 8:
            break
        wider *= 1.5
    parts = [p if len(p) else np.full((1, 3), np.inf) for p in parts]  # its outline is unknown
    of = np.repeat(np.arange(len(places)), [len(p) for p in parts])
    return np.concatenate(parts), of


def _candidates(
    rooms: Mapping[str, BeliefPlace],
    points: Floats,
    inside: NDArray[np.bool_],
    occluders: Floats,
    sight: Sight,
    graph: RoutingGraph,
    start: Endpoint,
    progress: Callable[[str, int, int], None],
) -> tuple[list[Pose], list[str], NDArray[np.bool_], Floats, list[Endpoint]]:
    """Base poses, their rooms, the points that they show, seconds to them, and endpoints."""
    costmaps = graph.costs if isinstance(graph.costs, StoreyCostmaps) else None
    space = line_of_sight(occluders)
    poses: list[Pose] = []
    in_room: list[str] = []
    seen: list[NDArray[np.bool_]] = [np.empty((0, len(points)), np.bool_)]
    ends: list[Endpoint] = []
    open_points = np.where(inside[:, None], np.inf, points)
    places = graph.topology.places
    for number, (name, place) in enumerate(places.items(), 1):
        progress(name, number, len(places))
        if name == OUTSIDE or name not in rooms or place.elevator is not None:
            continue
        outline = rooms[name].footprint
        assert outline is not None
        near = shapely.distance(shapely.points(points[:, :2]), outline) <= sight.furthest
        if not near.any():
            continue
        positions = free_positions(name, place.floor, outline, space, costmaps)
        views, masks = views_from(positions, place.floor, open_points, space, sight)
        beside = _beside(positions, place.floor, points[inside])
        views += beside
        masks = np.concatenate([masks, np.zeros((len(beside), len(points)), np.bool_)])
        if not views:
            continue
        nodes = graph.nodes.get(name, np.empty(0, np.int64))
        travel = graph.costs.between(name, [graph.poses[n] for n in nodes], views)
        poses += views
        in_room += [name] * len(views)
        seen.append(masks)
        ends += [
            Endpoint(name, pose, nodes, travel.seconds[:, k], travel.metres[:, k])
            for k, pose in enumerate(views)
        ]
    seconds = _from_start(graph, start, ends)
    return poses, in_room, np.concatenate(seen), seconds, ends


def _beside(positions: Floats, floor: float, points: Floats) -> list[Pose]:
    """Poses near shut containers, whatever they show."""
    if not len(points) or not len(positions):
        return []
    away = np.linalg.norm(positions[:, None] - points[None, :, :2], axis=2).min(axis=1)
    return [Pose.planar(float(x), float(y), 0.0, floor) for x, y in positions[away <= 2.0]]


def _before(container: BeliefPlace, poses: Sequence[Pose], seconds: Floats) -> int | None:
    """The nearest candidate that stands beside a container; None if there is none."""
    if container.footprint is None or not len(poses):
        return None
    assert container.low is not None
    at = shapely.points([[p.x, p.y] for p in poses])
    level = np.array([abs(p.z - container.low[2]) < 2.0 for p in poses])
    near = (shapely.distance(at, container.footprint) <= STANDING) & level & np.isfinite(seconds)
    if not near.any():
        return None
    return int(np.where(near, seconds, np.inf).argmin())


def _boxes(triangles: Floats) -> tuple[Floats, Floats]:
    """The lowest and highest coordinates (F, 3) of triangles (F, 3, 3)."""
    a, b, c = np.moveaxis(triangles, 1, 0)  # four times as fast as min(axis=1)
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def _seen_on_meshes(
    sight: Sight, base: Pose, points: Floats, occluders: Floats, boxes: tuple[Floats, Floats]
) -> NDArray[np.bool_]:
    """(N,) which points a look shows, by the depth image of what is near."""
    eye = sight.eye(base)
    near = np.linalg.norm(points - eye, axis=1) <= sight.furthest
    low, high = boxes
    close = ((low <= eye + sight.furthest) & (high >= eye - sight.furthest)).all(axis=1)
    camera = sight.camera(base)
    depths, _ = camera.image(occluders[close])
    mask = np.zeros(len(points), np.bool_)
    mask[near] = visible_points(camera, points[near], depths, sight.furthest)
    return mask


def _spots(
    of: NDArray[np.intp], visible: NDArray[np.bool_], places: int
) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Points of one place that the same viewpoints show make a spot.

    Returns place_of (S,), visible (V, S), and the share (S,) of the place that each spot is.
    """
    signature = np.concatenate([of[:, None], visible.T], axis=1)
    spots, counts = np.unique(signature, axis=0, return_counts=True)
    whole = np.bincount(of, minlength=places)
    place_of = spots[:, 0].astype(np.intp)
    return place_of, spots[:, 1:].T.astype(float), counts / whole[place_of]


def _from_start(graph: RoutingGraph, start: Endpoint, ends: Sequence[Endpoint]) -> Floats:
    """(C,) seconds from the robot to each endpoint."""
    through = [replace(e, place=e.place) for e in ends]
    seconds = np.full(len(ends), np.inf)
    elsewhere = [k for k, e in enumerate(through) if e.place != start.place]
    here = [k for k, e in enumerate(through) if e.place == start.place]
    if elsewhere:
        seconds[elsewhere] = seconds_between(graph, [start], [through[k] for k in elsewhere])[0]
    if here:
        if start.pose is None:
            seconds[here] = 0.0
        else:
            poses = [p for k in here if (p := through[k].pose) is not None]
            seconds[here] = graph.costs.between(start.place, [start.pose], poses).seconds[0]
    return seconds


def _travel(graph: RoutingGraph, ends: Sequence[Endpoint]) -> Floats:
    """(V, V) seconds between viewpoints; in one room all at once."""
    seconds = np.full((len(ends), len(ends)), np.inf)
    by_room: dict[str, list[int]] = {}
    for number, end in enumerate(ends):
        by_room.setdefault(end.place, []).append(number)
    for room, numbers in by_room.items():
        poses = [p for k in numbers if (p := ends[k].pose) is not None]
        seconds[np.ix_(numbers, numbers)] = graph.costs.between(room, poses, poses).seconds
        others = [k for k in range(len(ends)) if ends[k].place != room]
        seconds[np.ix_(numbers, others)] = seconds_between(
            graph, [ends[k] for k in numbers], [ends[k] for k in others]
        )
    np.fill_diagonal(seconds, 0.0)
    return seconds


def _endpoints(graph: RoutingGraph, viewpoints: Sequence[Viewpoint]) -> list[Endpoint]:
    return [graph.endpoint(v.room, v.pose) for v in viewpoints]
