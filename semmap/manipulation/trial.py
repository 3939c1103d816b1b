"""Trials of grasps in simulation (MuJoCo): approach, close, lift, shake, and look what happened.

The gripper is the one of the URDF, its links are their convex hulls, and it flies on a given path.
The object stands on a table.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np
import trimesh
from scipy.spatial import QhullError
from scipy.spatial.transform import Rotation

from semmap.arrays import Floats
from semmap.geometry.mesh import Mesh
from semmap.manipulation.candidates import Grasp
from semmap.manipulation.convex_pieces import convex_pieces
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.extra import library, mujoco_pose
from semmap.manipulation.gripper import Gripper
from semmap.manipulation.placing import ABOVE
from semmap.manipulation.pushing import Push
from semmap.manipulation.solids import ConvexSolid, solid_hull
from semmap.manipulation.vacuum import Vacuum

STEP = 0.002
"""Seconds of a step of the simulation."""

SETTLE, APPROACH, CLOSE, LIFT, SHAKE = 0.1, 0.5, 0.5, 0.5, 0.5
"""Seconds of the phases of a trial."""

REST = 0.5
"""Seconds until it counts where an object is that was put down or pushed."""

HEIGHT = 0.15
"""Metres by which the object is lifted."""

SWAY = 0.02
"""Metres by which the gripper is shaken, 3 times a second."""

FORCE = 25.0
"""Newtons of a motor that slides fingers; one that turns them has as much at 10 cm."""


STIFFNESS = 2000.0
"""Newtons a metre by which such a motor holds its position."""


@dataclass(frozen=True, eq=False)
class Body:
    """An object for a trial, in kg: convex pieces of its mesh, or a solid at `pose` (4, 4)."""

    mesh: Mesh
    pieces: tuple[Mesh, ...]
    mass: float
    friction: float
    centre: Floats
    solid: ConvexSolid | None = None
    pose: Floats | None = None


def body_of(
    given: ConvexSolid | Mesh,
    *,
    pose: Floats | None = None,
    mass: float | None = None,
    density: float = 500.0,
    friction: float = 0.5,
    offset: Sequence[float] = (0.0, 0.0, 0.0),
    pieces: tuple[Mesh, ...] | None = None,
) -> Body:
    """An object for trials, of `mass` in kg, else of the density in kg/m³.

    A mesh is made up of convex pieces, by default `convex_pieces`, which takes 4 to 20 s of a mug.
    A solid lies at `pose` (4, 4); `offset` moves the centre of mass, metres, in the model's frame.
    """
    pose = np.eye(4) if pose is None else pose
    if isinstance(given, ConvexSolid):
        made = given.mesh()
        mesh = Mesh(made.vertices @ pose[:3, :3].T + pose[:3, 3], made.faces)
        pieces = (mesh,)
        volume, centre = given.volume, pose[:3, :3] @ given.centre + pose[:3, 3]
    else:
        mesh, pieces = given, convex_pieces(given) if pieces is None else pieces
        solids = [solid_hull(piece.vertices) for piece in pieces]
        volumes = np.array([each[0] for each in solids])
        volume = float(volumes.sum())
        centre = volumes @ np.array([each[1] for each in solids]) / volume
    mass = density * volume if mass is None else mass
    if not (mass > 0 and friction > 0):
        raise ManipulationError(
            f"object: mass {mass:g} kg and friction {friction:g}: above 0, each"
        )
    solid = given if isinstance(given, ConvexSolid) else None
    return Body(mesh, pieces, mass, friction, centre + np.array(offset), solid, pose)


@dataclass(frozen=True)
class TrialOutcome:
    """The outcome of a trial, as sensors would tell; metres and radians.

    The object rose by `lifted`; it was `pushed` before the fingers closed, moved by `shift` (3,) in
    the grasp frame while they did, and `slipped` and `turned` (rotation vector, grasp frame) in the
    gripper after that. `grip` is between the closed fingers before the lift, beyond their narrowest
    width, `width` between the pads at the end.
    """

    lifted: float
    slipped: float
    pushed: float
    grip: float
    width: float
    turned: tuple[float, float, float]
    shift: tuple[float, float, float]


@dataclass(frozen=True)
class Rest:
    """How an object rests: its centre of mass `moved`, after it was `lifted`; metres, radians."""

    moved: tuple[float, float, float]
    tilted: float
    lifted: float = 0.0


class Trial:
    """A gripper and an object, whose model stands at (4, 4) on a table at z = 0, simulated."""

    force = FORCE

    def __init__(self, gripper: Gripper, body: Body, standing: Floats) -> None:
        self.gripper, self.body, self.standing = gripper, body, standing
        mujoco = library("mujoco")
        self._mujoco = mujoco
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        spec.option.timestep = STEP
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.option.impratio = 10.0
        self._add_surroundings(spec)
        self._add_object(spec)
        self._add_gripper(spec)
        if gripper.cup is not None:
            Vacuum.add_to(spec)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.vacuum: Vacuum | None = None
        if gripper.cup is not None:
            self.vacuum = Vacuum(
                gripper.cup, body.mesh.triangles, body.friction, self.model, self.data
            )
        self._actuators = [self.model.actuator(name).id for name in gripper.joints]

    def _add_surroundings(self, spec: Any) -> None:
        plane = self._mujoco.mjtGeom.mjGEOM_PLANE
        floor = spec.worldbody.add_geom(name="table", type=plane, size=[2, 2, 0.1])
        floor.friction = [0.5, 0.005, 1e-4]

    def _add_joint(self, item: Any) -> None:
        item.add_freejoint()

    def _add_object(self, spec: Any) -> None:
        mujoco, body = self._mujoco, self.body
        item = spec.worldbody.add_body(name="object", **mujoco_pose(self.standing))
        self._add_joint(item)
        size = np.ptp(body.mesh.used, axis=0)
        item.explicitinertial, item.mass = True, body.mass
        item.ipos = body.centre
        item.inertia = body.mass / 12 * ((size**2).sum() - size**2)
        solid = body.solid
        if solid is not None and solid.kind != "cone":
            geom = mujoco.mjtGeom
            type_, half = {
                "cuboid": (geom.mjGEOM_BOX, [s / 2 for s in solid.size]),
                "sphere": (geom.mjGEOM_SPHERE, [solid.size[0], 0, 0]),
                "cylinder": (geom.mjGEOM_CYLINDER, [solid.size[0], solid.size[-1] / 2, 0]),
            }[solid.kind]
            pose = np.eye(4) if body.pose is None else body.pose
            shapes = [item.add_geom(type=type_, size=half, **mujoco_pose(pose))]
        else:
            shapes = []
            for number, piece in enumerate(body.pieces):
                mesh = spec.add_mesh(name=f"object {number}")
                mesh.uservert = piece.vertices.ravel().tolist()
                mesh.userface = piece.faces.ravel().tolist()
                mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
                shapes.append(item.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh.name))
        for shape in shapes:
            shape.condim = 6
            shape.friction = [body.friction, 0.005 * body.friction, 0.001]
            shape.priority = 1  # its friction holds against pads and table

    def _add_gripper(self, spec: Any) -> None:
        """Add the palm, which moves as it is told, and the fingers, which are driven."""
        mujoco, gripper = self._mujoco, self.gripper
        robot = gripper.robot
        spec.worldbody.add_body(name="guide", mocap=True)
        # The palm follows by a stiff weld: a body that is only placed has no speed, and would
        # not take along by friction what it holds.
        palm = spec.worldbody.add_body(name="palm")
        palm.add_freejoint(name="palm")
        palm.explicitinertial, palm.mass, palm.inertia = True, 2.0, [0.02] * 3
        palm.gravcomp = 1.0
        weld = spec.add_equality(
            type=mujoco.mjtEq.mjEQ_WELD,
            name1="palm",
            name2="guide",
            objtype=mujoco.mjtObj.mjOBJ_BODY,
        )
        weld.data[:11] = [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1]
        weld.solref = [0.01, 1.0]
        bodies = {gripper.palm: palm}
        inverse = np.asarray(np.linalg.inv(gripper.frame), np.float64)
        fixed = gripper.rigid
        rigid = [k for k, link in enumerate(gripper.links) if link in fixed]
        for k in rigid:
            name = f"{gripper.links[k]} {k}"
            self._add_hull(spec, palm, name, gripper.stiff_hulls[k], gripper.poses[0, k])
        below: dict[str, Floats] = {gripper.palm: inverse}
        driven = set(gripper.joints)
        names, followers = set[str](), []
        for joint in robot.joints:
            if joint.parent not in below:
                continue
            step = robot.transform(joint, {})
            if not joint.moves:
                below[joint.child] = below[joint.parent] @ step
                bodies[joint.child] = bodies[joint.parent]
                if joint.child not in fixed:
                    self._add_link(spec, bodies[joint.child], joint.child, below[joint.child])
                continue
            at = below[joint.parent] @ step
            part = bodies[joint.parent].add_body(name=joint.child, **mujoco_pose(at))
            part.explicitinertial, part.mass, part.inertia = True, 0.05, [1e-4] * 3
            part.gravcomp = 1.0
            slides = joint.type == "prismatic"
            part.add_joint(
                name=joint.name,
                type=mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE,
                axis=joint.axis,
                limited=joint.mimics is None,
                range=joint.limits if np.isfinite(joint.limits).all() else (-3.0, 3.0),
                damping=20.0 if slides else 0.2,
                armature=0.05 if slides else 0.002,
            )
            names.add(joint.name)
            bodies[joint.child], below[joint.child] = part, np.eye(4)
            self._add_link(spec, part, joint.child, np.eye(4))
            if joint.mimics is not None:
                followers.append(joint)
            elif joint.name in driven:
                force = self.force if slides else self.force / 10
                stiffness = STIFFNESS if slides else STIFFNESS / 50
                motor = spec.add_actuator(
                    name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
                )
                motor.set_to_position(kp=stiffness, kv=0.05 * stiffness)
                motor.forcelimited, motor.forcerange = True, [-force, force]
        for joint in followers:
            if joint.mimics in names:
                multiplier, offset = robot.mimicry(joint)
                equal = spec.add_equality(
                    type=mujoco.mjtEq.mjEQ_JOINT, name1=joint.name, name2=joint.mimics
                )
                equal.data[:5] = [offset, multiplier, 0, 0, 0]
        for one, other in combinations(sorted({b.name for b in bodies.values()}), 2):
            spec.add_exclude(bodyname1=one, bodyname2=other)
        spec.add_exclude(bodyname1="palm", bodyname2="world")

    def _add_link(self, spec: Any, body: Any, link: str, pose: Floats) -> None:
        if link not in self.gripper.robot.meshes:
            return
        self._add_hull(spec, body, link, self.gripper.robot.hull(link), pose)

    def _add_hull(self, spec: Any, body: Any, name: str, corners: Floats, pose: Floats) -> None:
        mujoco = self._mujoco
        hull = _hull(np.ascontiguousarray(corners).tobytes())
        if hull is None:
            return
        vertices, faces = hull
        mesh = spec.add_mesh(name=f"hull of {name}")
        mesh.uservert = (vertices @ pose[:3, :3].T + pose[:3, 3]).ravel().tolist()
        mesh.userface = faces.ravel().tolist()
        shape = body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh.name)
        shape.condim = 4
        shape.mass = 0.0

    def run(self, grasp: Grasp, *, error: Floats | None = None) -> TrialOutcome:
        """Try a grasp, in the model's frame, whose pose the robot has wrong by `error` (4, 4)."""
        wrong = np.eye(4) if error is None else error
        goal = self.standing @ wrong @ grasp.pose
        before = self.standing @ wrong @ grasp.pre_grasp
        opened = grasp.pre_posture
        shut = dict(self.gripper.postures[-1])
        self._reset(opened, before)
        start = self._pose()
        self._drive(opened, opened, before, goal, APPROACH)
        reached = self._pose()
        self._take()
        self._drive(opened, shut, goal, goal, CLOSE)
        grip = self._grip()
        held = np.linalg.inv(self._pose("palm")) @ self._pose()
        above = goal.copy()
        above[2, 3] += HEIGHT
        self._drive(shut, shut, goal, above, LIFT)
        self._drive(shut, shut, above, above, SHAKE, sway=SWAY)
        end = self._pose()
        in_hand = np.linalg.inv(self._pose("palm")) @ end
        centre = np.append(self.body.centre, 1.0)
        was = (np.linalg.inv(goal) @ reached @ centre)[:3]
        slip = (in_hand @ centre - held @ centre)[:3]
        turn = Rotation.from_matrix(in_hand[:3, :3] @ held[:3, :3].T).as_rotvec()
        moved = (held @ centre)[:3] - was
        return TrialOutcome(
            float((end @ centre)[2] - (start @ centre)[2]),
            float(np.linalg.norm(slip)),
            float(np.linalg.norm((reached @ centre)[:3] - (start @ centre)[:3])),
            grip,
            self._width(),
            (float(turn[0]), float(turn[1]), float(turn[2])),
            (float(moved[0]), float(moved[1]), float(moved[2])),
        )

    def put(self, grasp: Grasp, before: Floats, after: Floats) -> Rest:
        """Take the object, put it down where it stood, and return how it rests.

        The gripper begins to move down at `before` (4, 4) and, opened, ends at `after`, model's
        frame.
        """
        opened, shut = grasp.pre_posture, dict(self.gripper.postures[-1])
        goal, down, away = (self.standing @ pose for pose in (grasp.pose, before, after))
        above, release = goal.copy(), goal.copy()
        above[2, 3] += HEIGHT
        release[2, 3] += ABOVE
        first = self.standing @ grasp.pre_grasp
        self._reset(opened, first)
        start = self._pose()
        self._drive(opened, opened, first, goal, APPROACH)
        self._take()
        self._drive(opened, shut, goal, goal, CLOSE)
        self._drive(shut, shut, goal, above, LIFT)
        lifted = float(((self._pose() - start) @ np.append(self.body.centre, 1.0))[2])
        self._drive(shut, shut, above, down, LIFT)
        self._drive(shut, shut, down, release, APPROACH)
        self._let_go()
        self._drive(shut, opened, release, release, CLOSE)
        self._drive(opened, opened, release, away, APPROACH)
        self._drive(opened, opened, away, away, REST)
        return self._rest(start, lifted)

    def push(self, push: Push, model: Floats) -> Rest:
        """Push the object of pose (4, 4), map's frame, and return where it is when it rests."""
        before, contact, end = (
            self.standing @ np.linalg.inv(model) @ pose
            for pose in (push.pre_push, push.pose, push.end)
        )
        self._reset(push.posture, before)
        start = self._pose()
        self._drive(push.posture, push.posture, before, contact, APPROACH)
        self._drive(push.posture, push.posture, contact, end, 2 * LIFT)
        self._drive(push.posture, push.posture, end, end, REST)
        return self._rest(start)

    def _reset(self, opened: Mapping[str, float], before: Floats) -> None:
        """Let the object settle while the gripper waits, with its fingers at these positions."""
        data, robot = self.data, self.gripper.robot
        self._mujoco.mj_resetData(self.model, data)
        self._let_go()
        for name, value in opened.items():
            data.joint(name).qpos[0] = value
        known = {self.model.joint(i).name for i in range(self.model.njnt)}
        for joint in robot.joints:  # what mimics begins where it belongs
            if joint.mimics is not None and joint.mimics in opened and joint.name in known:
                multiplier, offset = robot.mimicry(joint)
                data.joint(joint.name).qpos[0] = multiplier * opened[joint.mimics] + offset
        self._hold(before)
        data.joint("palm").qpos[:] = np.concatenate([*mujoco_pose(before).values()])
        self._drive(opened, opened, before, before, SETTLE)

    def _rest(self, start: Floats, lifted: float = 0.0) -> Rest:
        end, centre = self._pose(), np.append(self.body.centre, 1.0)
        x, y, z = ((end - start) @ centre)[:3].tolist()
        upright = np.clip((end[:3, :3] @ start[:3, :3].T)[2, 2], -1, 1)
        return Rest((x, y, z), float(np.arccos(upright)), lifted)

    def _take(self) -> None:
        """Turn the vacuum of a suction cup on; fingers are closed by their drives."""
        if self.vacuum is not None:
            self.vacuum.take()

    def _let_go(self) -> None:
        if self.vacuum is not None:
            self.vacuum.let_go()

    def _grip(self) -> float:
        """Metres between the fingers beyond their narrowest width, or across a lip that holds."""
        if self.vacuum is not None:
            return self.gripper.opening if self.vacuum.holds else 0.0
        return self._width() - float(self.gripper.widths[-1])

    def _width(self) -> float:
        if self.vacuum is not None:
            return self.gripper.opening
        name = self.gripper.joints[0]
        series = np.array([p[name] for p in self.gripper.postures])
        order = np.argsort(series)
        at = float(self.data.joint(name).qpos[0])
        return float(np.interp(at, series[order], self.gripper.widths[order]))

    def _pose(self, name: str = "object") -> Floats:
        body = self.data.body(name)
        pose = np.eye(4)
        pose[:3, :3] = body.xmat.reshape(3, 3)
        pose[:3, 3] = body.xpos
        return pose

    def _hold(self, pose: Floats) -> None:
        at = mujoco_pose(pose)
        self.data.mocap_pos[0], self.data.mocap_quat[0] = at["pos"], at["quat"]

    def _drive(
        self,
        opened: Mapping[str, float],
        shut: Mapping[str, float],
        begin: Floats,
        end: Floats,
        seconds: float,
        sway: float = 0.0,
    ) -> None:
        """Move the palm straight and the fingers' targets evenly."""

        def pose_at(share: float) -> Floats:
            pose = end.copy()
            pose[:3, 3] += (1 - smooth(share)) * (begin - end)[:3, 3]
            phase = 2 * np.pi * 3 * share * seconds
            pose[:3, 3] += sway * np.sin(phase) * np.array([1.0, 0.5, 0.25])
            return pose

        self._lead(pose_at, opened, shut, seconds)

    def _lead(
        self,
        pose_at: Callable[[float], Floats],
        opened: Mapping[str, float],
        shut: Mapping[str, float],
        seconds: float,
    ) -> None:
        """Move the palm along poses (4, 4) at shares of the time, and the fingers' targets."""
        steps = round(seconds / STEP)
        last = pose_at(0.0)
        for share in (np.arange(steps) + 1) / steps:
            early = min(1.0, 2 * share)
            for name, actuator in zip(self.gripper.joints, self._actuators, strict=True):
                self.data.ctrl[actuator] = opened[name] + early * (shut[name] - opened[name])
            pose = pose_at(float(share))
            self._pull(last, pose)
            self._mujoco.mj_step(self.model, self.data)
            if self.vacuum is not None:
                self.vacuum.watch()
            last = pose

    def _pull(self, last: Floats, pose: Floats) -> None:
        """Let the palm go from one pose to the next."""
        self._hold(pose)


def smooth(share: float) -> float:
    """A share of a way after a share of its time: slow at both ends."""
    return share * share * (3 - 2 * share)


@lru_cache(maxsize=256)
def _hull(corners: bytes) -> tuple[Floats, Any] | None:
    """Vertices and faces of the hull of corners, which each trial of a hand needs; None if flat."""
    try:
        hull = trimesh.convex.convex_hull(np.frombuffer(corners).reshape(-1, 3))
    except QhullError:
        return None
    return None if hull.volume < 1e-10 else (hull.vertices, hull.faces)
