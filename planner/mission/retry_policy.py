"""When a mission tries again, when it avoids something, and when it gives up."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from semmap.geometry.pose import Pose


@dataclass(frozen=True)
class Failure:
    """A step of a mission that failed, with the entity that it acted on and the cause.

    `at` is the base pose of a pickup or a place.
    """

    action: str
    subject: str | None
    cause: str
    message: str = ""
    at: Pose | None = None

    @property
    def is_of_base(self) -> bool:
        """Whether the robot's gripper and arm could not do it from where its base stood."""
        return self.at is not None and self.cause in ("unable", "full")

    @property
    def is_final(self) -> bool:
        """Whether another attempt would be the same as this one, and fail alike."""
        return self.cause == "unfit" or (self.at is None and self.cause in ("unable", "full"))


@dataclass(frozen=True)
class RetryPolicy:
    """Limits on the failures of a mission.

    Attributes
    ----------
    tries
        Maximum failures of a behaviour on an entity before the mission avoids the entity; one where
        another attempt would be the same.
    failures
        Maximum failures of all steps.
    wait
        Seconds, by the robot's clock, before a failed step is tried again.
    queue
        Seconds, by the robot's clock, to wait for a claim before planning again.
    bases
        Maximum base poses from which the robot cannot pick an object up, or put one down on
        another, before the mission avoids that object.
    """

    tries: int = 3
    failures: int = 20
    wait: float = 1.0
    queue: float = 120.0
    bases: int = 4

    def __post_init__(self) -> None:
        if min(self.tries, self.bases, self.failures) < 1 or self.wait < 0 or self.queue <= 0:
            raise ValueError(
                f"{self}: tries, bases and failures are 1 or more, wait 0 or more, queue above 0 s"
            )

    def avoided(self, failures: Iterable[Failure]) -> dict[str, str]:
        """The entities that a mission avoids after these failures, each with the reason in words.

        Locked doors are not among them, since the map has their state.
        """
        counts: dict[tuple[str, str, Pose | None], int] = {}
        bases: dict[tuple[str, str], set[Pose]] = {}
        found: dict[str, str] = {}
        for failure in failures:
            if failure.subject is None or failure.cause in ("locked", *_NOT_COUNTED):
                continue
            at = failure.at if failure.is_of_base else None
            key = failure.action, failure.subject, at
            counts[key] = counts.get(key, 0) + 1
            tried = bases.setdefault(key[:2], set())
            if at is not None:
                tried.add(at)
            if failure.is_final or counts[key] >= self.tries or len(tried) >= self.bases:
                times = "once" if counts[key] == 1 else f"{counts[key]} times"
                where = f"from {len(tried)} base poses" if len(tried) > 1 else times
                refused = at is not None or failure.is_final
                word = "on" if failure.action == "place" and refused else "of"
                found[failure.subject] = (
                    f"{failure.action} {word} {failure.subject} failed {where}: "
                    f"{failure.message or failure.cause}"
                )
        return found

    def tried(self, failures: Iterable[Failure]) -> frozenset[tuple[str, Pose]]:
        """The base poses from which the robot could not reach objects, each with the object."""
        return frozenset(
            (failure.subject, failure.at)
            for failure in failures
            if failure.is_of_base and failure.subject is not None and failure.at is not None
        )

    def reason_to_give_up(self, failures: Iterable[Failure]) -> str | None:
        """Why the mission gives up, in words; None if it continues."""
        real = [f for f in failures if f.cause not in _NOT_COUNTED]
        ways = [f for f in real if f.subject is None]
        if len(ways) >= 2 * self.tries:
            return (
                f"{ways[-1].action} failed {len(ways)} times: {ways[-1].message or ways[-1].cause}"
            )
        if len(real) >= self.failures:
            return f"{len(real)} steps failed, at last: {real[-1].message or real[-1].cause}"
        return None


_NOT_COUNTED = ("interrupted", "cancelled")  # causes that do not count as failures of the robot
