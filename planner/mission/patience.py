"""When to try again, when to try another way, and when to give up."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

__all__ = ["Failure", "Patience"]


@dataclass(frozen=True)
class Failure:
    """A step of a mission that failed: of what it was done to, and in a word why."""

    action: str
    subject: str | None
    cause: str
    said: str = ""


@dataclass(frozen=True)
class Patience:
    """How much a mission puts up with.

    Attributes
    ----------
    tries : so often may one behaviour fail on one subject, until the mission does without that
    failures : so many steps may fail in all
    wait : seconds, by the robot's clock, before a failure that is no fact is tried again
    queue : seconds, by the robot's clock, to wait for what another robot uses, before planning anew
    """

    tries: int = 3
    failures: int = 20
    wait: float = 1.0
    queue: float = 120.0

    def __post_init__(self) -> None:
        if self.tries < 1 or self.failures < 1 or self.wait < 0 or self.queue <= 0:
            raise ValueError(
                f"{self}: tries and failures are 1 or more, wait 0 or more, queue above 0 s"
            )

    def avoided(self, failures: Iterable[Failure]) -> dict[str, str]:
        """What a mission does without, after these failures, and why, in words.

        A locked door is none of them: the map says so itself.
        """
        counts: dict[tuple[str, str], int] = {}
        found: dict[str, str] = {}
        for failure in failures:
            if failure.subject is None or failure.cause in ("locked", *_NOBODYS):
                continue
            key = failure.action, failure.subject
            counts[key] = counts.get(key, 0) + 1
            if counts[key] >= self.tries:
                found[failure.subject] = (
                    f"{failure.action} of {failure.subject} failed {counts[key]} times: "
                    f"{failure.said or failure.cause}"
                )
        return found

    def at_an_end(self, failures: Iterable[Failure]) -> str | None:
        """Why it gives up, in words; None while it goes on."""
        real = [f for f in failures if f.cause not in _NOBODYS]
        ways = [f for f in real if f.subject is None]
        if len(ways) >= 2 * self.tries:
            return f"{ways[-1].action} failed {len(ways)} times: {ways[-1].said or ways[-1].cause}"
        if len(real) >= self.failures:
            return f"{len(real)} steps failed, at last: {real[-1].said or real[-1].cause}"
        return None


_NOBODYS = ("interrupted", "cancelled")
"""Causes that are no fault of what the robot did."""
