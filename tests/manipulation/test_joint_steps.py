"""Steps of joints are those of mink's own solver, also at their limits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mink
import mujoco
import numpy as np
import pytest

from semmap.manipulation.joint_steps import joint_step, limits_of

ARM = """<mujoco><worldbody><body name="a">
<joint name="slides" type="slide" axis="1 0 0" limited="{limited}" range="-1 2"/>
<geom size="0.1"/>
<body name="b" pos="0.5 0 0"><joint name="turns" axis="0 0 1" limited="true" range="-2 0.5"/>
<geom size="0.1"/>
<body name="c" pos="0.4 0 0.1"><joint name="lifts" axis="0 1 0" limited="true" range="-0.3 0.2"/>
<geom size="0.1"/><site name="hand" pos="0.3 0 0"/></body></body></body></worldbody></mujoco>"""


@pytest.fixture(params=["true", "false"])
def model(request: pytest.FixtureRequest) -> Any:
    from_text: Callable[[str], Any] = mujoco.MjModel.from_xml_string
    return from_text(ARM.format(limited=request.param))


def test_steps_are_those_of_mink(model: Any) -> None:
    random, at_limits = np.random.default_rng(2), 0
    limits = limits_of(model)
    low, high = np.maximum(limits[0], -3), np.minimum(limits[1], 3)
    task = mink.FrameTask("hand", "site", position_cost=1.0, orientation_cost=0.5)
    configuration = mink.Configuration(model)
    for _ in range(50):
        turn = mink.SO3.from_rpy_radians(*random.uniform(-2, 2, 3))
        goal = mink.SE3.from_rotation_and_translation(turn, random.uniform(-2, 2, 3))
        task.set_target(goal)
        configuration.update(random.uniform(low, high))
        step = joint_step(configuration, [task], limits)
        expected = mink.solve_ik(
            configuration,
            [task],
            1.0,
            solver="daqp",
            damping=1e-4,
            limits=[mink.ConfigurationLimit(model)],
        )
        np.testing.assert_allclose(step, expected, atol=1e-7)
        rest = np.array(limits) - configuration.q
        at_limits += np.isclose(np.abs(rest * 0.95 - step), 0, atol=1e-7).any()
    assert at_limits > 10
