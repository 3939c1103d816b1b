"""Grasps of a database of household objects, interlinked with the small house, reach its objects.

The file is written as its database has it: models with names and meshes, and grasps of a hand. Its
meshes are those of the small house in other frames, under other names.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sqlalchemy import Engine

import semmap as package
from semmap.geometry.pose import Pose
from semmap.manipulation.candidates import Grasp
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.practice import practise
from semmap.manipulation.retrieval import find_grasps
from semmap.manipulation.store.model_shapes import model_mesh, shape_of
from semmap.manipulation.trial import HEIGHT, TrialOutcome
from tests.command_line import semmap
from tests.manipulation.grippers import BY_HAND
from tests.seen import seen_by

NAMES = {
    "Vase_01_001": (10, "Vase 01"),
    "SeasoningBox_01_001": (11, "Seasoning box 1"),
    "Trash_01_001": (12, "Trash 01"),
    "Ball_01_001": (13, "Ball no 1"),
    "Tablet_01_001": (14, "Tablet 1"),
    "Dumbbell_01_001": (15, "Dumbell 01"),
}
"""Objects of the house; number and name of the model in the file."""

MOVED = Pose(0.3, -0.2, 0.5, *Rotation.from_euler("x", 90, degrees=True).as_quat())
"""The frame of the house's meshes in that of the file's: it has y up."""


class House(NamedTuple):
    url: str
    folder: Path
    meshes: dict[str, Any]
    """(vertices, faces) in the frame of the house."""


@pytest.fixture(scope="module")
def house(bare_house: Engine, tmp_path_factory: pytest.TempPathFactory) -> House:
    """The small house, and a gripper that opens 10 cm."""
    url = bare_house.url.render_as_string(hide_password=False)
    folder = tmp_path_factory.mktemp("household")
    (folder / "plates.urdf").write_text(BY_HAND)
    add = ("manipulation", "add-gripper", folder / "plates.urdf", "--name", "plates")
    assert semmap(url, *add).exit_code == 0
    meshes = {}
    with package.connect(url) as db:
        session = db.map("house").connection
        for name in NAMES:
            mesh = model_mesh(seen_by(session), name)
            meshes[name] = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    return House(url, folder, meshes)


def middle(house: House, name: str) -> Any:
    vertices = house.meshes[name][0]
    return (vertices.min(axis=0) + vertices.max(axis=0)) / 2


def down(house: House, name: str) -> Any:
    """A grasp from above, (4, 4) in the frame of the house's mesh: its pads at half height."""
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = middle(house, name)
    return pose


def dump(house: House, frame: Pose, *, meshes: bool) -> Path:
    """The tables of the household database as pg_dump writes them, lengths in millimetres."""

    def position(pose: Any) -> str:
        moved = Pose.from_matrix(frame.matrix @ pose)
        x, y, z = (1000 * v for v in moved[:3])
        qx, qy, qz, qw = moved[3:]
        return f"{{{x},{y},{z},{qw},{qx},{qy},{qz}}}"

    tables: dict[str, list[list[Any]]] = {
        "original_model (original_model_id, original_model_model)": [],
        "scaled_model (scaled_model_id, original_model_id, scaled_model_scale)": [],
        "mesh (original_model_id, mesh_vertex_list, mesh_triangle_list)": [],
        "grasp (grasp_id, scaled_model_id, hand_name, grasp_pregrasp_position, "
        "grasp_grasp_position, grasp_scaled_quality)": [],
    }
    models, scaled, surfaces, grasps = tables.values()
    for name, (number, title) in NAMES.items():
        vertices, faces = house.meshes[name]
        models.append([number, title])
        scaled.append([100 + number, number, 1])
        moved = 1000 * frame.apply(vertices)
        if meshes:
            arrays = (moved.ravel().round(3), faces.ravel())
            surfaces.append([number, *("{" + ",".join(map(str, a)) + "}" for a in arrays)])
        grasp = down(house, name)
        before = grasp.copy()
        before[2, 3] += 0.1
        grasps.append(
            [1, 100 + number, "WILLOW", position(before), position(grasp), 0.9],
        )
    path = house.folder / f"household_{'meshes' if meshes else 'points'}.sql"
    path.write_text(
        "".join(
            f"COPY public.{table} FROM stdin;\n"
            + "".join("\t".join(map(str, row)) + "\n" for row in rows)
            + "\\.\n\n"
            for table, rows in tables.items()
        )
    )
    return path


