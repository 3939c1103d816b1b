"""What `import planner` offers, and what importing it costs."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import planner

FOLDER = Path(planner.__file__).parent
COMMANDS = sorted((FOLDER / "cli").glob("[a-z]*.py"))


def imports(path):
    """The modules of planner that a module imports when it is loaded."""
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("planner"):
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if module_file(inner) else node.module
        elif isinstance(node, ast.Import):
            yield from (a.name for a in node.names if a.name.startswith("planner"))


def module_file(name):
    path = FOLDER.parent / Path(*name.split("."))
    files = [path.with_suffix(".py"), path / "__init__.py"]
    return next((f for f in files if f.is_file()), None)


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


@pytest.mark.parametrize("path", COMMANDS, ids=lambda p: p.stem)
def test_commands_import_the_planner_only_when_they_run(path):
    names = [n for n in imports(path) if n != "planner" and module_file(n) not in COMMANDS]
    assert names == []
