"""Builds the search for an object from places, what hides them, and travel times."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import csr_array

from planner.route_search import seconds_between
from planner.routing_graph import Endpoint, RoutingGraph
from planner.search.line_of_sight import LineOfSight, line_of_sight
from planner.search.opened_furniture import (
    OPENING,
    aim_at,
    enclosed,
    is_opener,
    pose_before,
    pose_of,
    poses_beside,
)
from planner.search.search_problem import ELSEWHERE, SearchProblem
from planner.search.viewpoints import Aim, Sight, choose_views, free_positions, views_from
from planner.storey_costmaps import StoreyCostmaps
from planner.topology import OUTSIDE
from semmap.arrays import Floats
from semmap.belief.places import BeliefPlace, PlacePoints, sample_points
from semmap.belief.views import visible_points
from semmap.geometry.pose import Pose

SURFACE_STEP, FLOOR_STEP = 0.12, 0.4  # metres between the points of a surface, and of a floor
MOST_POINTS = 6000  # points; beyond, they are further apart
LEFT = 0.02  # share of what looks can show that a search may leave


@dataclass(frozen=True)
class Detector:
    """How well a robot recognises objects, and the worth of time.

    An object is found at a place if the belief there is `sure` or more. To end without that costs
    `missed` seconds: a look is worth its time if it takes less than its chance times `missed`. By
    default they are such that looks go on until the share `LEFT` of what they can show is left.
    """

    hit: float = 0.9  # P(an object is seen | it is in view)
    false_alarm: float = 0.02  # P(an object is seen where it is not)
    look: float = 3.0  # seconds of a look
    missed: float | None = None  # seconds that a search without a find costs
    sure: float = 0.95  # the belief in a place from which on the object is found there
    limit: float = 3600.0  # seconds of planned steps after which a search ends

    def __post_init__(self) -> None:
        for name in ("hit", "false_alarm", "sure"):
            if not 0 < getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name):g}; give a rate in (0, 1)")
        if self.false_alarm >= self.hit:
            raise ValueError(
                f"false_alarm is {self.false_alarm:g}, hit {self.hit:g}; what is there must be "
                "seen more often than what is not"
            )
        for name in ("look", "missed", "limit"):
            if getattr(self, name) is not None and not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} is {getattr(self, name)} s; give a number above 0")


@dataclass(frozen=True)
class Viewpoint:
    """Where the robot stands to look, and how; its name is the room and a number."""

    name: str
    room: str
    pose: Pose  # of the base, in the map's frame
    aim: Aim
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
    sight: Sight = field(default_factory=Sight)
    space: LineOfSight | None = None  # what is free of obstacles
    closed: tuple[str, ...] = ()  # places that must be opened, if the robot does not open things

    @property
    def in_view(self) -> float:
        """P(the object is where a viewpoint that the robot reaches shows it), before any look."""
        return _in_view(self.problem, self.belief)

    @property
    def unseen(self) -> list[str]:
        """Places where it may be that no look shows: from no pose that the robot reaches."""
        shown = {place for viewpoint in self.viewpoints for place, _ in viewpoint.shows}
        return [p for p in self.problem.places if p not in shown and p != ELSEWHERE]

    def nearest(self, room: str, pose: Pose, planned: int | None = None) -> int | None:
        """The viewpoint at which a robot is, of several the planned one; None if it is at none."""
        found = None
        for number, viewpoint in enumerate(self.viewpoints):
            away = math.dist(viewpoint.pose[:3], pose[:3])
            turned = math.remainder(viewpoint.pose.yaw - pose.yaw, math.tau)
            if viewpoint.room == room and away < 0.05 and abs(turned) < 0.05:
                if planned in (None, number):
                    return number
                found = number if found is None else found
        return found

    def from_here(self, start: Endpoint, graph: RoutingGraph, at: int | None) -> MapSearch:
        """The same search from another place of the robot, an endpoint of this graph.

        The robot is at the viewpoint `at`, or at none. The next way is that of the graph; none
        leads to what it does not reach. Ways between other viewpoints stay as they were.
        """
        ends = graph.endpoints([(v.room, v.pose) for v in self.viewpoints])
        seconds = seconds_between(graph, [start], ends)[0]
        travel = np.where(np.isfinite(seconds), self.problem.travel, np.inf)
        if at is not None:
            heights = np.array([v.aim.height for v in self.viewpoints])
            seconds = np.maximum(seconds, abs(heights - heights[at]) / self.sight.lift)
            seconds[at] = 0.0
            travel[at] = seconds
        return replace(self, problem=replace(self.problem, start=seconds, travel=travel))


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
    most_viewpoints: int = 400,
    progress: Callable[[str, int, int], None] | None = None,
) -> MapSearch:
    """The search for an object of a height, metres, whose place is believed.

    `belief` is P(place), `ELSEWHERE` at none of them. `places` are those of the belief, with their
    surfaces, and the rooms with their outlines. `occluders` (F, 3, 3), metres in the map's frame,
    hide what is behind them, without the object. The robot must open the places `shut`, those
    without a surface, and those into whose volume nothing sees, before it sees into them, if it
    opens things. `progress` is called for each place in which viewpoints are sought, with its name,
    its number, and how many there are. Raises ValueError: a place of the belief is missing, or the
    robot can see none of them.
    """
    sight, detector = sight or Sight(), detector or Detector()
    progress = progress or (lambda *_: None)
    space = line_of_sight(occluders)
    hidden = _where_it_may_be(name, belief, places, space, shut, height)
    rooms = {p.name: p for p in places if p.kind == "room" and p.footprint is not None}
    ends, aims, seen = _candidates(rooms, hidden, space, sight, graph, progress)
    stands, stand_of = _stands(ends)
    times = seconds_from(graph, start, stands)
    boxes = _boxes(occluders)
    looks: list[_Look] = []
    for number in choose_views(seen, hidden.chance, times[stand_of], most_viewpoints):
        end, aim = ends[number], aims[number]
        mask = _seen_on_meshes(sight, end, aim, hidden.at, occluders, boxes) & ~hidden.inside
        if mask.any():
            looks.append(_Look(end, aim, mask))
    opens = is_opener(graph.robot)
    if opens:
        looks += _looks_into(hidden, stands, times, rooms, sight)
    names = [place.name for place in hidden.places]
    if not looks:
        raise ValueError(
            f"no free pose that the robot reaches shows a place where {name} may be: "
            f"{', '.join(names[:5])}"
        )
    visible = np.array([look.mask for look in looks])
    place_of, spots, share = _spots(hidden.of, visible, hidden.share)
    viewpoints = _viewpoints(looks, hidden)
    endpoints = [look.end for look in looks]
    heights = np.array([look.aim.height for look in looks])
    lifted = abs(heights[:, None] - heights) / sight.lift
    problem = SearchProblem(
        (name,),
        (*names, ELSEWHERE),
        tuple(v.name for v in viewpoints),
        np.append(place_of, len(names)),
        np.pad(spots, ((0, 0), (0, 1))),
        np.maximum(_travel(graph, endpoints), lifted),
        seconds_between(graph, [start], endpoints)[0],
        detector.look,
        np.array([detector.hit]),
        np.array([detector.false_alarm]),
        1.0,
        np.array([0.0 if look.opens is None else OPENING for look in looks]),
    )
    share = np.append(share, 1.0)
    full = {p: belief[p] for p in names} | {ELSEWHERE: belief.get(ELSEWHERE, 0.0)}
    spread = problem.spread([full], share)
    missed = detector.missed or _missed(problem, spread)
    # from the belief `sure` on, a place costs less than to miss the object
    problem = replace(problem, missed=missed, wrong=missed / (1 - detector.sure))
    unable = () if opens else tuple(names[number] for number in hidden.closed)
    return MapSearch(problem, spread, viewpoints, share, graph, sight, space, unable)


class _Hidden(NamedTuple):
    """Where the object may be: N points at places, the most probable place first."""

    places: list[BeliefPlace]
    at: Floats  # (N, 3) metres in the map's frame
    of: NDArray[np.intp]  # (N,) the number of the place
    share: Floats  # (N,) P(point | place)
    chance: Floats  # (N,) P(point)
    inside: NDArray[np.bool_]  # (N,) seen only where its place is open

    @property
    def closed(self) -> list[int]:
        """The numbers of the places that must be opened."""
        found: list[int] = np.unique(self.of[self.inside]).tolist()
        return found


class _Look(NamedTuple):
    """A look that is a viewpoint: `mask` (N,) are the points that it shows."""

    end: Endpoint
    aim: Aim
    mask: NDArray[np.bool_]
    opens: str | None = None  # the place to open before it


def _where_it_may_be(
    name: str,
    belief: Mapping[str, float],
    places: Sequence[BeliefPlace],
    space: LineOfSight,
    shut: frozenset[str],
    height: float,
) -> _Hidden:
    """Points at the places of a belief; ValueError if one is not among `places`."""
    by_name = {place.name: place for place in places}
    unknown = [p for p in belief if p != ELSEWHERE and p not in by_name]
    if unknown:
        raise ValueError(
            f"{unknown[0]}: {name} is believed there, but it is not a place of the map"
        )
    likely = (p for p in belief if p != ELSEWHERE and belief[p] > 0)
    wanted = [by_name[p] for p in sorted(likely, key=lambda p: -belief[p])]
    at, of, share, within = _points(wanted, height)
    must_open = [p.name in shut or (p.kind != "room" and not p.surfaces) for p in wanted]
    inside = within & np.array(must_open, np.bool_)[of]
    unsure = np.flatnonzero(within & ~inside)
    inside[unsure] = enclosed(at[unsure], [wanted[k] for k in of[unsure]], space)
    chance = share * np.array([belief[p.name] for p in wanted])[of]
    return _Hidden(wanted, at, of, share, chance, inside)


def _looks_into(
    hidden: _Hidden,
    stands: Sequence[Endpoint],
    times: Floats,
    rooms: Mapping[str, BeliefPlace],
    sight: Sight,
) -> Iterator[_Look]:
    """A look into each place that must be opened, from before it."""
    for number in hidden.closed:
        place = hidden.places[number]
        if (end := pose_before(place, stands, times, rooms)) is not None:
            mask = hidden.inside & (hidden.of == number)
            yield _Look(end, aim_at(place, end, sight), mask, place.name)


def _viewpoints(looks: Sequence[_Look], hidden: _Hidden) -> tuple[Viewpoint, ...]:
    """The looks with what each shows."""
    found = []
    for k, (end, aim, mask, opens) in enumerate(looks, 1):
        shares = np.bincount(hidden.of[mask], hidden.share[mask], len(hidden.places))
        order = np.argsort(-shares, kind="stable")
        shows = tuple((hidden.places[p].name, float(shares[p])) for p in order if shares[p] > 0)
        found.append(Viewpoint(f"{end.place} {k}", end.place, pose_of(end), aim, shows, opens))
    return tuple(found)


def _missed(problem: SearchProblem, belief: Floats) -> float:
    """What it costs not to find the object, seconds, so that looks leave `LEFT` of their chances.

    They go on until an average look, which shows `LEFT` of what it showed at first, is not worth
    its time; each takes its share of the time from viewpoint to viewpoint, the nearest first. Where
    no way leads on, as behind a one-way door, the next one counts from the start. If no look shows
    the object, a search is worth no more than a look.
    """
    left = np.isfinite(problem.start)
    seconds, legs = 0.0, problem.start
    while left.any():
        if not np.isfinite(legs[left]).any():
            legs = problem.start
        nearest = int(np.where(left, legs, np.inf).argmin())
        seconds += float(legs[nearest] + problem.look + problem.opening[nearest])
        left[nearest], legs = False, problem.travel[nearest]
    chance = _in_view(problem, belief)
    return seconds / (LEFT * chance) if chance > 0 else problem.look


def _in_view(problem: SearchProblem, belief: Floats) -> float:
    """P(the object is where a viewpoint that the robot reaches shows it)."""
    shown = problem.visible[np.isfinite(problem.start)].max(axis=0, initial=0.0)
    return float(shown @ belief[0])


def _points(
    places: Sequence[BeliefPlace], height: float
) -> tuple[Floats, NDArray[np.intp], Floats, NDArray[np.bool_]]:
    """Points at which the object may be, (N, 3), and (N,) the number of the place of each.

    Also P(point | place) (N,), and which are within the volume of their place.
    """
    wider = 1.0
    while True:
        parts = [
            sample_points(p, wider * (FLOOR_STEP if p.kind == "room" else SURFACE_STEP), height / 2)
            for p in places
        ]
        if sum(len(p.at) for p in parts) <= MOST_POINTS or wider > 8:
            break
        wider *= 1.5
    for k, place in enumerate(places):
        if not len(parts[k].at):  # its outline is unknown
            within = np.array([place.kind != "room"])
            parts[k] = PlacePoints(np.full((1, 3), np.inf), np.ones(1), within)
    of = np.repeat(np.arange(len(places)), [len(p.at) for p in parts])
    at, weight, within = (np.concatenate(values) for values in zip(*parts, strict=True))
    return at, of, weight, within


def _candidates(
    rooms: Mapping[str, BeliefPlace],
    hidden: _Hidden,
    space: LineOfSight,
    sight: Sight,
    graph: RoutingGraph,
    progress: Callable[[str, int, int], None],
) -> tuple[list[Endpoint], list[Aim], csr_array]:
    """Free base poses in rooms, how the camera is held there, and (C, N) what each view shows."""
    costmaps = graph.costs if isinstance(graph.costs, StoreyCostmaps) else None
    seen: list[NDArray[np.intp]] = []
    ends: list[Endpoint] = []
    aims: list[Aim] = []
    points = hidden.at
    open_points = np.where(hidden.inside[:, None], np.inf, points)
    places = graph.topology.places
    for number, (name, place) in enumerate(places.items(), 1):
        progress(name, number, len(places))
        if name == OUTSIDE or name not in rooms or place.elevator is not None:
            continue
        outline = rooms[name].footprint
        near = shapely.distance(shapely.points(points[:, :2]), outline) <= sight.furthest
        if not near.any():
            continue
        positions = free_positions(name, place.floor, outline, space, costmaps)
        views, shown = views_from(positions, place.floor, open_points, space, sight)
        beside = poses_beside(positions, place.floor, points[hidden.inside])
        views += [(pose, sight.rest) for pose in beside]
        if views:
            seen += shown + [np.empty(0, np.intp)] * len(beside)
            aims += [aim for _, aim in views]
            ends += graph.endpoints([(name, pose) for pose, _ in views])
    counts = np.cumsum([0, *map(len, seen)])
    numbers = np.concatenate([np.empty(0, np.intp), *seen])
    shape = len(ends), len(points)
    return ends, aims, csr_array((np.ones(len(numbers)), numbers, counts), shape)


def _stands(ends: Sequence[Endpoint]) -> tuple[list[Endpoint], NDArray[np.intp]]:
    """The different endpoints, and (C,) the number of each."""
    different = {id(end): end for end in ends}
    numbers = {key: number for number, key in enumerate(different)}
    return [*different.values()], np.array([numbers[id(end)] for end in ends], np.intp)


def _boxes(triangles: Floats) -> tuple[Floats, Floats]:
    """The lowest and highest coordinates (F, 3) of triangles (F, 3, 3)."""
    a, b, c = np.moveaxis(triangles, 1, 0)  # four times as fast as min(axis=1)
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def _seen_on_meshes(
    sight: Sight,
    end: Endpoint,
    aim: Aim,
    points: Floats,
    occluders: Floats,
    boxes: tuple[Floats, Floats],
) -> NDArray[np.bool_]:
    """(N,) which points a look shows, by the depth image of what is near."""
    pose = sight.pose(pose_of(end), aim)
    eye = np.array(pose[:3])
    near = np.linalg.norm(points - eye, axis=1) <= sight.furthest
    low, high = boxes
    close = ((low <= eye + sight.furthest) & (high >= eye - sight.furthest)).all(axis=1)
    camera = sight.camera(pose)
    depths, _ = camera.image(occluders[close])
    mask = np.zeros(len(points), np.bool_)
    mask[near] = visible_points(camera, points[near], depths, sight.furthest)
    return mask


def _spots(
    of: NDArray[np.intp], visible: NDArray[np.bool_], weights: Floats
) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Points of one place that the same viewpoints show make a spot.

    `weights` (N,) are P(point | place). Returns place_of (S,), visible (V, S), and the share (S,)
    of the place that each spot is.
    """
    signature = np.concatenate([of[:, None], visible.T], axis=1)
    spots, number = np.unique(signature, axis=0, return_inverse=True)
    place_of = spots[:, 0].astype(np.intp)
    share: Floats = np.bincount(number.ravel(), weights, len(spots)).astype(float)
    visible_of: Floats = spots[:, 1:].T.astype(float)
    return place_of, visible_of, share


