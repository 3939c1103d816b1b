"""Trials of openings and turns in simulation (MuJoCo): a part on its hinge or slide is moved.

The gripper flies as an arm with an impedance controller would lead it: a spring and a damper pull
its palm along the way (Hogan 1985), so that errors of the way are not forced on the part.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from semmap.arrays import Floats
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.gripper import Gripper
from semmap.manipulation.part_motion import PartMotion
from semmap.manipulation.trial import APPROACH, CLOSE, REST, STEP, STIFFNESS, Body, Trial, smooth

SPEED = 0.2
"""Metres a second by which the grasped point of the part is led."""

GRIP = 70.0
"""Newtons of a motor that closes fingers on a handle: the grasping force of a Panda's hand."""

PULL = 1500.0
"""Newtons a metre of the spring that leads the palm; a Panda's arm goes to 3000."""

STRONGEST = 100.0
"""Newtons of the spring and the damper, at most: a stuck part stays where it is."""

TURNING = 50.0
"""Newton metres a radian of the spring that turns the palm."""

SIDE = 0.3
"""The cosine to the closing axis from which on a contact is on one side of what is held."""


@dataclass(frozen=True)
class Resistance:
    """What a joint resists: `friction` (N or Nm), `damping` (Ns/m or Nms)."""

    friction: float
    damping: float

    @classmethod
    def usual(cls, motion: PartMotion) -> Resistance:
        """That of a drawer or a cabinet's door."""
        return cls(1.0, 0.5) if motion.is_hinge else cls(5.0, 10.0)


@dataclass(frozen=True)
class OpeningOutcome:
    """How a part was moved: the `opened` share of its way, and whether the gripper held it.

    `gripped` tells whether both sides were touched before the way began, and `held` at its end; of
    a turn, whether it was touched at all.
    """

    opened: float
    gripped: bool
    held: bool


