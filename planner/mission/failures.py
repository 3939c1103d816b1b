"""Failures on demand, as one says them: ``door5 locked``, ``pickup fails twice``."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["FailureRule"]

TIMES = {"once": 1, "twice": 2}
BEHAVIOURS = (
    "navigate", "open_door", "unlock_door", "pass_door", "call_elevator", "use_elevator",
    "switch_map", "pickup", "place", "drop",
)  # fmt: skip


@dataclass(frozen=True)
class FailureRule:
    """A door that is not as the map says, or a behaviour that fails.

    Attributes
    ----------
    what : a door, or a behaviour; drop: what it carries falls as it drives
    state : of a door
    times : so often it fails, from now on
    chance : so probably it fails each time, 0 to 1
    """

    what: str
    state: str | None = None
    times: int = 0
    chance: float = 0.0

    @classmethod
    def parse(cls, said: str) -> FailureRule:
        """A rule as it was said.

        Raises
        ------
        ValueError
            It is none; the message shows some.

        Examples
        --------
        >>> FailureRule.parse("pickup fails twice")
        FailureRule(what='pickup', state=None, times=2, chance=0.0)
        """
        words = said.split()
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
            f"{said!r} is no failure: say 'door5 locked', 'pickup fails twice', 'pass_door fails "
            f"0.1' (of ten once) or 'drop fails once'; behaviours: {', '.join(BEHAVIOURS)}"
        )