def pose_of(house: House, name: str) -> Pose:
    told = json.loads(run(house, "show", name, "--map", "house", "--json").stdout)
    return Pose(*told["pose"])


def run(house: House, *words: object) -> Any:
    told = semmap(house.url, *words)
    assert told.exit_code == 0, told.output
    return told


def link(house: House) -> int:
    """Interlink the house with the models, by a few labels; all links between them are true."""
    labels = house.folder / "labels.csv"
    pairs = [(name, f"household_objects:{100 + number}") for name, (number, _) in NAMES.items()]
    lines = [f"{a},{b},yes" for a, b in pairs[:3]]
    lines += [f"{pairs[i][0]},{pairs[(i + 1) % 6][1]},no" for i in range(4)]
    labels.write_text("\n".join(["left,right,same", *lines]))
    words = ("interlink", "map:house", "models", "--labels", labels, "--json")
    said = json.loads(run(house, *words).stdout)
    shown = json.loads(run(house, "interlink", "show", said["link_set"], "--json").stdout)
    linked = {(a, b) for row in shown for a in row["left_keys"] for b in row["right_keys"]}
    assert ("Vase_01_001", "household_objects:110") in linked
    assert ("Ball_01_001", "household_objects:113") in linked | {pairs[3]}
    number: int = said["link_set"]
    return number


def grasps(house: House, name: str, *words: object) -> list[dict[str, Any]]:
    words = ("grasp", name, "--gripper", "plates", "--map", "house", "--json", *words)
    told = semmap(house.url, *words)
    found: list[dict[str, Any]] = json.loads(told.stdout)
    return found


def test_linked_grasps_are_offered_until_the_link_is_undone(house: House) -> None:
    file = dump(house, MOVED, meshes=True)
    words = ("manipulation", "import-grasps", file, "--gripper", "WILLOW=plates")
    assert run(house, *words, "--scale", "0.001").stdout == "6 models, 6 grasps\n"
    assert grasps(house, "Vase_01_001", "--stored") == []
    number = link(house)
    name = "Vase_01_001"  # a cylinder: up to its symmetry
    with package.connect(house.url) as db:
        grasps(house, name, "--unchecked")  # finds the primitive
        shape = shape_of(seen_by(db.map("house").connection), name)
    (row,) = [row for row in grasps(house, name, "--unchecked") if row["link"] is not None]
    assert row["frame"] == "shape"
    assert row["expected"] == pytest.approx(0.9 * row["link"])
    inverse = np.linalg.inv(pose_of(house, name).matrix @ shape.pose)
    there, wanted = (
        inverse @ pose
        for pose in (
            Pose(*row["pose"]).matrix,
            pose_of(house, name).matrix @ down(house, name),
        )
    )
    assert abs(there[2, 3]) == pytest.approx(abs(wanted[2, 3]), abs=4e-3)
    assert np.hypot(*there[:2, 3]) == pytest.approx(np.hypot(*wanted[:2, 3]), abs=4e-3)
    assert abs(there[2, 2]) == pytest.approx(abs(wanted[2, 2]), abs=0.02)  # of the approach
    (row,) = grasps(house, "Vase_01_001", "--unchecked")
    run(
        house,
        "manipulation",
        "record",
        "Vase_01_001",
        row["action_id"],
        "completed",
        "--map",
        "house",
    )
    (again,) = grasps(house, "Vase_01_001", "--stored")
    assert again["attempts"] == 1
    run(house, "interlink", "undo", number)
    assert grasps(house, "Vase_01_001", "--stored") == []
    generated = grasps(house, "Vase_01_001", "--unchecked")
    assert all(row["link"] is None for row in generated)


