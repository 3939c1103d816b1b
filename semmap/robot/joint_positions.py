"""Joint positions that a user gives: as JSON, a file of it, or the name of a state."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from semmap.finite_number import is_finite_number
from semmap.robot.srdf import read_states


def joints_of(robot: Path, state: str | Mapping[str, float] | None) -> dict[str, float]:
    """The joint positions that an option ``--state`` describes, radians or metres.

    They are given by name, as JSON, as the name of a file that holds it, or as that of a state in
    the SRDF of the URDF `robot`; none where None. ValueError where it is none of these.
    """
    if state is None:
        return {}
    if not isinstance(state, str):
        return _checked(dict(state))
    text = state
    if not state.lstrip().startswith("{"):
        named = read_states(robot)
        if state in named:
            return named[state]
        try:
            text = Path(state).read_text("utf-8")
        except OSError as error:
            known = f"; the SRDF has {', '.join(sorted(named))}" if named else ""
            raise ValueError(
                f'--state {state}: is neither JSON nor a file ({error}); give {{"joint": number}}'
                f"{known}"
            ) from None
    try:
        joints = json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(f'--state: is not JSON ({error}); give {{"joint": number}}') from None
    return _checked(joints)


def _checked(joints: Any) -> dict[str, float]:
    if not isinstance(joints, dict) or not all(map(is_finite_number, joints.values())):
        raise ValueError('--state: give joint positions as {"joint": number}')
    return joints
