from semmap.geometry.pose import Pose
from semmap.ingest.store.world_store import digest_of
from semmap.ingest.world import ConnectorDetail, Entry


def test_digests_do_not_change_with_semmap():
    """Else a file that is imported again would overrule what was said since."""
    door = Entry("door1", "connector", detail=ConnectorDetail(("a", "b"), (Pose(-0.5), Pose(0.5))))
    known = "bed84f27bd8090a09b956f9d7d618834230da4f5fc7abd9279ea7ebf55e40dff"
    assert digest_of(door) == known
