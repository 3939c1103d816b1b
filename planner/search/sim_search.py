"""A simulated robot that sees what its camera shows, and nothing else."""

from __future__ import annotations

import random
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from planner.live_topology import LiveTopology
from planner.mission.behaviours import PlaceLook, RobotObservation, Sighting
from planner.mission.command import Command
from planner.mission.sim_robot import SimulatedRobot, Work, behaviour, lasting
from planner.mission.sim_setup import body_options
from planner.mission.sim_world import SimWorld
from planner.mission.store.mission_list import MissionError
from planner.mission.store.missions import MissionStore
from planner.search.opened_furniture import STANDING
from planner.search.problem_builder import Detector
from planner.search.reader import (
    read_believed_object,
    read_entity_shapes,
    read_middle,
    read_room,
)
from planner.search.viewpoints import Sight
from semmap.arrays import Floats
from semmap.belief.places import BeliefPlace, place_around, place_at
from semmap.belief.views import visible_shares
from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import Pose
from semmap.query.storey_scene import NO_TRIANGLES, SceneEntity

RECOGNISED = 0.25  # share of an object's picture that must be in view
LEAST_SHARE = 0.02  # share of a place below which a look says nothing about it
SIDEWAYS = 0.1  # metres by which a robot misses a pose


@dataclass(frozen=True, eq=False)
class SimEyes:
    """What the camera of a simulated robot shows of the places at which an object may be.

    The containers `shut` must be opened before one sees into them. `seed` is that of detections and
    false alarms.
    """

    places: Sequence[BeliefPlace]
    entities: Mapping[str, SceneEntity]
    sight: Sight
    detector: Detector
    shut: frozenset[str] = frozenset()
    height: float = 0.1
    seed: int = 0

    def share_in_view(self, name: str, camera: Pose, objects: Mapping[str, Sighting]) -> float:
        """The share of an object's picture that no other one hides, where they truly are."""
        if name not in objects:
            return 0.0
        at = np.array(objects[name].pose[:3])
        if np.linalg.norm(at - camera[:3]) > self.sight.furthest:
            return 0.0
        own = self._placed(name, objects[name].pose)
        around = [self._placed(n, seen.pose) for n, seen in objects.items() if n != name]
        fixed = [e.triangles for n, e in self.entities.items() if n not in objects]
        others = self._in_reach([*around, *fixed], camera)
        view = self.sight.camera(camera)
        _, alone = view.image(own)
        _, faces = view.image(np.concatenate([own, others]))
        whole = int((alone >= 0).sum())
        return float(((faces >= 0) & (faces < len(own))).sum()) / whole if whole else 0.0

    def shares(self, camera: Pose, opened: frozenset[str], target: str) -> dict[str, float]:
        """The share of each place that a look from a pose of the camera shows, by the map."""
        fixed = [e.triangles for n, e in self.entities.items() if n != target]
        view = self.sight.camera(camera)
        depths, _ = view.image(self._in_reach(fixed, camera))
        return visible_shares(
            self.places,
            view,
            depths,
            furthest=self.sight.furthest,
            step=0.1,
            height=self.height,
            shut=self.shut,
            opened=opened,
        )

    def beside(self, base: Pose, names: Collection[str]) -> frozenset[str]:
        """Those of some places beside which the robot stands."""
        here = shapely.Point(base.x, base.y)
        return frozenset(
            place.name
            for place in self.places
            if place.name in names
            and place.footprint is not None
            and place.footprint.distance(here) <= STANDING + SIDEWAYS
        )

    def _in_reach(self, parts: Sequence[Floats], camera: Pose) -> Floats:
        """Those triangles (F, 3, 3) that may be in view."""
        triangles = np.concatenate([NO_TRIANGLES, *parts])
        eye, far = np.array(camera[:3]), self.sight.furthest
        near = (triangles.min(axis=1) <= eye + far) & (triangles.max(axis=1) >= eye - far)
        return np.asarray(triangles[near.all(axis=1)])

    def _placed(self, name: str, pose: Pose) -> Floats:
        """(F, 3, 3) the triangles of an object at its true pose."""
        entity = self.entities.get(name)
        if entity is None or not len(entity.triangles):
            half = self.height / 2
            return _at(box_mesh((-half, -half, -half), (half, half, half)).triangles, pose)
        return _at(entity.triangles, pose @ entity.pose.inverse())


def _at(triangles: Floats, pose: Pose) -> Floats:
    return pose.apply(triangles.reshape(-1, 3)).reshape(-1, 3, 3)


