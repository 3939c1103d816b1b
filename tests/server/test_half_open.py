"""Sessions that never finish their first line keep no client out for long."""

from __future__ import annotations

from pathlib import Path

from semmap.database import Cluster
from tests.cluster_folder import cluster_folder
from tests.database.conftest import OWN_SERVER
from tests.soak.half_open import half_open


def test_clients_are_served_beside_half_open_sessions() -> None:
    with cluster_folder(Path("/tmp")) as folder:
        cluster = Cluster(folder / "home")
        cluster.home.mkdir()
        (cluster.home / "local.conf").write_text(OWN_SERVER)
        assert half_open(cluster, 600, files=256) == []
