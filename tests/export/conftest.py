"""A flat with a bit of everything."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import semmap
from tests.api.conftest import db, flat

__all__ = ["db", "flat"]


@pytest.fixture
def furnished(flat: semmap.Map) -> semmap.Map:
    """The flat with a door within a room, tilted and concave things, and awkward properties."""
    flat.add_region("wet", [(5, 2), (6, 2), (6, 3), (5, 3)], type="blocked_region", label="a, b")
    flat.add_agent("robot1", type="robot", size=(0.5, 0.5, 1), pose=(1, 0.6, 0))
    flat.add_object("bare", type="mug")
    odd = {"name": "n", "Name": 1, "NAME": 2, "floor": [None], "empty": None, "text": "[1, 2]"}
    flat.add_object("point", pose=(5, 1, 0.5), properties={**odd, "n": 2, "f": 1.5})
    flat.add_object("mixed", pose=(5, 1.5, 0.5), properties={"n": "two", "f": True, "big": 2**60})
    flat.add_object("tilted", mesh=trimesh.creation.box((0.2, 0.3, 0.5)), pose=(7, 1, 1))
    tilt = [7, 1, 1, *Rotation.from_euler("xyz", (0.3, 0.5, 1)).as_quat().tolist()]
    flat.execute(
        f"UPDATE placement SET pose = ARRAY{tilt}, holder_id = NULL "
        "FROM entity e WHERE e.id = entity_id AND e.name = 'tilted'"
    )
    ell = trimesh.util.concatenate(
        [
            trimesh.creation.box(bounds=np.array(b, float))
            for b in ([[0, 0, 0], [2, 0.1, 1]], [[0, 0.1, 0], [0.1, 1, 1]])
        ]
    )
    flat.add_object("ell", mesh=ell, pose=(5.2, 0.2, 0))
    flat.add_door("out", "hall", None, ((8, 1), (8, 1.8)), state="locked", direction="forward")
    flat.execute(
        "UPDATE connector SET permissions = '{\"a, b\",staff}' FROM entity e "
        "WHERE e.id = entity_id AND e.name = 'out'"
    )
    flat.add_door("inner", "hall", "hall", ((6, 0), (6, 0.9)))
    return flat