class SearchingRobot(SimulatedRobot):
    """A simulated robot that sees an object only if a look shows it, and opens containers."""

    def __init__(self, *arguments: Any, eyes: Mapping[str, SimEyes], **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._eyes = eyes
        self._looks: tuple[PlaceLook, ...] = ()
        self._known: set[str] = set()

    def observe(self) -> RobotObservation:
        """The robot, what it holds, what it knows to be around it, and the last look's answers."""
        seen = super().observe()
        looks, self._looks = self._looks, ()
        known = {name: s for name, s in seen.seen.items() if name in self._known}
        return replace(seen, seen=known, looks=looks)

    @behaviour
    def open_container(self, command: Command) -> Work:
        """Open a container, so that looks show what is in it."""
        yield from lasting(command.seconds)
        if self.fails("open_container"):
            return "missed", f"{command.arguments[0]} does not open"
        with self.world.change():
            self.world.log(self.name, "opened", command.arguments[0])
        return None, ""

    @behaviour
    def place(self, command: Command) -> Work:
        """Put an object down; the robot knows where it is then."""
        item = command.arguments[0]
        outcome = yield from self._placing(command)
        if outcome[0] is None:
            self._known.add(item)
            self._looks = (PlaceLook(item, command.arguments[-1], True),)
        return outcome

    @behaviour
    def look(self, command: Command) -> Work:
        """Look for an object; what the look shows is part of the next observation."""
        yield from lasting(command.seconds)
        name, world = command.arguments[0], self.world
        eyes = self._eyes[name]
        with world.change():
            place, base = world.robot(self.name)
            objects = world.objects()
            past = world.events()
            opened = frozenset(n for r, what, n in past if r == self.name and what == "opened")
            world.log(self.name, "looked", name)
        draw = random.Random(f"{eyes.seed} {self.name} {len(past)}")
        there, sighting = objects.get(name, ("", None))
        camera = command.camera or eyes.sight.pose(base, eyes.sight.rest)
        near = eyes.beside(base, opened.intersection(command.arguments[1:]))
        inside = sighting is not None and sighting.relation == "in" and sighting.holder
        if there != place:
            share = 0.0
        elif inside in near or inside in eyes.shut:
            share = float(inside in near)
        else:
            visible = {n: s for n, (p, s) in objects.items() if not world.has_robot(s.holder)}
            share = eyes.share_in_view(name, camera, visible)
        every = eyes.shares(camera, near, name)
        least = min(LEAST_SHARE, max(every.values(), default=0.0))  # each look says something
        shares = {p: s for p, s in every.items() if s >= least}
        found = None
        if share >= RECOGNISED and draw.random() < eyes.detector.hit and sighting is not None:
            point = sighting.pose[:3]
            at = place_at(eyes.places, point) or place_around(eyes.places, point)
            found = sighting.holder if inside in near or at is None else at.name
            self._known.add(name)
        elif shares and draw.random() < eyes.detector.false_alarm:
            found = draw.choices([*shares], [*shares.values()])[0]
            self._known.discard(name)
        else:
            self._known.discard(name)
        if found is not None:
            shares[found] = max(shares.get(found, 0.0), LEAST_SHARE)
        hit, false_alarm = eyes.detector.hit, eyes.detector.false_alarm / max(len(shares), 1)
        self._looks = tuple(  # a false alarm is at one of the places that the look shows
            PlaceLook(name, p, p == found, share, hit, false_alarm) for p, share in shares.items()
        )
        if found is not None:
            return None, f"{name} is seen at {found}"
        return None, f"{name} is not seen" + (f" at {', '.join([*shares][:4])}" if shares else "")


_PUT = re.compile(r"(?P<item>.+?) (?P<relation>on|in) (?P<target>.+)")


def searching_robot(
    live: LiveTopology,
    world: SimWorld,
    name: str,
    objects: Sequence[str],
    sight: Sight,
    detector: Detector,
    *,
    speed: float,
    seed: int = 0,
) -> SearchingRobot:
    """A robot that sees these objects only where its camera shows them; LookupError without one."""
    eyes = {}
    with live.snapshot() as seen:
        shapes = read_entity_shapes(seen) if objects else {}
        for target in objects:
            known = read_believed_object(seen, target)
            eyes[target] = SimEyes(
                known.places, shapes, sight, detector, known.all_shut, known.height, seed
            )
    return SearchingRobot(
        name, world, live.topology, eyes=eyes, **body_options(live, speed=speed, seed=seed)
    )


def find_spots(
    store: MissionStore, live: LiveTopology, texts: Sequence[str]
) -> list[tuple[str, str, Sighting]]:
    """Where objects truly are by texts such as ``mug on table2``: each with its room and pose.

    Raises MissionError: a text cannot be read, or nothing is free there; LookupError: a name is
    unknown.
    """
    spots = []
    for text in texts:
        found = _PUT.fullmatch(text.strip())
        if found is None:
            raise MissionError(
                f"{text!r} is not 'OBJECT on PLACE'; write for example 'mug on table1'"
            )
        item, target = found["item"].strip(), found["target"].strip()
        with live.snapshot() as seen:
            room = target if target in live.topology.places else read_room(seen, target)
            middle = None if room is None else read_middle(seen, target)
        if room is None:
            raise MissionError(f"no room holds {target}: name a place of the map that is in one")
        spot = store.spot(item, target, Pose(0.0, 0.0, live.topology.places[room].floor))
        if spot is None:
            raise MissionError(
                f"nothing is free on {target} for {item}, or the map has no such object"
            )
        inside = target == room
        if found["relation"] == "in" and not inside and middle is not None:
            x, y, z = middle
            inside, spot = True, spot._replace(x=x, y=y, z=z)
        spots.append((item, room, Sighting(target, "in" if inside else "on", spot)))
    return spots
