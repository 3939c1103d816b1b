"""Failures of a simulation: ``door5 locked``, ``Lift 1 broken`` or ``pickup fails twice``."""

from __future__ import annotations

import re
from dataclasses import dataclass

from planner.topology import Topology
from semmap.error import Error
from semmap.suggestions import suggestion

BROKEN = "broken"  # the state of an elevator that neither comes nor leaves

_STATE = re.compile(rf"(?P<name>.*\S)\s+(?P<state>open|closed|locked|{BROKEN})")

TIMES = {"once": 1, "twice": 2}
BEHAVIOURS = (
    "navigate",
    "open_door",
    "unlock_door",
    "pass_door",
    "drive_through",
    "climb_stairs",
    "call_elevator",
    "use_elevator",
    "switch_map",
    "pickup",
    "place",
    "drop",
)


class UnknownFailureError(Error, LookupError):
    """A failure names a door or elevator that the map does not have."""


@dataclass(frozen=True)
class FailureRule:
    """A state of a door or elevator that differs from the map, or a behaviour that fails.

    `what` is a door, an elevator or a behaviour; ``drop`` drops the load while it drives. `state`
    is open, closed or locked, or broken for an elevator. The behaviour fails so many times from now
    on, or each time with a chance from 0 to 1.
    """

    what: str
    state: str | None = None
    times: int = 0
    chance: float = 0.0

    @classmethod
    def parse(cls, text: str) -> FailureRule:
        """The rule that a text describes; a ValueError shows examples.

        Examples
        --------
        >>> FailureRule.parse("pickup fails twice")
        FailureRule(what='pickup', state=None, times=2, chance=0.0)
        """
        named = _STATE.fullmatch(text.strip())
        if named is not None:
            return cls(named["name"], state=named["state"])
        words = text.split()
        if len(words) == 3 and words[1] == "fails" and words[0] in BEHAVIOURS:
            try:
                number = float(TIMES.get(words[2], words[2]))
            except ValueError:
                number = -1.0
            if number >= 1 and number == int(number):
                return cls(words[0], times=int(number))
            if 0 < number < 1:
                return cls(words[0], chance=number)
        raise ValueError(
            f"{text!r} is not a failure; write 'door5 locked', 'lift1 broken', "
            "'pickup fails twice', 'pass_door fails 0.1' (once in ten times) or "
            "'drop fails once'; behaviours: "
            f"{', '.join(BEHAVIOURS)}"
        )

    def check(self, topology: Topology) -> None:
        """Raise UnknownFailureError for a door or elevator that the map does not have."""
        if self.state is None:
            return
        what = "elevator" if self.state == BROKEN else "door"
        known = topology.cabins() if self.state == BROKEN else topology.connectors
        if self.what not in known:
            hint = suggestion(self.what, known, f"the map has no {what} of a similar name")
            raise UnknownFailureError(f"there is no {what} {self.what}{hint}")
