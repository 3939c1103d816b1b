"""A search over fewer spots and viewpoints, so that its states can be listed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.search.search_problem import SearchProblem, count_states
from semmap.arrays import Floats


@dataclass(frozen=True, eq=False)
class SmallerSearch:
    """A search with fewer states.

    Attributes
    ----------
    problem, belief : of the spots that were joined and the viewpoints that were kept; what a
        viewpoint shows of a spot is the mean over its parts, by their belief
    states : how many it has, and `former` how many the whole search had
    shown : the share of the belief that the viewpoints show, and `formerly` all of them
    """

    problem: SearchProblem
    belief: Floats
    states: int
    former: int
    shown: float
    formerly: float

    def __str__(self) -> str:
        """What was joined and left out, in words."""
        if self.states == self.former:
            return f"{self.states} states"
        return (
            f"{self.former} states joined to {self.states}: {len(self.problem.viewpoints)} "
            f"viewpoints show {self.shown:.0%} of the belief, all of them {self.formerly:.0%}"
        )


def aggregate(problem: SearchProblem, belief: Floats, most_states: int = 1000) -> SmallerSearch:
    """Join the states of a search until there are at most `most_states`.

    Step by step, two spots of a place are joined, or a viewpoint is left out, whichever loses the
    least belief for the states that it saves: of spots, as far as a viewpoint shows one more than
    the other, weighed as by Ward ("Hierarchical grouping to optimize an objective function", 1963);
    of a viewpoint, what no other one shows as well. A second look from a viewpoint may show a
    joined spot that the first did not: its parts are not told apart. `belief` is (O, S). ValueError
    if one spot a place and one viewpoint are still too many.
    """
    fewer = _Fewer(problem, belief)
    former = fewer.states
    while fewer.states > most_states:
        if not fewer.reduce():
            raise ValueError(
                f"the search has {fewer.states} states with one viewpoint and one spot a place; "
                f"up to {most_states} are asked for: ask for more, or search for fewer objects"
            )
    small, spread = fewer.problem(problem), fewer.belief
    shown, formerly = _shown(small, spread), _shown(problem, belief)
    return SmallerSearch(small, spread, fewer.states, former, shown, formerly)


def _shown(problem: SearchProblem, belief: Floats) -> float:
    return float((belief * problem.visible.max(axis=0, initial=0.0)).sum() / len(belief))


class _Fewer:
    """The spots and viewpoints that are left, and what the next step would lose."""

    def __init__(self, problem: SearchProblem, belief: Floats) -> None:
        self.objects, self.shut = len(problem.objects), problem.opening > 0
        self.kept = np.arange(len(problem.viewpoints))
        self.place_of, self.visible = problem.place_of, problem.visible
        self.belief = belief
        self._pairs: dict[int, tuple[float, int, int]] = {}

    @property
    def states(self) -> int:
        shut = int(self.shut[self.kept].sum())
        return count_states(self.objects, len(self.place_of), len(self.kept), shut)

    def problem(self, whole: SearchProblem) -> SearchProblem:
        kept = self.kept
        return replace(
            whole,
            viewpoints=tuple(whole.viewpoints[k] for k in kept),
            place_of=self.place_of,
            visible=self.visible,
            travel=whole.travel[np.ix_(kept, kept)],
            start=whole.start[kept],
            opening=whole.opening[kept],
            shows=None if whole.shows is None else whole.shows[kept],
        )

    def reduce(self) -> bool:
        """Take the step that loses the least for what it saves; False if there is none."""
        spots, views = len(self.place_of), len(self.kept)
        join, pair = self._nearest()
        leave, view = self._least_view() if views > 1 else (np.inf, 0)
        if np.isfinite(join):
            join /= self.objects * np.log(spots / (spots - 1))
        if np.isfinite(leave):
            shut = bool(self.shut[self.kept[view]])
            leave /= np.log((views + 1) / views) + shut * np.log(2)
        if not np.isfinite(min(join, leave)):
            return False
        if join <= leave:
            self._join(*pair)
        else:
            self.kept = np.delete(self.kept, view)
            self.visible = np.delete(self.visible, view, axis=0)
            self._pairs.clear()
        return True

    def _least_view(self) -> tuple[float, int]:
        """The viewpoint whose belief the others show best, and what is lost without it."""
        order = np.sort(self.visible, axis=0)
        best, second = order[-1], order[-2]
        only = np.where(self.visible == best, best - second, 0.0)
        lost = only @ self.belief.sum(axis=0)
        return float(lost.min()), int(lost.argmin())

    def _nearest(self) -> tuple[float, tuple[int, int]]:
        """The two spots of a place that differ the least, and what is lost if they are one."""
        for place in np.unique(self.place_of).tolist():
            if place not in self._pairs:
                self._pairs[place] = self._nearest_in(np.flatnonzero(self.place_of == place))
        loss, *pair = min(self._pairs.values())
        return loss, (pair[0], pair[1])

    def _nearest_in(self, spots: NDArray[np.intp]) -> tuple[float, int, int]:
        if len(spots) < 2:
            return np.inf, 0, 0
        weight = self.belief[:, spots].sum(axis=0)
        shown = self.visible[:, spots]
        both = np.maximum(weight[:, None] + weight, 1e-300)
        apart = np.zeros((len(spots), len(spots)))
        for row in shown:
            np.maximum(apart, abs(row[:, None] - row), out=apart)
        loss = weight[:, None] * weight / both * apart
        loss[loss < 1e-12] = 0.0  # they are seen alike
        loss[np.tril_indices(len(spots))] = np.inf
        a, b = np.unravel_index(int(loss.argmin()), loss.shape)
        return float(loss[a, b]), int(spots[a]), int(spots[b])

    def _join(self, a: int, b: int) -> None:
        weight = self.belief[:, [a, b]].sum(axis=0)
        share = weight / weight.sum() if weight.sum() > 0 else np.full(2, 0.5)
        self.visible = self.visible.copy()
        self.visible[:, a] = np.minimum(self.visible[:, [a, b]] @ share, 1.0)
        self.belief = self.belief.copy()
        self.belief[:, a] += self.belief[:, b]
        self.visible = np.delete(self.visible, b, axis=1)
        self.belief = np.delete(self.belief, b, axis=1)
        place = int(self.place_of[a])
        self.place_of = np.delete(self.place_of, b)
        self._pairs = {
            key: (loss, one - (one > b), two - (two > b))
            for key, (loss, one, two) in self._pairs.items()
            if key != place
        }
