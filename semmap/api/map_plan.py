"""Plans and searches on their map: shown in a notebook, and carried out."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from planner.plan import Plan

if TYPE_CHECKING:
    from planner.search.problem_builder import MapSearch, Viewpoint
    from planner.search.receding_horizon import Decision
    from planner.simulated_run import SimulatedMission
    from semmap.api.map_tasks import MapTasks


@dataclass(frozen=True)
class MapPlan(Plan):
    """A `planner.Plan` that `Map.plan` made.

    Attributes
    ----------
    reasons : why a search goes where it goes, a sentence for each object that is searched for
    assumed : the objects of the plan for which the typical box of their type was assumed
    """

    assumed: tuple[str, ...] = field(default=(), kw_only=True)
    reasons: tuple[str, ...] = field(default=(), kw_only=True)
    map: MapTasks = field(repr=False, compare=False, kw_only=True)
    options: dict[str, Any] = field(default_factory=dict, repr=False, compare=False, kw_only=True)

    @classmethod
    def of(cls, map: MapTasks, plan: Plan, **more: Any) -> Self:
        """Return a plan with the map that it was made on."""
        return cls(**{f.name: getattr(plan, f.name) for f in fields(Plan)}, map=map, **more)

    def run(self, **options: Any) -> SimulatedMission:
        """Carry it out; options are those of `Map.run`."""
        return self.map.run(self.goal, **self.options | options)

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{number}</td><td>{escape(str(action))}</td>"
            f"<td>{action.seconds:.1f} s</td></tr>"
            for number, action in enumerate(self.actions, 1)
        )
        proof = "no plan is shorter" if self.optimal else f"at most {self.gap:.0%} longer than best"
        return f"<p>{escape(self.goal)}: {self.seconds:.1f} s ({proof})</p><table>{rows}</table>"


@dataclass(frozen=True)
class ObjectSearch:
    """Where to look for an object, and why (O'Neill, section 4.4.2).

    Attributes
    ----------
    problem : places, viewpoints, travel times and rates
    decision : what to do next, and the tour while nothing is found
    """

    name: str
    problem: MapSearch = field(repr=False)
    decision: Decision
    map: MapTasks = field(repr=False, compare=False)
    options: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    @property
    def seconds(self) -> float:
        """Expected seconds of the search, wrong answers included."""
        return self.decision.cost

    @cached_property
    def belief(self) -> dict[str, float]:
        """How probable each place is."""
        problem = self.problem.problem
        shares = problem.by_place(self.problem.belief)[0].tolist()
        return dict(zip(problem.places, shares, strict=True))

    @property
    def tour(self) -> list[Viewpoint]:
        """Where to look, in order, while the object is not found."""
        return [self.problem.viewpoints[number] for number in self.decision.tour]

    @property
    def reason(self) -> str:
        """Why it begins where it begins, in a sentence."""
        from planner.search.search_mission import explain

        return explain(self.problem, self.problem.belief, self.decision)

    def compare(self, trials: int, seed: int = 0) -> dict[str, Any]:
        """Seconds and rates of this and other strategies over random objects."""
        from planner.search.trials import compare

        return compare(self.problem, trials, seed)

    def write_pomdp(self, path: Path | str) -> Path:
        """Write it as a ``.pomdp`` file for other solvers."""
        from planner.search.pomdp_file import write_pomdp
        from planner.search.search_problem import as_pomdp

        return write_pomdp(as_pomdp(self.problem.problem, self.problem.belief), Path(path))

    def run(self, **options: Any) -> SimulatedMission:
        """Let a robot search; options are those of `Map.run`."""
        return self.map.run(f'found("{self.name}")', **self.options | options)

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{escape(view.name)}</td><td>{view.pose.x:.2f}, {view.pose.y:.2f}</td></tr>"
            for view in self.tour
        )
        return f"<p>{escape(self.reason)}</p><table>{rows}</table>"