def test_frames_that_are_not_known_are_taken_as_equal_if_the_pads_are_on_the_object(
    house: House,
) -> None:
    """Without meshes: grasps in the house's own frame are offered, those in another one not."""
    for frame, offered in ((Pose(), True), (MOVED, False)):
        file = dump(house, frame, meshes=False)
        with package.connect(house.url) as db, db.session.transaction():
            db.session.execute("DELETE FROM semmap.object_model")
        words = ("manipulation", "import-grasps", file, "--gripper", "WILLOW=plates")
        run(house, *words, "--scale", "0.001")
        number = link(house)
        told = semmap(
            house.url,
            "grasp",
            "Vase_01_001",
            "--gripper",
            "plates",
            "--map",
            "house",
            "--json",
            "--unchecked",
        )
        rows = json.loads(told.stdout)
        if offered:
            (row,) = rows
            assert row["frame"] == "model"
            expected = pose_of(house, "Vase_01_001").matrix @ down(house, "Vase_01_001")
            np.testing.assert_allclose(Pose(*row["pose"]).matrix, expected, atol=1e-6)
        else:
            assert all(row["link"] is None for row in rows)  # generated ones
            assert "1 grasps of the linked model Vase 01 (household_objects:110)" in told.stderr
            assert "the frames of both models differ" in told.stderr
        run(house, "interlink", "undo", number)


def test_a_flat_mesh_is_refused_and_nothing_is_stored(house: House) -> None:
    """The file has five good models and one whose mesh has no volume."""

    def stored() -> list[Any]:
        with package.connect(house.url) as db:
            tables = ("object_model", "action", "gripper", "device")
            counts = [f"(SELECT count(*) FROM semmap.{table})" for table in tables]
            return db.session.execute(f"SELECT {', '.join(counts)}").fetchall()

    before = stored()
    flat = house.folder / "flat.sql"
    text = dump(house, Pose(), meshes=True).read_text()
    lines = text.splitlines()
    number = next(n for n, line in enumerate(lines) if line.startswith("15\t{"))
    lines[number] = "15\t{0,0,0,100,0,0,0,100,0}\t{0,1,2}"
    flat.write_text("\n".join(lines) + "\n")
    words = ("manipulation", "import-grasps", flat, "--gripper", "WILLOW=plates")
    with pytest.raises(ManipulationError, match="mesh 15: the mesh is flat, it has no volume"):
        semmap(house.url, *words, "--scale", "0.001")
    lines[number] = "15\t{0,0,0,100,0,0,0,100,0}\t{0,1,3}"
    flat.write_text("\n".join(lines) + "\n")
    with pytest.raises(ManipulationError, match="mesh 15: a triangle has a vertex that is not"):
        semmap(house.url, *words, "--scale", "0.001")
    assert stored() == before


def test_a_correction_of_a_linked_grasp_belongs_to_the_object(house: House) -> None:
    """What trial and error make of it is stored for the object; the linked model keeps its own."""
    with package.connect(house.url) as db, db.session.transaction():
        db.session.execute("DELETE FROM semmap.object_model")
    words = ("manipulation", "import-grasps", dump(house, Pose(), meshes=False), "--gripper")
    run(house, *words, "WILLOW=plates", "--scale", "0.001")
    number = link(house)
    name = "Vase_01_001"
    poses: list[Any] = []

    def attempt(grasp: Grasp) -> TrialOutcome:
        poses.append(grasp.pose)
        turned = (0.8, 0.0, 0.0) if np.allclose(grasp.pose, poses[0]) else (0.0, 0.0, 0.0)
        return TrialOutcome(HEIGHT, 0.0, 0.0, 0.05, 0.05, turned, (0.0, 0.0, 0.0))

    with package.connect(house.url) as db:
        session = db.map("house").connection
        rows = find_grasps(seen_by(session), name=name, gripper="plates", check=False).rows
        linked = [row for row in rows if row["link"] is not None]
        made = practise(
            seen_by(session), name, "plates", rows=linked, attempt=attempt, simulated=False
        )
        assert [each["outcome"] for each in made] == ["turned", "completed"]
        stored = made[-1]["stored"]
        found = session.execute(
            "SELECT a.replaced_by, b.object_id = h.object_id, a.object_id = h.object_id "
            "FROM action a, action b, entity_object h "
            "WHERE a.id = %s AND b.id = %s AND h.entity_id = entity_id(%s)",
            (linked[0]["action_id"], stored, name),
        ).fetchall()
        assert found == [(None, True, False)]
        best = find_grasps(seen_by(session), name=name, gripper="plates", check=False).rows[0]
        assert best["action_id"] == stored
    run(house, "interlink", "undo", number)
