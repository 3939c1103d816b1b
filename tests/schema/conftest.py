"""A room with a mug on a table, for what a module tries on it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import semmap
from tests.conftest import MakeDatabase


@pytest.fixture(scope="module")
def room(make_database: MakeDatabase) -> Iterator[semmap.Map]:
    """The map `lounge`; the mug was seen on its table."""
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        made = db.create_map("lounge")
        made.add_room("hall", [(0, 0), (6, 0), (6, 5), (0, 5)], floor=0, ceiling=2.7)
        made.add_object("Table_01", type="table", size=(1.2, 0.8, 0.75), pose=(2, 2, 0, 0))
        made.add_object("Mug_01", type="mug", size=(0.1, 0.1, 0.1), on="Table_01")
        made.observe("Mug_01", "Table_01")
        yield made
