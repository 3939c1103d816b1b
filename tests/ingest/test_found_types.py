"""Types of found rooms, from what stands in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

import semmap

CONTENTS = {
    ("toilet",): "sanitary_room",
    ("toilet", "bathtub"): "bathroom",
    ("toilet", "urinal"): "restroom",
    ("shower",): "sanitary_room",  # in a bathroom and in a shower room
    ("bathtub", "urinal"): "sanitary_room",
    ("bed", "nightstand", "sofa"): "bedroom",
    ("bed", "sofa"): "living_area",
    ("bed", "stove"): None,
    (): None,
}
"""The type by the objects in a room, by hand: the most that all who speak agree on."""


def test_rooms_have_the_type_on_which_their_contents_agree(tmp_path: Path, database: str) -> None:
    scene = trimesh.Scene()

    def box(name: str, x: float, y: float, *size: float) -> None:
        made = trimesh.creation.box(size)
        made.apply_translation((x, y, size[2] / 2))
        scene.add_geometry(made, node_name=name, geom_name=name)

    length = 3.0 * len(CONTENTS)
    for number in range(len(CONTENTS) + 1):
        box(f"Wall_x{number}", 3.0 * number, 1.5, 0.2, 3.2, 2.6)
    for y in (0.0, 3.0):
        box(f"Wall_y{y:g}", length / 2, y, length, 0.2, 2.6)
    for number, things in enumerate(CONTENTS):
        for place, thing in enumerate(things):
            box(f"{thing}_{number}", 3 * number + 0.7 + 0.7 * place, 1.5, 0.5, 0.5, 0.5)
    for mesh in scene.geometry.values():  # a glTF file has y up
        mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)))
    scene.export(tmp_path / "row.glb")

    with semmap.connect(database) as db:
        db.import_file(tmp_path / "row.glb", map="row")
        db.map("row").find_rooms(add=True)
        rooms = sorted(db.map("row").rooms, key=lambda room: room.pose.x)
        assert [room.type for room in rooms] == [*CONTENTS.values()]
        by = [set(room.properties["found"]["shown_by"]) for room in rooms]
        assert by[1] == {"toilet_1", "bathtub_1"}
        assert by[5] == {"bed_5", "nightstand_5"}
