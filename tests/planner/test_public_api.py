"""What `import planner` offers, and what importing it costs."""

import subprocess
import sys

import pytest

import planner


def test_every_public_name_is_there():
    assert all(hasattr(planner, name) for name in planner.__all__)
    assert set(planner.__all__) <= set(dir(planner))
    with pytest.raises(AttributeError, match="has no attribute 'Network'"):
        planner.Network  # noqa: B018


def test_importing_the_package_imports_no_library():
    code = (
        "import sys; before = set(sys.modules); import planner; "
        "print(*(n for n in set(sys.modules) - before if '.' not in n))"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"numpy", "sqlalchemy", "shapely", "clingo", "networkx"} & {*found.stdout.split()}