def seconds_from(graph: RoutingGraph, start: Endpoint, ends: Sequence[Endpoint]) -> Floats:
    """(C,) seconds from the robot to each endpoint; in its own room all at once.

    A robot that is anywhere in a room is not in a part without a way out, if others have one.
    """
    seconds = np.full(len(ends), np.inf)
    here = np.array([end.place == start.place for end in ends], np.bool_)
    elsewhere = [end for end in ends if end.place != start.place]
    seconds[~here] = seconds_between(graph, [start], elsewhere)[0]
    if start.pose is None:
        own = [end.seconds for end in ends if end.place == start.place]
        out = np.array([np.isfinite(times).any() for times in own], np.bool_)
        seconds[here] = np.where(out | ~out.any(), 0.0, np.inf)
    elif here.any():
        poses = [pose_of(end) for end in ends if end.place == start.place]
        seconds[here] = graph.costs.between(start.place, [start.pose], poses).seconds[0]
    return seconds


def _travel(graph: RoutingGraph, ends: Sequence[Endpoint]) -> Floats:
    """(V, V) seconds between viewpoints; in one room all at once."""
    seconds = np.full((len(ends), len(ends)), np.inf)
    by_room: dict[str, list[int]] = {}
    for number, end in enumerate(ends):
        by_room.setdefault(end.place, []).append(number)
    for room, numbers in by_room.items():
        poses = [pose_of(ends[k]) for k in numbers]
        seconds[np.ix_(numbers, numbers)] = graph.costs.between(room, poses, poses).seconds
        others = [k for k in range(len(ends)) if ends[k].place != room]
        seconds[np.ix_(numbers, others)] = seconds_between(
            graph, [ends[k] for k in numbers], [ends[k] for k in others]
        )
    np.fill_diagonal(seconds, 0.0)
    return seconds
