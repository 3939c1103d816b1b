"""A cluster with failover loses no acknowledged write when its primary is killed."""

from __future__ import annotations

import threading

import psycopg
import pytest

import semmap
from semmap.database import revisions
from tests.failover.cluster import FailoverCluster, running_cluster
from tests.failover.rounds import play

pytestmark = pytest.mark.docker


@pytest.mark.usefixtures("docker")
def test_a_killed_primary_loses_no_acknowledged_write() -> None:
    acknowledged: set[str] = set()
    with running_cluster() as cluster:
        first = cluster.primary()
        for name in cluster.nodes:
            assert cluster.execute(name, "stat", "-c", "%U", "/proc/1") == "postgres"
            durable = cluster.execute(name, "psql", "-XAt", "-c", "SHOW fsync")
            assert durable == "on"
            waits = cluster.execute(name, "psql", "-XAt", "-c", "SHOW synchronous_standby_names")
            assert waits == "ANY 1 (*)"
            # else each new primary cancels the commits that wait, and reports success for them
            cancel = "SELECT pg_cancel_backend(pg_backend_pid())"
            assert cluster.execute(name, "psql", "-XAt", "-c", cancel) == "f"
        with psycopg.connect(cluster.url) as connection:
            found = "SELECT count(*) FROM pg_extension WHERE extname IN ('postgis', 'pgrouting')"
            assert connection.execute(found).fetchone() == (2,)
        with pytest.raises(psycopg.OperationalError, match="password authentication failed"):
            psycopg.connect(cluster.url.replace("//semmap:", "//semmap:not"))

        played = play(cluster, "kill -9 of the primary", acknowledged)

        assert played.acknowledged > 0
        assert (played.lost, played.double) == (0, 0)
        assert cluster.primary() != first
        assert first in cluster.standbys()
        wanted = add_through_a_kill(cluster)
        assert names_in(cluster) == wanted


def add_through_a_kill(cluster: FailoverCluster) -> list[str]:
    """Add objects by the API, by the URL of all servers, while the primary dies; their names."""
    wanted: list[str] = []
    with semmap.connect(cluster.url, migrate=True) as db:
        place = db.create_map("flat")
        place.add_room("hall", [(0, 0), (90, 0), (90, 3), (0, 3)], floor=0, ceiling=3)
        killed = cluster.primary()
        helper = threading.Timer(1, cluster.kill, [killed])
        helper.start()
        after = 0
        while after < 20:
            wanted.append(f"box{len(wanted):04}")
            x = 1 + len(wanted) % 88
            made = place.add_object(wanted[-1], size=(0.1, 0.1, 0.1), pose=(x, 1, 0.05))
            made.move_to(x, 2, 0.05)
            after += not helper.is_alive()  # then it is another one that takes them
        helper.join()
        assert all(place[name].pose.y == 2 for name in wanted)
    cluster.revive(killed)
    return wanted


def names_in(cluster: FailoverCluster) -> list[str]:
    """The names of the objects that the primary has, each as often as it has it."""
    with psycopg.connect(cluster.url) as connection:
        assert revisions.installed(connection) == revisions.newest()
        return [
            row[0]
            for row in connection.execute(
                "SELECT name FROM semmap.entity WHERE kind = 'object' ORDER BY name"
            )
        ]
