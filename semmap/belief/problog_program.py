"""The belief as a program for ProbLog (O'Neill, appendix A.2), with the sign corrected.

It checks the closed form; its time grows exponentially with objects and observations.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.belief.error import BeliefError
from semmap.belief.inference import checked_column, checked_prior
from semmap.belief.observation_columns import Observations, observation_rates
from semmap.belief.occlusion import check_hiding
from semmap.belief.sighting_model import THESIS, SightingModel, SightingRates

RULES = """\
% Larger objects at the same place may hide smaller ones.
larger(L, X) :- volume(L, V), volume(X, W), V > W.
hidden(X, Y) :- behind(X, Y), larger(L, X), is_in(L, Y).

% Sightings: of a visible object, of a hidden one, and of one that is elsewhere.
P::seen(N) :- look(N, X, Y, _, Share), is_in(X, Y), \\+hidden(X, Y), rates(N, A, _), P is Share * A.
P::seen(N) :- look(N, X, Y, _, Share), is_in(X, Y), hidden(X, Y), rate_hidden(A), P is Share * A.
P::seen(N) :- look(N, X, Y, _, Share), \\+is_in(X, Y), rates(N, _, B), P is Share * B.
"""


def problog_program(
    prior: ArrayLike,
    observations: Observations,
    mobility: ArrayLike,
    objects: Sequence[str],
    places: Sequence[str],
    volume: ArrayLike | None = None,
    hides: float = 0.5,
    hidden: float = 0.3,
    model: SightingRates = THESIS,
) -> str:
    """Return a ProbLog program that queries the place of each object.

    Its answers agree with `infer`, and with `infer_with_occlusion` where volumes are given. Each
    look is a fact with a number, so that ProbLog does not merge looks of the same time.

    Parameters
    ----------
    prior, observations, mobility, model : as of `semmap.belief.inference.infer`
    objects, places : names of the rows and columns of the prior, each once
    volume, hides, hidden : as of `semmap.belief.occlusion.infer_with_occlusion`; without volumes,
        no object is hidden

    Raises
    ------
    BeliefError
        The arrays do not fit, or a name appears twice.

    Examples
    --------
    >>> look = Observations([0], [1], [11.0], [True])
    >>> program = problog_program([[0.5, 0.5]], look, [1.0], ["coke"], ["counter", "table"])
    >>> print(program.splitlines()[2])
    0.5::is_in('coke', 'counter'); 0.5::is_in('coke', 'table').
    """
    prior = checked_prior(prior, observations)
    mobility = checked_column("mobility", mobility, len(prior))
    _check_names("object", objects, prior.shape[0])
    _check_names("place", places, prior.shape[1])
    thing = [_atom(name) for name in objects]
    place = [_atom(name) for name in places]
    lines = ["% Where objects probably are. Each object is at one place.", ""]
    lines += [
        "; ".join(f"{p!r}::is_in({x}, {y})" for y, p in zip(place, row, strict=True) if p) + "."
        for x, row in zip(thing, prior.tolist(), strict=True)
    ]
    lines += [
        "",
        *(f"mobility({x}, {m!r})." for x, m in zip(thing, mobility.tolist(), strict=True)),
    ]
    if volume is not None:
        check_hiding(hides, hidden)
        sizes = checked_column("volume", volume, len(prior), above_zero=True).tolist()
        lines += [f"volume({x}, {v!r})." for x, v in zip(thing, sizes, strict=True)]
    else:
        lines.append("volume(_, 1.0).")
    lines += [f"{float(hides)!r}::behind(X, Y).", f"rate_hidden({float(hidden)!r}).", ""]
    lines += ["% Looks: number, object, place, age in seconds, visible share of the place."]
    lines += _looks(observations, thing, place)
    lines += ["", "% P(seen | there), P(seen | not there) of each look."]
    lines += _rates(observations, mobility, model)
    lines += ["", RULES]
    lines += [
        f"evidence(seen({i}))." if seen else f"evidence(\\+seen({i}))."
        for i, seen in enumerate(observations.seen)
    ]
    lines += ["query(is_in(_, _)).", ""]
    return "\n".join(lines)


def _looks(observations: Observations, thing: list[str], place: list[str]) -> list[str]:
    share = np.ones(len(observations)) if observations.share is None else observations.share
    ages, shares = observations.age.tolist(), share.tolist()
    looks = zip(observations.object, observations.place, ages, shares, strict=True)
    return [
        f"look({i}, {thing[o]}, {place[p]}, {age!r}, {part!r})."
        for i, (o, p, age, part) in enumerate(looks)
    ]


def _rates(
    observations: Observations, mobility: NDArray[np.float64], model: SightingRates
) -> list[str]:
    """The formula of the thesis where it applies, else the two rates of each look as numbers."""
    detector = np.zeros(len(observations), np.bool_)
    for column in (observations.hit, observations.false_alarm):
        if column is not None:
            detector |= ~np.isnan(column)
    as_numbers = detector if isinstance(model, SightingModel) else np.ones_like(detector)
    there, elsewhere = observation_rates(observations, mobility, model)
    lines = [
        f"rates({i}, {there[i].item()!r}, {elsewhere[i].item()!r})."
        for i in np.flatnonzero(as_numbers)
    ]
    if isinstance(model, SightingModel) and not as_numbers.all():
        lines += [f"by_age({i})." for i in np.flatnonzero(~as_numbers)]
        lines += [
            "rates(N, A, B) :- by_age(N), look(N, X, _, Age, _), mobility(X, M),",
            f"    A is {model.there!r} + {model.change!r} * exp(-Age * M / {model.seconds!r}),",
            f"    B is {model.elsewhere!r} - {model.change!r} * exp(-Age * M / {model.seconds!r}).",
        ]
    return lines


def _atom(name: str) -> str:
    """A quoted atom of Prolog."""
    return "'" + name.replace("\\", "\\\\").replace("'", "\\'").replace("\n", "\\n") + "'"


def _check_names(what: str, names: Sequence[str], count: int) -> None:
    if len(names) != count:
        raise BeliefError(f"{len(names)} names of {count} {what}s: give one each")
    for name, times in Counter(names).items():
        if times > 1:
            raise BeliefError(f"two {what}s are named {name!r}: give each another name")
