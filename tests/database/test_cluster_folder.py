"""What a killed test run leaves is removed by the next one, and nothing of a living one."""

from __future__ import annotations

from pathlib import Path

import pytest

from semmap.database import Cluster
from tests.cluster_folder import cluster_folder, remove_abandoned
from tests.database.conftest import python

LEAVE = """
import sys
from pathlib import Path
from semmap.database import Cluster
from tests.cluster_folder import cluster_folder
with cluster_folder(Path(sys.argv[1])) as folder:
    Cluster(folder / "inner").ensure()
    print(folder, flush=True)
    sys.stdin.read()
"""


@pytest.mark.parametrize("died", [True, False])
def test_only_what_a_dead_process_left_is_removed(folder: Path, died: bool) -> None:
    process = python(LEAVE, folder, stdin=-1)
    left = Path(process.stdout.readline().strip())
    inner = Cluster(left / "inner")
    assert inner.running()
    if died:
        process.kill()
        process.wait()
    remove_abandoned(folder)  # it is young
    assert left.exists()
    remove_abandoned(folder, 0)
    assert left.exists() is (inner.running() is not None) is not died
    assert bool([*folder.iterdir()]) is not died
    process.communicate(timeout=60)


def test_a_folder_is_open_to_all_users_and_has_a_lock_beside_it(folder: Path) -> None:
    with cluster_folder(folder) as made:
        assert len([*folder.iterdir()]) == 2
        assert made.stat().st_mode & 0o777 == 0o755
