"""The public names of navgrid: importable, documented, and cheap until they are used."""

from __future__ import annotations

import subprocess
import sys

import pytest

import navgrid


def test_every_public_name_is_an_object_with_a_docstring() -> None:
    for name in navgrid.__all__:
        found = getattr(navgrid, name)
        assert callable(found), name
        assert found.__doc__, name
    assert set(navgrid.__all__) <= set(dir(navgrid))


def test_names_of_functions_are_not_names_of_modules() -> None:
    from navgrid import Costmap, occupancy, storey_grid  # loads modules of many names

    assert callable(Costmap)
    assert callable(occupancy)
    assert callable(storey_grid)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'costmop'"):
        navgrid.costmop  # noqa: B018


def test_the_import_loads_no_library() -> None:
    code = "import sys, navgrid; print({'numpy', 'shapely', 'sqlalchemy'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
