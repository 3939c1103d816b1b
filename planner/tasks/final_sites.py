"""Finds the sites at which the goal lets the robot end."""

from __future__ import annotations

from functools import cached_property

from planner.tasks.goal import ROBOT
from planner.tasks.problem import NoPlanError
from planner.tasks.problem_draft import ProblemDraft
from planner.tasks.reason_list import join_reasons
from planner.topology import OUTSIDE

__all__ = ["FinalSites"]


class FinalSites:
    """The sites at which the robot may end; found on first use."""

    def __init__(self, draft: ProblemDraft) -> None:
        self.draft = draft

    @cached_property
    def all(self) -> list[tuple[int, str]]:
        """The numbers of the sites, each with its place.

        Raises
        ------
        NoPlanError
            The robot reaches none of the places.
        """
        problem, sites = self.draft.problem, self.draft.sites
        ends: list[tuple[int, str]] = []
        reasons: list[str] = []
        for atom in problem.goal.atoms:
            if atom.relation != "in" or atom.words[0].text != ROBOT:
                continue
            for place in problem.regions[atom.words[1]]:
                if place == OUTSIDE:
                    continue
                number = sites.at(place, None)
                if place != problem.state.place and not sites.is_reachable(number):
                    reasons.append(sites.unreachable_reason(number, place))
                    continue
                ends.append((number, place))
            if not ends:
                raise NoPlanError(join_reasons(reasons))
        return ends