class PartTrial(Trial):
    """A gripper, and a part of pose (4, 4) with its motion in the frame of its model, simulated."""

    force = GRIP

    def __init__(
        self,
        gripper: Gripper,
        body: Body,
        standing: Floats,
        motion: PartMotion,
        resistance: Resistance | None = None,
    ) -> None:
        self.motion = motion
        self.resistance = Resistance.usual(motion) if resistance is None else resistance
        if min(self.resistance.friction, self.resistance.damping) < 0:
            raise ManipulationError(
                f"resistance: friction {self.resistance.friction:g} and damping "
                f"{self.resistance.damping:g}: at least 0, each"
            )
        super().__init__(gripper, body, standing)
        weld = self.model.eq_type == self._mujoco.mjtEq.mjEQ_WELD
        self.model.eq_active0[weld] = 0  # springs lead the palm instead

    def _add_surroundings(self, spec: Any) -> None:
        pass

    def _add_joint(self, item: Any) -> None:
        motion, kinds = self.motion, self._mujoco.mjtJoint
        end = abs(motion.amount)
        item.add_joint(
            name="part",
            type=kinds.mjJNT_HINGE if motion.is_hinge else kinds.mjJNT_SLIDE,
            pos=np.zeros(3) if motion.point is None else motion.point,
            axis=np.sign(motion.amount) * motion.direction,
            limited=True,
            range=(0.0, 1.02 * end),
            frictionloss=self.resistance.friction,
            damping=self.resistance.damping,
        )

    def open(
        self,
        pose: Floats,
        before: Floats,
        opened: Mapping[str, float],
        *,
        error: Floats | None = None,
    ) -> OpeningOutcome:
        """Grasp a handle at a pose (4, 4), from `before`, and lead it along the motion.

        Poses are in the frame of the model; the robot has them wrong by `error` (4, 4) there.
        `opened` are the joints of the open fingers.
        """
        shut = self._squeezing(opened)
        way = self._way(error)
        self._reset(opened, way(0, before))
        self._drive(opened, opened, way(0, before), way(0, pose), APPROACH)
        self._drive(opened, shut, way(0, pose), way(0, pose), CLOSE)
        gripped = self._sides() == {-1, 1}
        self._lead(lambda share: way(smooth(share), pose), shut, shut, self._seconds(pose))
        self._drive(shut, shut, way(1, pose), way(1, pose), REST)
        return OpeningOutcome(self._share(), gripped, self._sides() == {-1, 1})

    def turn(
        self,
        pose: Floats,
        before: Floats,
        fingers: Mapping[str, float],
        *,
        error: Floats | None = None,
    ) -> OpeningOutcome:
        """Push the part at a pose (4, 4) along its motion; as `open`, with closed fingers."""
        way = self._way(error)
        self._reset(fingers, way(0, before))
        self._drive(fingers, fingers, way(0, before), way(0, pose), APPROACH)
        begun = self._share()
        self._lead(lambda share: way(smooth(share), pose), fingers, fingers, self._seconds(pose))
        self._drive(fingers, fingers, way(1, pose), way(1, pose), REST)
        touched = bool(self._normals())
        return OpeningOutcome(self._share(), begun < 0.5, touched)

    def _squeezing(self, opened: Mapping[str, float]) -> dict[str, float]:
        """Targets of the fingers, so far beyond shut that their motors press with all their force.

        Handles are thin: a motor that is sent to where the fingers meet would press little.
        """
        shut = self.gripper.postures[-1]
        beyond = GRIP / STIFFNESS  # metres; radians of fingers that turn: as much at 20 cm
        lengths = {j.name: 1 if j.type == "prismatic" else 0.2 for j in self.gripper.robot.joints}
        return {
            name: shut[name] + np.sign(shut[name] - opened[name]) * beyond / lengths[name]
            for name in self.gripper.joints
        }

    def _way(self, error: Floats | None) -> Callable[[float, Floats], Floats]:
        """Where a pose of the model's frame is led to after a share of the motion."""
        wrong = self.standing if error is None else self.standing @ error

        def led(share: float, pose: Floats) -> Floats:
            found: Floats = wrong @ self.motion.at(share) @ pose
            return found

        return led

    def _seconds(self, pose: Floats) -> float:
        lever = float(self.motion.levers(pose[None, :3, 3])[0])
        return max(1.0, lever * abs(self.motion.amount) / SPEED)

    def _share(self) -> float:
        return float(self.data.joint("part").qpos[0]) / abs(self.motion.amount)

    def _normals(self) -> list[Floats]:
        """The normals (3,) of contacts of the part with the hand, towards the hand."""
        part, found = self.model.body("object").id, list[Floats]()
        for contact in self.data.contact:
            bodies = self.model.geom_bodyid[contact.geom]
            if part in bodies and contact.dist < 0:
                found.append(np.array(contact.frame[:3]) * (1 if bodies[0] == part else -1))
        return found

    def _sides(self) -> set[int]:
        """On which sides of the grasp frame's x axis the hand touches the part."""
        closing = self._pose("palm")[:3, 0]
        along = [float(normal @ closing) for normal in self._normals()]
        return {int(np.sign(share)) for share in along if abs(share) > SIDE}

    def _pull(self, last: Floats, pose: Floats) -> None:
        """The force of springs and dampers, both critically damped, towards the second pose."""
        if self.data.time == 0:  # nothing moved yet: poses are to be computed
            self._mujoco.mj_forward(self.model, self.data)
        palm = self.model.body("palm")
        mass, inertia = self._weights(palm.id)
        speed = self.data.joint("palm").qvel
        here = self._pose("palm")
        turn = Rotation.from_matrix(pose[:3, :3] @ here[:3, :3].T).as_rotvec()
        led = Rotation.from_matrix(pose[:3, :3] @ last[:3, :3].T).as_rotvec() / STEP
        wanted = (pose - last)[:3, 3] / STEP
        spin = here[:3, :3] @ speed[3:]  # of a free joint, in the frame of its body
        force = PULL * (pose - here)[:3, 3] + 2 * np.sqrt(PULL * mass) * (wanted - speed[:3])
        torque = TURNING * turn + 2 * np.sqrt(TURNING * inertia) * (led - spin)
        force *= min(1.0, STRONGEST / max(float(np.linalg.norm(force)), 1e-9))
        self.data.xfrc_applied[palm.id] = [*force, *torque]

    def _weights(self, palm: int) -> tuple[float, float]:
        """The mass of the hand, and its mean inertia."""
        return float(self.model.body_subtreemass[palm]), float(self.model.body_inertia[palm].mean())
