"""Manipulation knowledge of all maps: grippers, robots with arms, and knowledge of others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from semmap.database.sure_connection import SureConnection
    from semmap.manipulation.found_actions import FoundActions


class DatabaseManipulation:
    """The part of `Database` about manipulation."""

    if TYPE_CHECKING:

        @property
        def session(self) -> SureConnection:
            """A psycopg connection with autocommit, its search path on the schema."""

    def grasps_of_shape(
        self,
        shape: str,
        size: Sequence[float],
        *,
        tolerance: float | None = None,
        gripper: str | Path | None = None,
        kind: str = "grasp",
        stored: bool = False,
        limit: int = 10,
    ) -> FoundActions:
        """The stored grasps of objects of a similar shape, else generated ones; shape's frame.

        Generated ones are not stored, and have no `action_id`.

        Parameters
        ----------
        shape : sphere (radius), cylinder and cone (radius, height), or cuboid (three sides)
        size : metres
        tolerance : the most by which a size may differ, metres; by default 0.01
        gripper : a stored one, or the path of a URDF; by default the preferred one
        kind : grasp, place, push, turn, open or put
        stored : generate nothing
        limit : the most rows

        Raises
        ------
        LookupError, ValueError
            There is no such gripper, or it is not a shape.
        """
        from semmap.manipulation.unknown_objects import grasps_of_shape

        options: Any = {"tolerance": 0.01 if tolerance is None else tolerance, "gripper": gripper}
        options |= {"kind": kind, "limit": limit, "stored": stored}
        return grasps_of_shape(self.session, shape, size, **options)

    def grasps_in_cloud(
        self,
        cloud: str | Path | ArrayLike,
        at: Sequence[float],
        *,
        tolerance: float | None = None,
        gripper: str | Path | None = None,
        limit: int = 10,
    ) -> FoundActions:
        """How to grasp what stands at a point of a cloud of a table; in the cloud's frame, z up.

        Grasps at which the gripper touches the table, other points or the object before it closes
        are left out. Nothing is stored.

        Parameters
        ----------
        cloud : a PLY or NPY file, or points (n, 3), metres
        at : (x, y, z), metres: a point on the object
        tolerance : metres from the point to the object; by default 0.05
        gripper : a stored one, or the path of a URDF; by default the preferred one
        limit : the most rows

        Raises
        ------
        LookupError
            There is no such gripper, or no object at the point.
        ValueError
            A cloud without a table, or a file that cannot be read.
        """
        from semmap.manipulation.unknown_objects import grasps_in_cloud
        from semmap.perception.point_cloud import read_cloud

        points = read_cloud(Path(cloud)) if isinstance(cloud, str | Path) else cloud
        options: Any = {"tolerance": 0.05 if tolerance is None else tolerance, "gripper": gripper}
        return grasps_in_cloud(self.session, points, at, limit=limit, **options)

    def add_gripper(
        self,
        urdf: str | Path,
        name: str | None = None,
        *,
        palm: str | None = None,
        prefer: bool | None = None,
        suction: float | None = None,
        force: float | None = None,
    ) -> str:
        """Store the gripper of a URDF, for which grasps are stored and generated; return its name.

        Parameters
        ----------
        urdf : of a gripper, or of a robot that has one
        name : by default that of the robot
        palm : the link that holds the fingers, or that is a suction cup; by default the first one
        prefer : it is meant where no gripper is named; by default the first one that is stored is
        suction : the gripper is a suction cup whose lip has this radius, metres; by default, where
            a link is named so and there are no fingers, with the radius of the end of its mesh
        force : of the vacuum of the suction cup, newtons; by default 60 kPa on its area

        Raises
        ------
        ValueError
            The file is not a usable URDF, or has no gripper.
        """
        from semmap.manipulation.gripper_reader import stated_cup
        from semmap.manipulation.retrieval import register_gripper

        path = Path(urdf)
        cup = stated_cup(path, palm, suction, force)
        return register_gripper(self.session, path, name, palm=palm, preferred=prefer, cup=cup)

    def list_grippers(self) -> list[dict[str, Any]]:
        """The stored grippers: `name`, `form`, `opening`, `depth` (metres), `force`, ..."""
        from semmap.manipulation.reader import list_grippers

        return list_grippers(self.session)

    def add_manipulator(
        self,
        urdf: str | Path,
        name: str | None = None,
        *,
        palm: str | None = None,
        posture: Mapping[str, float] | str | None = None,
        suction: float | None = None,
        force: float | None = None,
    ) -> str:
        """Store a robot with its arm, gripper and sensors, for `robot` of `Map.grasps`.

        Returns its name.

        Parameters
        ----------
        urdf : of the whole robot
        name : by default that in the URDF; missions of the class of this name use the arm
        palm : the link that holds the fingers, or that is a suction cup; by default the first one
        posture : positions of joints with which it drives and carries, radians or metres; or
            JSON, a file of it, or a state of its SRDF; by default one near the robot is found
        suction, force : of a suction cup, metres and newtons, as for `add_gripper`

        Raises
        ------
        ValueError
            The file is not a usable URDF, has no gripper or arm, or cannot take the posture.
        """
        from semmap.manipulation.automata import register_robot
        from semmap.manipulation.gripper_reader import stated_cup
        from semmap.robot.joint_positions import joints_of

        path = Path(urdf)
        cup = stated_cup(path, palm, suction, force)
        joints = joints_of(path, posture) if isinstance(posture, str) else posture
        return register_robot(self.session, path, name, palm=palm, posture=joints, cup=cup)

    def list_manipulators(self, can: Sequence[str] = ()) -> list[dict[str, Any]]:
        """The stored robots with arms: `name`, `gripper`, `sensor`, `sensors`, `capabilities`.

        `can` leaves those able to do all of these: grasp, push, ..., see, feel. LookupError if one
        is neither a kind of action nor a capability of any device.
        """
        from semmap.manipulation.reader import list_automata

        return list_automata(self.session, can)

    def import_grasps(
        self,
        paths: Sequence[str | Path],
        grippers: Mapping[str, str] | None = None,
        *,
        tool: Sequence[float] | None = None,
        scale: float = 1.0,
    ) -> dict[str, int]:
        """Store grasps of the Household Objects Database, or of files with its columns.

        Returns how many of each were stored.

        Parameters
        ----------
        paths : CSV, JSON or pg_dump, of grasps and of their models
        grippers : names of stored grippers by the hands in the files
        tool : x, y, z, qx, qy, qz, qw of the grasp frame in the frame of the file's hand; by
            default the same
        scale : metres per unit of the files

        Raises
        ------
        LookupError, ValueError
            There is no such gripper, or a file or row cannot be used; nothing is stored.
        """
        from semmap.manipulation.household_objects import import_household_grasps

        files = [Path(path) for path in paths]
        return import_household_grasps(self.session, files, grippers, tool=tool, scale=scale)

    def export_manipulation(
        self, path: str | Path, name: str | None = None, *, simulated: bool = False
    ) -> dict[str, int]:
        """Write the knowledge of this database to a signed file, for other robots.

        Returns how many `grippers`, `objects` and `actions` it has.

        Parameters
        ----------
        path : of the file
        name : of the contributor; by default that of this machine
        simulated : with outcomes of simulated robots

        Raises
        ------
        ValueError
            The name is not one for a contributor, or the file cannot be written.
        """
        import socket

        from semmap.manipulation.store.bundle import export_bundle

        chosen = socket.gethostname() if name is None else name
        return export_bundle(self.session, Path(path), chosen, simulated=simulated)

    def import_manipulation(self, path: str | Path) -> dict[str, int]:
        """Store the knowledge of a signed file, as a whole, of a contributor that is trusted.

        Returns how many `grippers`, `objects` and `actions` were new, and its `outcomes`.

        Raises
        ------
        ValueError
            The file was changed, nobody who is trusted signed it, or it cannot be used.
        """
        from semmap.manipulation.store.bundle import import_bundle

        return import_bundle(self.session, Path(path))

    @staticmethod
    def manipulation_key() -> str:
        """The public key with which `export_manipulation` signs, 64 digits; others trust it."""
        from semmap.manipulation.signing import own_key

        return bytes(own_key().verify_key).hex()

    def trust_contributor(self, name: str, key: str, level: float = 1.0) -> None:
        """Trust a contributor, so that its files can be imported.

        Parameters
        ----------
        name : of the contributor
        key : the 64 digits of its `manipulation_key`
        level : how much its outcomes count, 0 to 1; with 0 its files are refused

        Raises
        ------
        ValueError
            Not a key or a level, or the name or the key belongs to another contributor.
        """
        from semmap.manipulation.store.bundle import trust

        trust(self.session, name, key, level)

    def list_contributors(self) -> list[dict[str, Any]]:
        """Whose knowledge the database has: `name`, `trust`, `actions`, `attempts`, `key`, ..."""
        from semmap.manipulation.reader import list_contributors

        return list_contributors(self.session)
