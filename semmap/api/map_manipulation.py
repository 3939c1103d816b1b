"""How robots act on objects of a map: grasps, places, pushes, openings; how attempts end."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from semmap.api.checked import EntityName
from semmap.api.map_questions import MapQuestions
from semmap.database.sure_connection import HAPPENED

if TYPE_CHECKING:
    from semmap.found_rows import FoundRows
    from semmap.manipulation.candidates import Grasp
    from semmap.manipulation.found_actions import FoundActions
    from semmap.manipulation.robot_actions import RobotActions
    from semmap.manipulation.trial import TrialOutcome

    Progress = Callable[[str, int, int], None]


class MapManipulation(MapQuestions):
    """The part of `Map` about actions on objects and what robots learn of them."""

    def grasps(
        self,
        name: EntityName | None = None,
        *,
        for_: str | None = None,
        at: Sequence[float] | None = None,
        shape: Sequence[Any] | None = None,
        tolerance: float | None = None,
        gripper: str | Path | None = None,
        kind: str = "grasp",
        stored: bool = False,
        check: bool = True,
        robot: str | Path | None = None,
        base: Sequence[float] | None = None,
        plan: bool = False,
        state: Mapping[str, float] | None = None,
        limit: int = 10,
    ) -> FoundActions:
        """How to grasp objects: the stored grasps, the best first, else generated ones.

        Generated grasps are stored for the model of the object and the gripper.

        Returns a sequence of rows (`semmap.manipulation.reader.actions_on` describes them) with
        `problems`, `generated` and `motion`.

        Parameters
        ----------
        name : an object, or a type: any object of it
        for_ : a function, such as ``drinking``: any object for it
        at : (x, y, z), metres: the object there
        shape : a shape alone, with its sizes in metres: ``("cylinder", 0.03, 0.1)``; as
            `Database.grasps_of_shape`
        tolerance : metres, of `at` (0.05) and of each size of `shape` (0.01)
        gripper : a stored one, or the path of a URDF; by default the preferred one
        kind : grasp, or a kind that is stored: place, push, turn, open or put
        stored : generate and store nothing
        check : leave out grasps at which the gripper touches other objects
        robot : only grasps that its arm reaches: a stored one, or the path of a URDF
        base : x, y (metres), yaw (radians) and, if known, z where the robot stands; by default
            the pose of the agent of its name
        plan : plan the motion of the arm to the first grasp that it can do, and back
        state : positions of its joints before the motion, radians or metres; others are at rest
        limit : the most rows

        Raises
        ------
        LookupError
            There is no such name, function, gripper or robot, or no object at the point.
        ValueError
            Not exactly one of `name`, `for_`, `at` and `shape`, or arguments that exclude others.
        """
        from semmap.manipulation.retrieval import (
            find_grasps,
            gripper_or_urdf,
            stored_actions,
        )
        from semmap.manipulation.unknown_objects import grasps_of_shape

        asked: dict[str, Any]
        if sum(given is not None for given in (name, for_, at, shape)) != 1:
            raise ValueError("give one of name, for_, at and shape")
        _at_least_one(limit)
        if shape is not None:
            if not shape:
                raise ValueError("shape is a name and sizes, such as ('sphere', 0.04)")
            _for_robots_only(robot=robot, base=base, plan=plan, state=state)
            asked = {"tolerance": 0.01 if tolerance is None else tolerance, "gripper": gripper}
            asked |= {"kind": kind, "limit": limit, "stored": stored}
            return grasps_of_shape(self.connection, shape[0], shape[1:], **asked)
        near = 0.05 if tolerance is None else tolerance
        asked = {"name": name, "function": for_, "point": at, "tolerance": near}
        with self.transaction():
            if robot is not None:
                if gripper is not None or stored or not check or kind != "grasp":
                    raise ValueError("a robot grasps with its own gripper, and checks the grasps")
                acting = self._robot(robot, base, plan=plan, state=state, limit=limit)
                found = acting.grasps(**asked)
            else:
                _for_robots_only(base=base, plan=plan, state=state)
                asked |= {"gripper": gripper_or_urdf(self.connection, gripper), "limit": limit}
                if stored or kind != "grasp":
                    found = stored_actions(self._seen, kind=kind, **asked)
                else:
                    found = find_grasps(self._seen, **asked, check=check)
        if not found.rows and not found.problems:
            found.problems.append(f"the map has no {name or f'object for {for_}'}")
        return found

    def places(
        self,
        name: EntityName,
        on: EntityName,
        *,
        gripper: str | Path | None = None,
        towards: Sequence[float] | None = None,
        robot: str | Path | None = None,
        base: Sequence[float] | None = None,
        plan: bool = False,
        state: Mapping[str, float] | None = None,
        limit: int = 10,
    ) -> FoundActions:
        """Where and how to put an object down: stored places, the best first, else generated ones.

        Returns rows as of `grasps`; also `spot`, the pose of the object where it stands, and
        `clearance` in metres.

        Parameters
        ----------
        name, on : the object, and the one on which it is put, such as a table
        towards : (x, y), metres: spots near it come first; by default those with most room
        gripper, robot, base, plan, state, limit : as for `grasps`; the object is in the gripper

        Raises
        ------
        LookupError, ValueError
            As `grasps`; the object has no mesh, or the other one no level surface.
        """
        asked: dict[str, Any] = {"towards": towards, "gripper": gripper, "limit": limit}
        reach: dict[str, Any] = {"robot": robot, "base": base, "plan": plan, "state": state}
        return self._found("places", name, on, **asked, **reach)

    def pushes(
        self,
        name: EntityName,
        *,
        distance: float = 0.1,
        gripper: str | Path | None = None,
        robot: str | Path | None = None,
        base: Sequence[float] | None = None,
        plan: bool = False,
        state: Mapping[str, float] | None = None,
        limit: int = 10,
    ) -> FoundActions:
        """How to push an object along its support: stored pushes, else generated ones.

        Returns rows as of `grasps`; also `end`, the pose of the gripper at the end, and
        `direction`, degrees in the map's frame.

        Parameters
        ----------
        name : the object
        distance : metres that the object is pushed
        gripper, robot, base, plan, state, limit : as for `grasps`; the gripper is closed

        Raises
        ------
        LookupError, ValueError
            As `grasps`; the object has no mesh, or stands on nothing level.
        """
        asked: dict[str, Any] = {"distance": distance, "gripper": gripper, "limit": limit}
        reach: dict[str, Any] = {"robot": robot, "base": base, "plan": plan, "state": state}
        return self._found("pushes", name, **asked, **reach)

    def openings(
        self,
        name: EntityName,
        *,
        hinge: Sequence[float] | None = None,
        slide: Sequence[float] | None = None,
        travel: float | None = None,
        gripper: str | Path | None = None,
        robot: str | Path | None = None,
        base: Sequence[float] | None = None,
        plan: bool = False,
        state: Mapping[str, float] | None = None,
        limit: int = 10,
    ) -> FoundActions:
        """How to open a door or drawer by its handle: stored ways, else generated ones.

        Returns rows as of `grasps`; also `end`, the pose of the gripper where the way ends, and
        `travel`, below 0 against the axis. What opens, how far it opens and where it is closed are
        known of parts that were imported from URDF or MJCF; other axes are stated.

        With `plan`, the only row has `joints`, the names of D joints of the arm, and positions of
        them in radians or metres, lists (N, D): `to_pre_grasp` leads to where the approach begins,
        `approach_positions` to the handle, `open_positions` leads the part along its way, and
        `back_positions` leave it and lead to the start. `path` is the id of the stored path of
        `to_pre_grasp`. An empty list is left out.

        Parameters
        ----------
        name : the part that moves, or its handle
        hinge : x, y, z, dx, dy, dz: a point (metres) and the direction of its axis, map's frame;
            it turns right-handed. By default that of its joint
        slide : dx, dy, dz: the direction in which it slides, map's frame
        travel : radians or metres from where it is, below 0 against the axis; by default as far as
            its joint allows. Where only stored ways tell how it slides, metres along them
        gripper, robot, base, plan, state, limit : as for `grasps`

        Raises
        ------
        LookupError, ValueError
            As `grasps`; the object has no mesh, nothing tells how it moves or where a travel below
            0 leads, it is open already, or its joint does not allow the travel.
        """
        asked: dict[str, Any] = {"hinge": hinge, "slide": slide, "travel": travel}
        asked |= {"gripper": gripper, "limit": limit}
        reach: dict[str, Any] = {"robot": robot, "base": base, "plan": plan, "state": state}
        return self._found("openings", name, **asked, **reach)

    def turns(
        self,
        name: EntityName,
        *,
        hinge: Sequence[float] | None = None,
        travel: float | None = None,
        gripper: str | Path | None = None,
        robot: str | Path | None = None,
        base: Sequence[float] | None = None,
        plan: bool = False,
        state: Mapping[str, float] | None = None,
        limit: int = 10,
    ) -> FoundActions:
        """How to push a door about its hinge with closed fingers: stored ways, else generated ones.

        Returns rows as of `openings`. By default, an open door is closed, and a closed one opened.

        With `plan`, the only row has `joints`, the names of D joints of the arm, and positions of
        them in radians or metres, lists (N, D): `to_pre_push` leads to where the approach begins,
        `approach_positions` to the door, and `turn_positions` push it along its way, at the end of
        which the arm stays. `path` is the id of the stored path of `to_pre_push`.

        Parameters
        ----------
        name, hinge, travel : as for `openings`
        gripper, robot, base, plan, state, limit : as for `grasps`; the gripper is closed

        Raises
        ------
        LookupError, ValueError
            As `openings`; the part slides.
        """
        asked: dict[str, Any] = {"hinge": hinge, "travel": travel}
        asked |= {"gripper": gripper, "limit": limit}
        reach: dict[str, Any] = {"robot": robot, "base": base, "plan": plan, "state": state}
        return self._found("turns", name, **asked, **reach)

    def _found(
        self,
        what: str,
        *names: str,
        gripper: str | Path | None,
        limit: int,
        robot: str | Path | None,
        base: Sequence[float] | None,
        plan: bool,
        state: Mapping[str, float] | None,
        **asked: Any,
    ) -> FoundActions:
        """The actions `what` of `robot_actions.FINDERS`, of a gripper alone or of a robot."""
        from semmap.manipulation.retrieval import gripper_or_urdf
        from semmap.manipulation.robot_actions import FINDERS

        _at_least_one(limit)
        with self.transaction():
            if robot is not None:
                acting = self._robot(robot, base, gripper, plan=plan, state=state, limit=limit)
                return acting.found(what, *names, **asked)
            _for_robots_only(base=base, plan=plan, state=state)
            hand = gripper_or_urdf(self.connection, gripper)
            find, _, _ = FINDERS[what]
            return find(self._seen, *names, gripper=hand, limit=limit, **asked)

    # --- shapes, attempts and their outcomes

    def find_shapes(
        self,
        names: Sequence[EntityName] | None = None,
        *,
        progress: Progress = lambda name, done, total: None,
    ) -> FoundRows:
        """Find and store the primitive of each model: sphere, cylinder, cone or cuboid.

        Returns `entity`, `shape`, `size` (metres) and `inliers` of each model; `problems` has the
        reasons for meshes without a primitive.

        Parameters
        ----------
        names : of objects; by default all with a mesh, one of each model
        """
        from semmap.manipulation.store.model_shapes import store_shapes

        return store_shapes(self._seen, names, progress)

    def record_attempt(
        self,
        name: EntityName,
        action: int | None,
        outcome: str,
        *,
        kind: str = "grasp",
        instead_of: int | None = None,
        robot: EntityName | None = None,
        message: str | None = None,
        simulated: bool = False,
    ) -> int:
        """Store how an attempt ended; later questions propose the actions that succeed most.

        Returns the id of the attempt, as `list_manipulations` lists it.

        Parameters
        ----------
        name : the object
        action : the `action_id` of a row of `grasps`, `places`, ...; None: no stored one
        outcome : completed or error
        kind : grasp, place, push, turn, open or put
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
        name: EntityName,
        *,
        on: EntityName | None = None,
        push: bool = False,
        open_: bool = False,
        turn: bool = False,
        gripper: str | None = None,
        tries: int = 12,
        mass: float | None = None,
        friction: float = 0.5,
        attempt: Callable[[Grasp], TrialOutcome] | None = None,
    ) -> list[dict[str, Any]]:
        """Try actions on an object until one succeeds, in simulation, and store the outcomes.

        Returns `action_id`, `family` and `outcome` of each attempt; of grasps `moved` (metres) and
        `stored`, the id of a corrected grasp; of places and pushes `off` (metres) and `tilted`
        (degrees); of openings and turns `opened`, the share of the way.

        Parameters
        ----------
        name : the object
        on : try places of the object on this one; by default its grasps are tried
        push : try pushes of the object
        open_, turn : try ways to open it, or to turn it
        gripper : a stored one; by default the preferred one
        tries : the most attempts
        mass : kilograms; by default the object's property, else by its volume
        friction : between the pads and the object
        attempt : does a grasp on a robot and returns its outcome, in place of the simulation

        Raises
        ------
        LookupError, ValueError
            As `grasps`; several of `on`, `push`, `open_` and `turn`, or one with `attempt`, or an
            object without such an action.
        """
        from semmap.manipulation import practice

        values: dict[str, Any] = {"tries": tries, "mass": mass, "friction": friction}
        if tries < 1:
            raise ValueError(f"tries is {tries}: give the most attempts, 1 or more")
        if (on is not None) + push + open_ + turn > 1:
            raise ValueError("give one of on, push, open_ and turn")
        if attempt is not None:
            if on is not None or push or open_ or turn:
                raise ValueError("attempt is for grasps: give none of on, push, open_ and turn")
            values |= {"attempt": attempt, "simulated": False}
            HAPPENED.act()
        if on is not None:
            return practice.practise_places(self._seen, name, on, gripper, **values)
        if open_ or turn:
            aim: Literal["open", "turn"] = "open" if open_ else "turn"
            return practice.practise_openings(self._seen, name, aim, gripper, **values)
        of_kind = practice.practise_pushes if push else practice.practise
        return of_kind(self._seen, name, gripper, **values)

    def list_manipulations(self, limit: int = 20) -> list[dict[str, Any]]:
        """The newest attempts on objects of the map, with `kind`, `entity`, `robot`, `outcome`."""
        from semmap.manipulation.reader import list_tasks

        _at_least_one(limit)
        return list_tasks(self._seen, limit)

    def _robot(
        self,
        robot: str | Path,
        base: Sequence[float] | None,
        gripper: str | Path | None = None,
        **options: Any,
    ) -> RobotActions:
        from semmap.manipulation.robot_actions import RobotActions

        if gripper is not None:
            raise ValueError(f"{robot} has its own gripper: give one of robot and gripper")
        return RobotActions.of(self._seen, robot, base, **options)


def _at_least_one(limit: int) -> None:
    if limit < 1:
        raise ValueError(f"limit is {limit}: give the most rows, 1 or more")


def _for_robots_only(**given: Any) -> None:
    names = [name for name, value in given.items() if value not in (None, False)]
    if names:
        raise ValueError(f"{' and '.join(names)}: only for a robot: name one by robot=")
