"""Routes as people ask for them: to the fridge, to a kitchen, home (Deeken et al., section 5.2)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np

from planner.base_pose import NoBasePoseError, poses_in, poses_to_reach
from planner.ground import Ground
from planner.network import Network, Site
from planner.route import NoRouteError, Route
from planner.rules import Rules, barred_regions, forbid, penalties
from planner.target import Target
from planner.topology import Place, Region, UnknownPlaceError
from semmap.geometry.pose import Pose

__all__ = ["Asker", "Said"]

Said = str | Pose | Target | tuple[str, Pose]
"""A name, a label or a type; a pose, or a pose in a place; a target that was looked up."""


@dataclass
class Asker:
    """Answers for one class of robots.

    Attributes
    ----------
    look_up : gives the targets that a word may mean; by default places alone
    place_at : gives the place in which a pose is, or None
    names_like : gives further words that a word that means nothing may be meant for
    ground : its costmaps; without, a way to a thing ends in its room
    """

    network: Network
    look_up: Callable[[str], Sequence[Target]] = lambda said: ()
    place_at: Callable[[Pose], str | None] = lambda pose: None
    ground: Ground | None = None
    rules: Rules = field(default_factory=Rules.default)
    rng: np.random.Generator = field(default_factory=np.random.default_rng)
    names_like: Callable[[str], Sequence[str]] = lambda said: ()

    def route(
        self,
        start: Said,
        goal: Said,
        *,
        avoid: Sequence[str] = (),
        at: datetime | None = None,
        k: int = 1,
    ) -> list[Route]:
        """The k best routes, the best first; where several goals are meant, to the nearest.

        Parameters
        ----------
        avoid : names, labels or types of places, connectors and regions that it must not pass
        at : when: rules have hours

        Raises
        ------
        UnknownPlaceError
            A name that the map does not know.
        NoRouteError
            No way leads there, or the robot cannot stand there; it says why.
        """
        if k < 1:
            raise ValueError(f"ask for 1 route or more, not {k}")
        with self._ruled(avoid, at):
            starts = self._sites(start)
            if len({s.place for s in starts}) > 1:
                names = ", ".join(sorted({s.place for s in starts}))
                raise ValueError(f"{start} may be {names}; name one of them")
            goals = self._sites(goal)
            took = self.network.times_between(starts, goals)
            best = np.unravel_index(int(np.argmin(took)), took.shape)
            if not np.isfinite(took[best]):
                raise NoRouteError(self._why_none(starts, goals))
            a, b = starts[int(best[0])], goals[int(best[1])]
            if k == 1:
                return [self.network.route(a, b)]
            return self.network.alternatives(a, b, k)

    @contextmanager
    def _ruled(self, avoid: Sequence[str], at: datetime | None) -> Iterator[None]:
        """While it lasts, rules hold and what is to be avoided is barred."""
        rules = (*self.rules.rules, *forbid(avoid))
        for name in avoid:
            if not self._is_known(name):
                raise UnknownPlaceError(name, self._names())
        with ExitStack() as held:
            held.enter_context(self.network.lock)  # none takes our ways around for the way
            laid = penalties(self.network, rules, at, ground=self.ground)
            regions = barred_regions(self.network, rules, at) if self.ground is not None else []
            held.enter_context(self.network.penalised(laid.seconds, laid.bars, laid.walks))
            if self.ground is None:
                yield
                return
            former = {}
            for storey in {self.ground.storey_of(p) for r in regions for p in r.places}:
                former[storey] = self.ground.avoided(storey)
                here = [r for r in regions if storey in map(self.ground.storey_of, r.places)]
                self.ground.avoid(storey, [*former[storey], *here])
            try:
                yield
            finally:
                for storey, before in former.items():
                    self.ground.avoid(storey, before)

    def _is_known(self, name: str) -> bool:
        topology = self.network.topology
        things: list[Place | Region] = [*topology.places.values(), *topology.regions]
        return any(name in (c.name, c.type) for c in topology.connectors.values()) or any(
            name in (t.name, t.label, *t.types) for t in things
        )

    def _names(self) -> list[str]:
        topology = self.network.topology
        return [*topology.places, *topology.connectors, *(r.name for r in topology.regions)]

    # -- ends -----------------------------------------------------------------------------------

    def _sites(self, said: Said) -> list[Site]:
        """Where a robot may stand for what is said."""
        if isinstance(said, Target):
            return self._sites_of(self._placed(said))
        if isinstance(said, Pose):
            place = self.place_at(said)
            if place is None:
                names = self.ground.occupants(said) if self.ground is not None else ()
                there = f"; {', '.join(names)} is there" if names else ""
                raise NoRouteError(
                    f"({said.x:.2f}, {said.y:.2f}, {said.z:.2f}) is in no room{there}"
                )
            return [self._at(place, said)]
        if isinstance(said, tuple):
            return [self._at(said[0], said[1])]
        topology = self.network.topology
        if said in topology.places:
            return [self.network.site(said)]
        found = [self._placed(t) for t in self.look_up(said)]
        targets = [t for t in found if t.place in topology.places]
        if found and not targets:
            raise NoRouteError(f"no room holds {found[0].name}: move it into one, or draw its room")
        targets = targets or [
            Target(p.name, "room", p.name)
            for p in topology.places.values()
            if said == p.label or said in p.types
        ]
        if not targets:
            raise UnknownPlaceError(said, {*self._names(), *self.names_like(said)})
        sites: list[Site] = []
        why: NoRouteError | None = None
        for target in targets:
            try:
                sites += self._sites_of(target)
            except NoRouteError as error:
                why = why or error
        if not sites:
            raise NoRouteError(str(why))
        return sites

    def _placed(self, target: Target) -> Target:
        """With the room in which its pose is, where no room holds it."""
        if target.place is not None or target.pose is None:
            return target
        return replace(target, place=self.place_at(target.pose))

    def _sites_of(self, target: Target) -> list[Site]:
        place = target.place
        if place is None:
            raise NoBasePoseError(f"no room holds {target.name}")
        if target.kind == "room" or self.ground is None:
            return [self.network.site(place)]
        if target.kind == "agent" and target.pose is not None:
            return [self._at(place, target.pose, about=True)]
        if target.kind == "region":
            drawn = [
                self.network.site(place, pose) for pose in poses_in(self.ground, target, self.rng)
            ]
            reached = [s for s in drawn if np.isfinite(s.seconds).any()]
            return (reached or drawn)[:1]
        return [self.network.site(place, pose) for pose in poses_to_reach(self.ground, target)]

    def _at(self, place: str, pose: Pose, *, about: bool = False) -> Site:
        self.network.topology.place(place)
        why = self.ground.hindrance(place, pose, about=about) if self.ground is not None else None
        if why is not None:
            raise NoRouteError(
                f"{self.network.robot.name} cannot stand at ({pose.x:.2f}, {pose.y:.2f}) in "
                f"{place}: {why}"
            )
        return self.network.site(place, pose)

    def _why_none(self, starts: Sequence[Site], goals: Sequence[Site]) -> str:
        reasons = dict.fromkeys(self.network.why_not(a, b) for a in starts[:1] for b in goals[:3])
        return next(iter(reasons))
