"""Finds the sites at which the goal lets the robot end."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.tasks.goal import ROBOT
from planner.tasks.problem import NoPlanError
from planner.tasks.problem_draft import ProblemDraft
from planner.tasks.reason_list import join_reasons
from planner.topology import OUTSIDE
from semmap.geometry.pose import Pose

SAME = 1e-3
"""Metres between two poses below which a drive from one to the other is none."""


class FinalSites:
    """The sites at which the robot may end; found on first use."""

    def __init__(self, draft: ProblemDraft) -> None:
        self.draft = draft

    @cached_property
    def all(self) -> list[tuple[int, str]]:
        """The numbers of the sites, each with its place or region; NoPlanError without one."""
        problem, sites = self.draft.problem, self.draft.sites
        ends: list[tuple[int, str]] = []
        reasons: list[str] = []
        for atom in problem.goal.atoms:
            if atom.relation != "in" or atom.words[0].text != ROBOT:
                continue
            for name in problem.regions[atom.words[1]]:
                if name == OUTSIDE:
                    continue
                for number in self._sites(name):
                    here = number == 0 or name == problem.state.place
                    if here or sites.is_reachable(number):
                        ends.append((number, name))
                    else:
                        reasons.append(sites.unreachable_reason(number, name))
            if not ends:
                raise NoPlanError(join_reasons(reasons) or f"{atom}: the robot fits nowhere there")
        return ends

    def _sites(self, name: str) -> list[int]:
        """The site of a place, or those of a region; where the robot is, if it is there already."""
        state, sites = self.draft.problem.state, self.draft.sites
        topology = sites.graph.topology
        if name in topology.places:
            return [sites.at(name, None)]
        region = next(r for r in topology.regions if r.name == name)
        found = sites.of_region(region)
        if state.place in region.places and state.pose is not None and region.contains(state.pose):
            here = state.pose.translation
            return [0, *(n for n in found if _distance(sites.all[n].pose, here) > SAME)]
        return found


def _distance(pose: Pose | None, point: NDArray[np.float64]) -> float:
    """Metres from a pose to a point; infinite without a pose."""
    return math.inf if pose is None else math.dist(pose.translation, point)
