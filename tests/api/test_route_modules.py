"""From a goal to a route, a reader of the code visits few modules."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import pytest

import semmap

ROOT = Path(__file__).parents[2]
PACKAGES = tuple(f"{ROOT / name}/" for name in ("semmap", "navgrid", "planner"))
MOST = 26


def modules_that_run(call: Callable[[], object]) -> set[str]:
    """The modules of the product of which a function runs during a call."""
    found = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(PACKAGES) and code.co_name != "<module>":
            found.add(str(Path(code.co_filename).relative_to(ROOT)))

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        call()
    finally:
        sys.setprofile(before)
    return found


@pytest.mark.parametrize("robot", ["cart", None])
def test_a_route_to_an_object_visits_few_modules(flat: semmap.Map, robot: str | None) -> None:
    flat.database.add_robot("cart", ROOT / "examples/office/delivery_robot.urdf")
    flat.add_storey("upper", elevation=3, height=3)
    attic = flat.add_room("attic", [(0, 0), (8, 0), (8, 3), (0, 3)], floor=3, ceiling=5.7)
    assert attic.storey == flat["upper"], "steps name the files of their storeys"
    flat.route("hall", "mug7", robot=robot)  # modules are loaded and the ground is measured

    visited = modules_that_run(lambda: flat.route("hall", "mug7", robot=robot))

    assert {"semmap/api/map_driving.py", "planner/route_search.py"} <= visited
    assert len(visited) <= MOST, " ".join(sorted(visited))
