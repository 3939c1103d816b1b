"""What robots learn about the objects of a map: shapes, attempts and their outcomes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from semmap.api.map_questions import MapQuestions

if TYPE_CHECKING:
    from semmap.found_rows import FoundRows
    from semmap.manipulation.candidates import Grasp
    from semmap.manipulation.trial import TrialOutcome

    Progress = Callable[[str, int, int], None]


class MapPractice(MapQuestions):
    """The part of `Map` about attempts of manipulation, by robots and in simulation."""

    def find_shapes(
        self,
        names: Sequence[str] | None = None,
        *,
        progress: Progress = lambda name, done, total: None,
    ) -> FoundRows:
        """Find and store the primitive of each model: sphere, cylinder, cone or cuboid.

        Parameters
        ----------
        names : of objects; by default all with a mesh, one of each model

        Returns
        -------
        FoundRows
            `entity`, `shape`, `size` (metres) and `inliers` of each model; `problems` has the
            reasons for meshes without a primitive.
        """
        from semmap.manipulation.store.shapes import store_shapes

        return store_shapes(self.connection, names, progress)

    def record_attempt(
        self,
        name: str,
        action: int,
        outcome: str,
        *,
        kind: str = "grasp",
        instead_of: int | None = None,
        robot: str | None = None,
        message: str | None = None,
        simulated: bool = False,
    ) -> int:
        """Store how an attempt ended; later questions propose the actions that succeed most.

        Returns the id of the attempt, as `list_manipulations` lists it.

        Parameters
        ----------
        action : the `action_id` of a row of `grasps`, `places` or `pushes`
        outcome : completed or error
        instead_of : the action that failed before and is replaced by this one
        robot : the agent that acted
        message : why it failed
        simulated : the outcome counts less

        Raises
        ------
        LookupError
            There is no such object, agent or action.
        ValueError
            A kind or an outcome that is not known, or two actions that cannot replace each other.
        """
        from semmap.manipulation.store.tasks import record_task

        return record_task(
            self.connection,
            name,
            kind,
            action=action,
            outcome=outcome,
            instead_of=instead_of,
            robot=robot,
            message=message,
            simulated=simulated,
        )

    def practise(
        self,
        name: str,
        *,
        on: str | None = None,
        push: bool = False,
        gripper: str | None = None,
        tries: int = 12,
        mass: float | None = None,
        friction: float = 0.5,
        attempt: Callable[[Grasp], TrialOutcome] | None = None,
    ) -> list[dict[str, Any]]:
        """Try actions on an object until one succeeds, in simulation, and store the outcomes.

        Parameters
        ----------
        on : try places of the object on this one; by default its grasps are tried
        push : try pushes
        gripper : a stored one; by default the preferred one
        tries : the most attempts
        mass : kilograms; by default the object's property, else by its volume
        friction : between the pads and the object
        attempt : does a grasp on a robot and returns its outcome, in place of the simulation

        Returns
        -------
        `action_id`, `family` and `outcome` of each attempt; of grasps `moved` (metres) and
        `stored`, the id of a corrected grasp; of others `off` (metres) and `tilted` (degrees).

        Raises
        ------
        LookupError, ValueError
            As `grasps`; `on` and `push` together or with `attempt`, or an object without such an
            action.
        """
        from semmap.manipulation import practice

        values: dict[str, Any] = {"tries": tries, "mass": mass, "friction": friction}
        if tries < 1:
            raise ValueError(f"tries is {tries}: give the most attempts, 1 or more")
        if on is not None and push:
            raise ValueError("give one of on and push")
        if attempt is not None:
            if on is not None or push:
                raise ValueError("attempt is for grasps: give neither on nor push")
            values |= {"attempt": attempt, "simulated": False}
        if on is not None:
            return practice.practise_places(self.connection, name, on, gripper, **values)
        of_kind = practice.practise_pushes if push else practice.practise
        return of_kind(self.connection, name, gripper, **values)

    def list_manipulations(self, limit: int = 20) -> list[dict[str, Any]]:
        """The newest attempts on objects of the map, with `kind`, `entity`, `robot`, `outcome`."""
        from semmap.manipulation.reader import list_tasks

        if limit < 1:
            raise ValueError(f"limit is {limit}: give the most rows, 1 or more")
        return list_tasks(self.connection, limit)
