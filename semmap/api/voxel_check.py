"""The rule of `Map.check` on stated voxels: geometry and fields are one truth."""

from __future__ import annotations

from semmap.query.map_check.rules import Finding
from semmap.query.snapshot import Snapshot

STATED = """
SELECT EXISTS (SELECT FROM field WHERE map_id = current_map()
               AND property = 'urn:semmap:ontology#occupies')
"""


def check_voxels(seen: Snapshot) -> list[Finding]:
    """Entities with stated voxels away from their geometry: fields say that they are there, too."""
    row = seen.session.execute(STATED).fetchone()
    if row is None or not row[0]:  # then the fields are not loaded
        return []
    from semmap.fields.store.stated_voxels import voxels_apart

    return [
        Finding(
            "voxels apart",
            "error",
            (name,),
            f"voxels that were stated of {name} are up to {away:.2f} m from its geometry, so that "
            "fields say that it is there, too",
            f"by hand: move {name} to its voxels, or take these voxels from it (DELETE DATA)",
        )
        for name, away in voxels_apart(seen)
    ]
