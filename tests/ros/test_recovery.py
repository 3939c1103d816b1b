"""The node outlives its database: sessions that are killed, and servers that start again."""

from __future__ import annotations

import os
import signal
from typing import Any

import psycopg
import pytest
import shapely

import semmap
from semmap.database import Cluster
from tests.database.conftest import folder, made, own
from tests.ros.conftest import Peer, RunNode

__all__ = ["folder", "made", "own"]

GRID, GRIDS = "/semmap/ground/grid", "nav_msgs/msg/OccupancyGrid"
DIAGNOSTICS = "/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"
CHANGE_STATE = "/semmap/change_state", "lifecycle_msgs/srv/ChangeState"
CONFIGURE, CLEAN_UP, ACTIVATE, DEACTIVATE = 1, 2, 3, 4


@pytest.fixture
def url(own: Cluster) -> str:
    """The URL of a server of this test, with a flat."""
    found = own.ensure().set(drivername="postgresql").render_as_string(hide_password=False)
    with semmap.connect(found, migrate=True) as db:
        for name in db.maps:  # of the test before
            db.drop_map(name)
        flat = db.create_map("flat")
        flat.add_storey("ground", height=3)
        flat.add_room("hall", shapely.box(0, 0, 4, 3), ceiling=2.7)
        flat.add_object("desk", type="desk", size=(1.6, 0.8, 0.75), pose=(1, 1, 0, 0))
    return found


def move(url: str, x: float) -> None:
    with semmap.connect(url) as db:
        db.map("flat")["desk"].move_to(x, 1, 0)


def end_sessions(own: Cluster, url: str) -> None:
    with psycopg.connect(url, autocommit=True) as session:
        ended = session.execute(
            "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
            "WHERE backend_type = 'client backend' AND pid <> pg_backend_pid()"
        ).fetchall()
    assert len(ended) >= 2


def kill_session(own: Cluster, url: str) -> None:
    """With -9, as the kernel does: the server ends all sessions, and recovers."""
    session = psycopg.connect(url)
    os.kill(session.info.backend_pid, signal.SIGKILL)
    with pytest.raises(psycopg.OperationalError):
        session.execute("SELECT 1")


def stop_server(own: Cluster, url: str) -> None:
    own.stop()


def level_of(diagnostics: dict[str, Any]) -> int:
    return int(diagnostics["status"][0]["level"])


def state_of(diagnostics: dict[str, Any]) -> str:
    values = {each["key"]: each["value"] for each in diagnostics["status"][0]["values"]}
    return values["state"]


@pytest.mark.parametrize("end", [end_sessions, kill_session, stop_server])
def test_it_is_active_again_when_its_database_is(
    peer: Peer, run_node: RunNode, own: Cluster, url: str, end: Any
) -> None:
    peer.listen(*DIAGNOSTICS, latched=False)
    with run_node(url, "flat") as process:
        peer.listen(GRID, GRIDS)
        before = peer.take(GRID)
        end(own, url)
        told = peer.take(DIAGNOSTICS[0], lambda array: level_of(array) == 2)["status"][0]
        assert told["message"] not in ("", "active", "inactive")
        own.ensure()
        move(url, 2.0)  # while it is away, or later
        after = peer.take(GRID, seconds=90)
        assert after["data"] != before["data"]
        peer.take(DIAGNOSTICS[0], lambda array: (level_of(array), state_of(array)) == (0, "active"))
        assert process.poll() is None


def test_a_manager_leads_it_through_its_states(peer: Peer, run_node: RunNode, url: str) -> None:
    def change(number: int) -> bool:
        answer = peer.call(*CHANGE_STATE, transition={"id": number})
        return bool(answer["success"])

    peer.listen(*DIAGNOSTICS, latched=False)
    with run_node(url, "flat", autostart=False):
        peer.take(DIAGNOSTICS[0], lambda array: state_of(array) == "unconfigured")
        assert peer("count_publishers", GRID) == 0
        assert change(CONFIGURE)
        assert peer("count_publishers", GRID) == 0
        assert change(ACTIVATE)
        peer.listen(GRID, GRIDS)
        before = peer.take(GRID)
        assert change(DEACTIVATE)
        move(url, 2.0)
        assert peer("take", GRID, 1.0) is None, "it is not active"
        assert change(ACTIVATE)
        assert peer.take(GRID)["data"] != before["data"]
        assert change(DEACTIVATE)
        assert change(CLEAN_UP)
        peer.take(DIAGNOSTICS[0], lambda array: state_of(array) == "unconfigured")
        assert not change(ACTIVATE), "it is not configured"


def test_a_map_that_is_not_there_is_named_until_it_is(
    peer: Peer, run_node: RunNode, url: str
) -> None:
    peer.listen(*DIAGNOSTICS, latched=False)
    with run_node(url, "loft"):
        told = peer.take(DIAGNOSTICS[0], lambda array: level_of(array) == 2)["status"][0]
        assert "loft" in told["message"]
        with semmap.connect(url) as db:
            loft = db.create_map("loft")
            loft.add_storey("ground", height=3)
            loft.add_room("hall", shapely.box(0, 0, 4, 3), ceiling=2.7)
        peer.listen(GRID, GRIDS)
        peer.take(GRID)
