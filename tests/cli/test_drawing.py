"""`semmap draw` and `route --draw` save the pictures of the map."""

from __future__ import annotations

from pathlib import Path

import pytest
from sqlalchemy import Engine

import semmap
from tests.command_line import semmap as run


def test_pictures_of_the_office(office_world: Engine, tmp_path: Path) -> None:
    url = office_world.url.render_as_string(hide_password=False)
    plan, solid, way = (tmp_path / name for name in ("plan.png", "solid.png", "way.png"))
    run(url, "draw", "-o", plan, "--storey", "floor-3rd")
    run(url, "draw", "--3d", "-o", solid)
    run(url, "route", "office2", "kitchen", "--draw", way)
    with semmap.connect(url) as db:
        office = db.map("office")
        assert plan.read_bytes() == office.draw("floor-3rd").png
        assert solid.read_bytes() == office.draw_3d().png
        assert way.read_bytes() == office.route("office2", "kitchen").plot().png
    with pytest.raises(LookupError, match="floor-2nd"):
        run(url, "draw", "--storey", "floor-2nd")
