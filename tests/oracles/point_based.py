"""A policy for a POMDP with up to hundreds of states, by point-based value iteration.

The value of the policy is the highest of a set of planes over the beliefs. Each plane is the value
of a plan that can be carried out, so the policy attains at least its value. The beliefs at which
planes are made spread outwards from the first one (Pineau, Gordon and Thrun 2003).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.search.pomdp import Pomdp

Floats = NDArray[np.float64]

CANDIDATES = 3000
"""Number of successors among which the next beliefs are chosen."""

PATIENCE = 1000
"""Number of steps within which an action that is repeated must end an undiscounted process."""


def checked(pomdp: Pomdp) -> Pomdp:
    """A POMDP; ValueError for other shapes, and for what is no distribution."""
    n, m, k = len(pomdp.states), len(pomdp.actions), len(pomdp.observations)
    for kind in ("state", "action", "observation"):
        names = getattr(pomdp, f"{kind}s")
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"{kind} {twice}: the name is used twice; name each {kind} once")
    shapes = {
        "transitions": (m, n, n),
        "likelihoods": (m, n, k),
        "rewards": (m, n),
        "start": (n,),
    }
    for name, shape in shapes.items():
        array = getattr(pomdp, name)
        if array.shape != shape:
            raise ValueError(f"{name}: its shape is {array.shape}; give {shape}")
        if not np.isfinite(array).all():
            raise ValueError(f"{name}: a value is not finite; give finite numbers")
    for name in ("transitions", "likelihoods", "start"):
        array = getattr(pomdp, name)
        if (array < 0).any() or (abs(array.sum(axis=-1) - 1) > 1e-9).any():
            at = np.argwhere((array < 0).any(axis=-1) | (abs(array.sum(axis=-1) - 1) > 1e-9))
            where = ", ".join(map(str, at[0])) if at.size else "the row"
            raise ValueError(
                f"{name}: {where} is not a distribution; give numbers from 0 on whose sum is 1"
            )
    if not 0 < pomdp.discount <= 1:
        raise ValueError(f"discount is {pomdp.discount}; give a number in (0, 1]")
    return pomdp


@dataclass(frozen=True, eq=False)
class SearchPolicy:
    """What to do at each belief, and what that is worth.

    Attributes
    ----------
    planes : (N, S) float64
        The value of each of N plans in each state; what follows a plan is among them as well.
    actions : (N,) int
        The first action of each plan.
    """

    planes: Floats
    actions: NDArray[np.intp]

    def value(self, belief: Floats) -> float:
        """The expected reward from a belief (S,) on; the policy attains it or more."""
        return float((self.planes @ belief).max())

    def action(self, belief: Floats) -> int:
        """The number of the best action at a belief (S,)."""
        return int(self.actions[np.argmax(self.planes @ belief)])


def solve(
    pomdp: Pomdp, *, most_beliefs: int = 200, sweeps: int = 20, tolerance: float = 1e-3
) -> SearchPolicy:
    """A policy for the beliefs that can follow from the first one.

    Parameters
    ----------
    most_beliefs
        Number of beliefs at which the value is improved.
    sweeps
        Most improvements of all beliefs at the end; on the way there, three.
    tolerance
        A sweep that raises no value by a larger share of that of the first belief is the last one.

    Returns
    -------
    SearchPolicy
        Its value is a lower bound of the best one.

    Raises
    ------
    ValueError
        The discount is 1, and no action ends the process.

    Examples
    --------
    Behind a door there is nothing or a prize; to look costs 1, to guess wrong 10.

    >>> import numpy as np
    >>> guess = np.tile([0.0, 0, 1], (3, 1))
    >>> look = np.array([[0.9, 0.1], [0.2, 0.8], [1.0, 0.0]])
    >>> silence = np.tile([1.0, 0.0], (3, 1))
    >>> door = Pomdp(
    ...     ("nothing", "prize", "end"), ("look", "say nothing", "say prize"), ("no", "yes"),
    ...     np.stack([np.eye(3), guess, guess]), np.stack([look, silence, silence]),
    ...     np.array([[-1.0, -1, 0], [0, -10, 0], [-10, 0, 0]]), np.array([0.5, 0.5, 0]))
    >>> policy = solve(door)
    >>> door.actions[policy.action(door.start)], round(policy.value(door.start), 1)
    ('look', -2.5)
    """
    plans = _Plans(*_repeated_actions(checked(pomdp)))
    now = np.arange(len(plans.actions))
    beliefs = pomdp.start[None]
    moves = [_next_state(t) for t in pomdp.transitions]
    full = False
    while True:
        values = (beliefs @ plans.planes[now].T).max(axis=1)
        for _ in range(sweeps if full else 3):
            now = _improve(pomdp, moves, plans, now, beliefs)
            before, values = values, (beliefs @ plans.planes[now].T).max(axis=1)
            if (values - before).max() <= tolerance * abs(values[-1]):
                break
        more = _spread(pomdp, beliefs, min(len(beliefs) + 3, most_beliefs - len(beliefs)))
        if full:
            needed = plans.with_followers(now)
            return SearchPolicy(plans.planes[needed], plans.actions[needed])
        full = not len(more) or len(more) + len(beliefs) >= most_beliefs
        beliefs = np.concatenate([more, beliefs])


class _Plans:
    """All plans that were made: their values, first actions, and how they go on.

    Attributes
    ----------
    followers : list of arrays
        The numbers of the plans that follow a plan, one for each observation that is possible.
    """

    def __init__(self, planes: Floats, actions: NDArray[np.intp]) -> None:
        self.planes, self.actions = planes, actions
        self.followers = [np.array([k], np.intp) for k in range(len(actions))]

    def add(
        self, planes: Floats, actions: NDArray[np.intp], followers: list[NDArray[np.intp]]
    ) -> NDArray[np.intp]:
        """Add plans; returns their numbers."""
        first = len(self.actions)
        self.planes = np.concatenate([self.planes, planes])
        self.actions = np.concatenate([self.actions, actions])
        self.followers += followers
        return np.arange(first, len(self.actions))

    def with_followers(self, plans: NDArray[np.intp]) -> NDArray[np.intp]:
        """The plans and all that may follow them: only among these can each be carried out."""
        needed = set(plans.tolist())
        left = list(needed)
        while left:
            more = set(self.followers[left.pop()].tolist()) - needed
            needed |= more
            left += more
        return np.array(sorted(needed), np.intp)


def _repeated_actions(pomdp: Pomdp) -> tuple[Floats, NDArray[np.intp]]:
    """The values of the plans that repeat one action for ever: lower bounds to begin with."""
    planes, actions = [], []
    for action, (move, reward) in enumerate(zip(pomdp.transitions, pomdp.rewards, strict=True)):
        if pomdp.discount < 1:
            step = np.eye(len(reward)) - pomdp.discount * move
            planes.append(np.linalg.solve(step, reward))
            actions.append(action)
            continue
        value, moved = reward, move
        for _ in range(int(np.log2(PATIENCE)) + 1):  # each time twice as many steps
            further = value + moved @ value
            if np.allclose(further, value, rtol=0, atol=1e-12):
                planes.append(value)
                actions.append(action)
                break
            value, moved = further, moved @ moved
    if not planes:
        raise ValueError("no action ends the process; give a discount below 1")
    return np.array(planes), np.array(actions, np.intp)


def _next_state(transition: Floats) -> NDArray[np.intp] | None:
    """(S,) the state that follows each one, if the action leaves nothing to chance."""
    following = transition.argmax(axis=1)
    certain = bool((transition[np.arange(len(transition)), following] == 1).all())
    return following if certain else None


def _improve(
    pomdp: Pomdp,
    moves: list[NDArray[np.intp] | None],
    plans: _Plans,
    now: NDArray[np.intp],
    beliefs: Floats,
) -> NDArray[np.intp]:
    """The numbers of the best plans at B beliefs, after one more step of looking ahead."""
    planes = plans.planes[now]
    values = beliefs @ planes.T
    kept = now[values.argmax(axis=1)]
    best, found = values.max(axis=1), plans.planes[kept]
    chosen = np.full(len(beliefs), -1)
    followers: list[NDArray[np.intp]] = [kept] * len(beliefs)
    for action, move in enumerate(moves):
        plane = np.broadcast_to(pomdp.rewards[action], beliefs.shape).copy()
        after = []
        for likelihood in pomdp.likelihoods[action].T:
            if not likelihood.any():
                continue
            weighted = planes * likelihood
            back = weighted[:, move] if move is not None else weighted @ pomdp.transitions[action].T
            likeliest = (beliefs @ back.T).argmax(axis=1)
            plane += pomdp.discount * back[likeliest]
            after.append(now[likeliest])
        value = np.einsum("bs,bs->b", beliefs, plane)
        then = np.stack(after, axis=1)
        for k in np.flatnonzero(value > best + 1e-9):
            best[k], found[k], chosen[k], followers[k] = value[k], plane[k], action, then[k]
    new = np.flatnonzero(chosen >= 0)
    _, first = np.unique(np.round(found[new], 6), axis=0, return_index=True)
    new = new[np.sort(first)]
    added = plans.add(found[new], chosen[new], [followers[k] for k in new])
    return np.concatenate([added, np.unique(kept[chosen < 0])])


def _spread(pomdp: Pomdp, beliefs: Floats, most: int) -> Floats:
    """Up to `most` successors of the beliefs, each as far as possible from those at hand."""
    found: list[Floats] = []
    for move, likelihood in zip(pomdp.transitions, pomdp.likelihoods, strict=True):
        joint = (beliefs @ move)[:, None, :] * likelihood.T[None]  # (B, O, S)
        chances = joint.sum(axis=2)
        possible = chances > 1e-6
        found.append(joint[possible] / chances[possible][:, None])
    candidates = np.concatenate(found)
    if len(candidates) > CANDIDATES:
        drawn = np.random.default_rng(len(beliefs)).permutation(len(candidates))[:CANDIDATES]
        candidates = candidates[drawn]
    away = np.full(len(candidates), np.inf)
    for belief in beliefs:
        np.minimum(away, abs(candidates - belief).sum(axis=1), out=away)
    added = []
    for _ in range(most):
        farthest = int(away.argmax())
        if away[farthest] < 1e-6:
            break
        added.append(candidates[farthest])
        np.minimum(away, abs(candidates - candidates[farthest]).sum(axis=1), out=away)
    return np.array(added).reshape(-1, beliefs.shape[1])
