"""Notes about objects without geometry."""

from __future__ import annotations

from semmap.geometry.mesh import box_mesh
from semmap.query.geometry_notes import geometry_lists, geometry_notes
from semmap.query.storey_scene import SceneEntity

CUP = SceneEntity(1, "cup1", "object", triangles=box_mesh((0, 0, 0), (1, 1, 1)).triangles)
ROOM = SceneEntity(2, "lab", "room")


def test_only_objects_without_triangles_are_listed() -> None:
    bed = SceneEntity(3, "bed1", "object")
    assert geometry_lists([CUP, ROOM, bed]) == {"no_geometry": ["bed1"], "assumed_sizes": []}
    assert geometry_notes([CUP, ROOM]) == []
    (note,) = geometry_notes([CUP, bed])
    assert note == "1 object with no geometry: treated as free floor: bed1"


def test_a_note_has_five_names_at_most() -> None:
    beds = [SceneEntity(n, f"bed{n}", "object") for n in range(8)]
    (note,) = geometry_notes(beds)
    assert note.startswith("8 objects with no geometry")
    assert note.endswith("bed4 and 3 more")
    assert len(geometry_lists(beds)["no_geometry"]) == 8
