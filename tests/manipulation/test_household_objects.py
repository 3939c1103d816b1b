"""Grasps with the columns of the Household Objects Database, as CSV, JSON and a dump."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from semmap import Map
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.household_objects import import_household_grasps

W = 0.7071067811865476
"""Half a right angle."""

HANDS = {"WILLOW_GRIPPER_2010": "two_fingers"}


def grasp(**values: Any) -> dict[str, Any]:
    return {
        "grasp_id": 1,
        "scaled_model_id": 18744,
        "hand_name": "WILLOW_GRIPPER_2010",
        "grasp_pregrasp_joints": "{0.5}",
        "grasp_grasp_joints": "{0.2}",
        "grasp_pregrasp_position": f"{{-0.2,0,0.05,{W},0,0,{W}}}",
        "grasp_grasp_position": f"{{-0.1,0,0.05,{W},0,0,{W}}}",
        "grasp_energy": "12.5",
    } | values


def stored(cups: Map) -> list[tuple[Any, ...]]:
    return cups.execute(
        "SELECT o.key, o.name, o.type, a.pose, a.pre_pose, a.posture, a.quality FROM action a "
        "JOIN object_model o ON o.id = a.object_id ORDER BY a.quality DESC"
    )


def write(path: Path, rows: list[dict[str, Any]]) -> Path:
    if path.suffix == ".json":
        path.write_text(json.dumps(rows))
    elif path.suffix == ".csv":
        lines = [",".join(rows[0])]
        lines += [",".join(f'"{value}"' for value in row.values()) for row in rows]
        path.write_text("\n".join(lines))
    else:
        body = "\n".join("\t".join(map(str, row.values())) for row in rows)
        path.write_text(
            "SET x = 1;\nCOPY public.original_model (original_model_id, original_model_maker, "
            "original_model_model) FROM stdin;\n9387\t\\N\tWine glass\n\\.\n"
            "COPY public.scaled_model (scaled_model_id, original_model_id) FROM stdin;\n"
            f"18744\t9387\n\\.\n\nCOPY public.grasp ({', '.join(rows[0])}) FROM stdin;\n"
            f"{body}\n\\.\n"
        )
    return path


@pytest.mark.parametrize("ending", [".csv", ".json", ".sql"])
def test_files_of_each_kind(cups: Map, tmp_path: Path, ending: str) -> None:
    rows = [grasp(), grasp(grasp_id=2, grasp_energy="3", grasp_grasp_position="{0,0,0.1,1,0,0,0}")]
    path = write(tmp_path / f"grasps{ending}", rows)
    here = cups.connection
    assert import_household_grasps(here, [path], HANDS) == {"models": 1, "grasps": 2}
    best, other = stored(cups)
    assert (best[6], other[6]) == (1.0, 0.5)  # the lower energy is better
    assert best[0] == "household_objects:18744"
    assert np.array(other[3]) == pytest.approx([-0.1, 0, 0.05, 0, 0, W, W])  # w is last here
    assert other[4][0] == -0.2
    assert other[5] == {"joint1": 0.2}
    assert best[1:3] == (("Wine glass", "wine_glass") if ending == ".sql" else (None, None))
    if ending == ".sql":
        assert len(here.execute("SELECT * FROM known_actions('drinking')").fetchall()) == 2
    import_household_grasps(here, [path], HANDS)
    assert len(stored(cups)) == 2


def test_units_and_the_frame_of_the_hand(cups: Map, tmp_path: Path) -> None:
    """The approach of the PR2's hand is +x, that of a grasp frame +z."""
    turned = Rotation.from_euler("y", 90, degrees=True)
    position = f"{{100,0,0,{W},0,0,{W}}}"
    path = write(tmp_path / "g.json", [grasp(grasp_grasp_position=position)])
    import_household_grasps(
        cups.connection, [path], HANDS, scale=0.001, tool=[0.16, 0, 0, *turned.as_quat()]
    )
    ((_, _, _, pose, *_),) = stored(cups)
    hand = Rotation.from_euler("z", 90, degrees=True)
    assert pose[:3] == pytest.approx([0.1, 0.16, 0])
    approach = Rotation.from_quat(pose[3:]).apply([0, 0, 1])
    assert approach == pytest.approx(hand.apply([1, 0, 0]), abs=1e-9)


BAD = {
    "no hand": ({"hand_name": ""}, "grasp 1: has no hand_name"),
    "a hand that is not stored": ({"hand_name": "SHADOW_HAND"}, "no gripper SHADOW_HAND"),
    "six numbers": ({"grasp_grasp_position": "{1,2,3,4,5,6}"}, "has 6 numbers"),
    "not numbers": ({"grasp_grasp_position": "{a,b,c,d,e,f,g}"}, "'a' is not a finite number"),
    "NaN": ({"grasp_grasp_position": "{nan,0,0,1,0,0,0}"}, "is not a finite number"),
    "no rotation": ({"grasp_grasp_position": "{0,0,0,0,0,0,0}"}, "quaternion has the length 0"),
    "joints of text": ({"grasp_grasp_joints": "{open}"}, "'open' is not a finite number"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_row_is_refused_and_nothing_is_stored(cups: Map, tmp_path: Path, name: str) -> None:
    values, text = BAD[name]
    path = write(tmp_path / "g.json", [grasp(), grasp(grasp_id=1, **values)])
    with pytest.raises((ManipulationError, LookupError), match=text):
        import_household_grasps(cups.connection, [path], HANDS)
    assert stored(cups) == []


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("a.json", "{", "is not valid JSON"),
        ("a.json", '{"a": 1}', "is not a list of rows"),
        ("a.csv", "x,y\n1,2\n", "has no grasp"),
        ("a.txt", "", "give .csv, .json or .sql"),
        ("missing.csv", None, "cannot be read"),
    ],
)
def test_a_file_that_is_not_of_grasps_is_refused(
    cups: Map, tmp_path: Path, name: str, content: str | None, text: str
) -> None:
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(ManipulationError, match=text):
        import_household_grasps(cups.connection, [tmp_path / name])
