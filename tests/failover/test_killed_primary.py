"""A cluster with failover loses no acknowledged write when its primary is killed."""

from __future__ import annotations

import psycopg
import pytest

from semmap.database import open_engine, revisions
from tests.failover.cluster import running_cluster
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
        engine = open_engine(cluster.url_of(cluster.primary()))
        assert revisions.installed_on(engine) == revisions.newest()
        engine.dispose()
