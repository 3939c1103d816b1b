"""The vacuum of a suction cup in a simulation (MuJoCo): where it is tight, a weld holds.

The weld breaks where the force and the moment that a sensor feels at the lip are more than friction
and the vacuum resist (`strain`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from semmap.arrays import Floats
from semmap.manipulation.extra import library
from semmap.manipulation.suction import Cup, strain, tightness
from semmap.manipulation.suction_grasps import heights

LEAK = 0.03
"""Seconds of too much load after which the vacuum is gone."""

STIFF = (0.004, 1.0)
"""Seconds in which the weld brings lip and object back to each other, and its damping ratio."""


class Vacuum:
    """A suction cup of the body ``palm``, whose frame is the grasp frame, on the body ``object``.

    `triangles` (F, 3, 3) are the object in its own frame, `friction` is between it and the lip.
    """

    @staticmethod
    def add_to(spec: Any) -> None:
        """Add the lip, the weld, which is off, and the sensors to a model that has both bodies."""
        mujoco = library("mujoco")
        lip = spec.body("palm").add_body(name="lip")
        lip.add_site(name="lip")
        weld = spec.add_equality(
            name="vacuum",
            type=mujoco.mjtEq.mjEQ_WELD,
            name1="lip",
            name2="object",
            objtype=mujoco.mjtObj.mjOBJ_BODY,
            active=False,
        )
        weld.solref = STIFF
        weld.data[10] = 1.0
        for name, kind in (("force", "FORCE"), ("moment", "TORQUE")):
            spec.add_sensor(
                name=name,
                type=getattr(mujoco.mjtSensor, f"mjSENS_{kind}"),
                objtype=mujoco.mjtObj.mjOBJ_SITE,
                objname="lip",
            )

    def __init__(self, cup: Cup, triangles: Floats, friction: float, model: Any, data: Any) -> None:
        self.cup, self.triangles, self.friction = cup, triangles, friction
        self.model, self.data = model, data
        self._weld = model.equality("vacuum").id
        self._too_much = 0.0

    @property
    def holds(self) -> bool:
        """Whether the object hangs on the lip."""
        return bool(self.data.eq_active[self._weld])

    def take(self) -> None:
        """Turn the vacuum on where the lip is: it holds if it is tight there."""
        ring, inside = self._heights(self.cup.ring), self._heights(self.cup.inside)
        if not tightness(self.cup, ring, inside):
            return
        lip, item = self.data.body("lip"), self.data.body("object")
        apart = self.model.eq_data[self._weld]
        apart[:3] = item.xmat.reshape(3, 3).T @ (lip.xpos - item.xpos)  # the lip, in the object
        apart[3:6] = 0.0  # and in its own frame
        library("mujoco").mju_mulQuat(apart[6:10], lip.xquat * [1, -1, -1, -1], item.xquat)
        self.data.eq_active[self._weld] = 1
        self._too_much = 0.0

    def let_go(self) -> None:
        """Turn the vacuum off."""
        self.data.eq_active[self._weld] = 0

    def watch(self) -> None:
        """After each step: let go where the load has been too much for `LEAK` seconds."""
        if not self.holds:
            return
        force, moment = self.load
        too_much = strain(self.cup, force, moment, self.friction) > 1
        self._too_much = self._too_much + self.model.opt.timestep if too_much else 0.0
        if self._too_much >= LEAK:
            self.let_go()

    @property
    def load(self) -> tuple[Floats, Floats]:
        """The force and the moment (3,) of the object on the lip, in the grasp frame."""
        felt = (np.array(self.data.sensor(name).data) for name in ("force", "moment"))
        force, moment = (-each for each in felt)  # sensors feel what the palm does to the lip
        return force, moment

    def _heights(self, at: Floats) -> Floats:
        """(K,) how far the object is from the lip's plane at points (K, 2); infinite beside it.

        By the mesh of the object: the pieces that collide may fill its holes.
        """
        lip, item = self.data.body("lip"), self.data.body("object")
        placed = self.triangles @ item.xmat.reshape(3, 3).T + item.xpos
        found = heights((placed - lip.xpos) @ lip.xmat.reshape(3, 3), at, -self.cup.soft)
        reached = found <= self.cup.soft + self.cup.give  # a cup is pressed on, but no further
        return np.where(reached, found, np.inf)
