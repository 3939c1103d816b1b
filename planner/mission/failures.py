"""Failures of a simulation, written as ``door5 locked`` or ``pickup fails twice``."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["FailureRule"]

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


@dataclass(frozen=True)
class FailureRule:
    """A state of a door that differs from the map, or a behaviour that fails.

    Attributes
    ----------
    what
        A door or a behaviour. ``drop``: the robot drops its load while it drives.
    state
        Of a door.
    times
        How often the behaviour fails from now on.
    chance
        Probability of each failure, 0 to 1.
    """

    what: str
    state: str | None = None
    times: int = 0
    chance: float = 0.0

    @classmethod
    def parse(cls, text: str) -> FailureRule:
        """The rule that a text describes.

        Raises
        ------
        ValueError
            The text is not a rule; the message shows examples.

        Examples
        --------
        >>> FailureRule.parse("pickup fails twice")
        FailureRule(what='pickup', state=None, times=2, chance=0.0)
        """
        words = text.split()
        if len(words) == 2 and words[1] in ("open", "closed", "locked"):
            return cls(words[0], state=words[1])
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
            f"{text!r} is not a failure; write 'door5 locked', 'pickup fails twice', "
            "'pass_door fails 0.1' (once in ten times) or 'drop fails once'; behaviours: "
            f"{', '.join(BEHAVIOURS)}"
        )
