"""Grasps of the Household Objects Database (Willow Garage) into the tables of actions.

Its table ``grasp`` has, for each scaled model and hand, a grasp and a pre-grasp: a position
``{x, y, z, qw, qx, qy, qz}`` (w first) of the hand in the model's frame, and joint positions
``{j1, ...}``. Files are CSV with its column names, JSON (a list of such rows), or the text that
``pg_dump`` writes, which may also have the tables of models. Meshes (``mesh_vertex_list`` and
``mesh_triangle_list``, arrays of numbers) give a model its primitive, by which its frame is known.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from semmap.belief.store.beliefs import Session
from semmap.geometry.pose import Pose
from semmap.ingest.naming import guess_type
from semmap.limits import TEXT_BYTES
from semmap.manipulation.action_record import ActionRecord, pose_of
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.store.actions import add_actions
from semmap.manipulation.store.database_answers import column
from semmap.manipulation.store.devices import gripper_id
from semmap.manipulation.store.models import add_object

Row = dict[str, Any]

NEEDED = ("scaled_model_id", "hand_name", "grasp_grasp_position")
"""Columns without which a row is not a grasp."""

QUALITIES = ("grasp_scaled_quality", "grasp_epsilon_quality")
"""Columns with a share, the higher the better; else `ENERGY`."""

ENERGY = "grasp_energy"
"""The lower, the better: the quality is the rank among the grasps of a model and hand."""


def import_household_grasps(
    session: Session,
    paths: Sequence[Path],
    grippers: Mapping[str, str] | None = None,
    *,
    tool: Sequence[float] | None = None,
    scale: float = 1.0,
) -> dict[str, int]:
    """Store the grasps of files, all or none; return how many `models` and `grasps` there are.

    Stored `grippers` are named by ``hand_name``; `tool` is the grasp frame (x, y, z, qx, qy, qz,
    qw) in that of the hand; `scale` is metres per unit: 0.001 for older databases.
    ManipulationError names the file, the row and the fix, LookupError the hand that is not stored.
    """
    if not (math.isfinite(scale) and scale > 0):
        raise ManipulationError(f"scale is {scale}: give metres per unit, above 0")
    frame = Pose() if tool is None else pose_of(list(tool), "tool")
    rows = [(path, n, row) for path in paths for n, row in enumerate(read_rows(path), 1)]
    names = _names([row for _, _, row in rows])
    meshes = _meshes(rows)
    groups: dict[tuple[str, str], list[tuple[Row, ActionRecord]]] = {}
    joints: dict[str, list[str]] = {}
    for path, number, row in rows:
        if "grasp_id" not in row and "grasp_grasp_position" not in row:
            continue
        where = f"{path}: grasp {row.get('grasp_id') or number}"
        missing = [column for column in NEEDED if not _has(row, column)]
        if missing:
            raise ManipulationError(f"{where}: has no {missing[0]}: add that column")
        hand = (grippers or {}).get(str(row["hand_name"]), str(row["hand_name"]))
        if hand not in joints:
            joints[hand] = _joints(session, hand)
        record = _record(row, joints[hand], frame, scale, where)
        groups.setdefault((str(row["scaled_model_id"]), hand), []).append((row, record))
    if not groups:
        raise ManipulationError(
            f"{', '.join(map(str, paths))}: has no grasp: give rows with {', '.join(NEEDED)}"
        )
    with session.transaction():
        for (model, hand), group in groups.items():
            name = names.get(model)
            object_ = add_object(
                session,
                f"household_objects:{model}",
                name=name,
                type=_type(session, name),
                primitive=_primitive(model, meshes, scale),
            )
            add_actions(session, object_, hand, _ranked(group))
    return {
        "models": len({model for model, _ in groups}),
        "grasps": sum(len(group) for group in groups.values()),
    }


def read_rows(path: Path) -> Iterator[Row]:
    """The rows of a file: CSV, JSON, or the sections ``COPY ... FROM stdin`` of pg_dump."""
    try:
        TEXT_BYTES.check(
            path.stat().st_size,
            lambda p, f: ManipulationError(f"{path}: {p}: {f}"),
            "split it into several files",
        )
        text = path.read_text("utf-8")
    except OSError as error:
        raise ManipulationError(
            f"{path}: cannot be read ({error.strerror}): check the path"
        ) from error
    except UnicodeDecodeError as error:
        raise ManipulationError(f"{path}: byte {error.start} is not UTF-8: save it so") from error
    if "\0" in text or "\\u0000" in text:
        raise ManipulationError(f"{path}: has a NUL character: remove it")
    if path.suffix.lower() == ".json":
        return _json_rows(text, path)
    if path.suffix.lower() == ".csv":
        return _csv_rows(text, path)
    if path.suffix.lower() in (".sql", ".dump"):
        return _dump_rows(text)
    raise ManipulationError(f"{path}: {path.suffix!r} is not known: give .csv, .json or .sql")


def _csv_rows(text: str, path: Path) -> Iterator[Row]:
    try:
        yield from csv.DictReader(text.splitlines())
    except csv.Error as error:
        raise ManipulationError(f"{path}: is not valid CSV: {error}") from error


def _json_rows(text: str, path: Path) -> Iterator[Row]:
    try:
        found = json.loads(text)
        json.dumps(found, ensure_ascii=False).encode()  # refuses half of a pair of surrogates
    except (ValueError, RecursionError) as error:
        raise ManipulationError(f"{path}: is not valid JSON: {error}") from error
    if not isinstance(found, list) or not all(isinstance(row, dict) for row in found):
        raise ManipulationError(f"{path}: is not a list of rows: give [{{...}}, ...]")
    return iter(found)


def _dump_rows(text: str) -> Iterator[Row]:
    """The rows of the COPY sections of a text dump; its null is an absent column."""
    columns: list[str] | None = None
    for line in text.splitlines():
        if columns is not None:
            if line == r"\.":
                columns = None
                continue
            pairs = zip(columns, line.split("\t"), strict=False)
            yield {column: value for column, value in pairs if value != r"\N"}
        elif line.startswith("COPY ") and line.rstrip().endswith("FROM stdin;"):
            listed = line.partition("(")[2].rpartition(")")[0]
            columns = [column.strip().strip('"') for column in listed.split(",")]


def _names(rows: Sequence[Row]) -> dict[str, str]:
    """The names of scaled models: those of the original models that they are scaled from."""
    originals = {
        str(row["original_model_id"]): str(row["original_model_model"])
        for row in rows
        if row.get("original_model_id") and row.get("original_model_model")
    }
    return {
        str(row["scaled_model_id"]): originals[str(row["original_model_id"])]
        for row in rows
        if row.get("scaled_model_id") and str(row.get("original_model_id")) in originals
    }


MESH = ("mesh_vertex_list", "mesh_triangle_list")
"""Columns of a mesh: x, y, z of each vertex, and three numbers of vertices for each triangle."""


class _Mesh(NamedTuple):
    """Vertices (N, 3) and faces (F, 3) of a model, as they are in the file, and where that is."""

    vertices: Any
    faces: Any
    where: str


def _meshes(rows: Sequence[tuple[Path, int, Row]]) -> dict[str, _Mesh]:
    """The meshes by scaled model: their own, or scaled ones of the original models."""
    own: dict[tuple[str, str], _Mesh] = {}
    for path, number, row in rows:
        if all(_has(row, column) for column in MESH):
            key = next((k for k in ("scaled_model_id", "original_model_id") if row.get(k)), None)
            where = f"{path}: mesh {row.get(key) if key else number}"
            if key is None:
                raise ManipulationError(f"{where}: has no original_model_id: add that column")
            own[key, str(row[key])] = _mesh(row[MESH[0]], row[MESH[1]], where)
    found = {id_: mesh for (key, id_), mesh in own.items() if key == "scaled_model_id"}
    for path, number, row in rows:
        original = own.get(("original_model_id", str(row.get("original_model_id"))))
        if row.get("scaled_model_id") and original is not None:
            where = f"{path}: row {number}: scaled_model_scale"
            given = row.get("scaled_model_scale")
            factor = 1.0 if given in (None, "") else _number(given, where)
            found.setdefault(
                str(row["scaled_model_id"]), original._replace(vertices=factor * original.vertices)
            )
    return found


def _mesh(vertices: Any, faces: Any, where: str) -> _Mesh:
    points, corners = (np.array(_array(given, where)) for given in (vertices, faces))
    if len(points) % 3 or len(corners) % 3 or not len(points):
        raise ManipulationError(
            f"{where}: has {len(points)} numbers of vertices and {len(corners)} of triangles: give "
            "three for each"
        )
    if len(corners) and not ((corners >= 0) & (corners < len(points) // 3)).all():
        raise ManipulationError(
            f"{where}: a triangle has a vertex that is not there: they are numbered from 0 to "
            f"{len(points) // 3 - 1}"
        )
    return _Mesh(points.reshape(-1, 3), corners.astype(int).reshape(-1, 3), where)


def _primitive(model: str, meshes: Mapping[str, _Mesh], scale: float) -> Any:
    """The primitive of a scaled model; None without a mesh."""
    import trimesh  # slow to load, as what fits primitives

    from semmap.perception.mesh_shapes import mesh_primitive
    from semmap.perception.point_cloud import PerceptionError

    if model not in meshes:
        return None
    mesh = meshes[model]
    try:
        return mesh_primitive(trimesh.Trimesh(scale * mesh.vertices, mesh.faces, process=False))
    except PerceptionError as error:
        raise ManipulationError(f"{mesh.where}: {error}") from error


def _joints(session: Session, hand: str) -> list[str]:
    """The joints of a stored gripper, in the order of its URDF."""
    id_ = gripper_id(session, hand)
    row = session.execute("SELECT joints FROM device WHERE id = %s", (id_,)).fetchone()
    return list(row[0]) if row else []


def _record(row: Row, names: Sequence[str], tool: Pose, scale: float, where: str) -> ActionRecord:
    pose = _pose(row, "grasp_grasp_position", scale, where)
    before = row.get("grasp_pregrasp_position")
    stated = next((column for column in QUALITIES if _has(row, column)), None)
    quality = 0.5 if stated is None else _number(row[stated], f"{where}: {stated}")
    return ActionRecord(
        "grasp",
        pose @ tool,
        None if not before else _pose(row, "grasp_pregrasp_position", scale, where) @ tool,
        posture=_posture(row, "grasp_grasp_joints", names, where),
        pre_posture=_posture(row, "grasp_pregrasp_joints", names, where),
        quality=min(max(quality, 0.0), 1.0),
    ).checked(where)


def _ranked(group: Sequence[tuple[Row, ActionRecord]]) -> list[ActionRecord]:
    """The records; without a quality, by the rank of their energy."""
    energies = [row.get(ENERGY) for row, _ in group]
    if None in energies or any(_has(row, c) for row, _ in group for c in QUALITIES):
        return [record for _, record in group]
    values = np.array([_number(energy, ENERGY) for energy in energies])
    ranks = np.searchsorted(np.sort(values), values, side="left") / len(values)
    return [
        replace(record, quality=float(1 - rank))
        for (_, record), rank in zip(group, ranks, strict=True)
    ]


def _has(row: Row, column: str) -> bool:
    return bool(str(row.get(column) or "").strip())


def _array(given: Any, where: str) -> list[float]:
    """The numbers of an array, as PostgreSQL writes it (``{1,2}``) or as JSON has it."""
    if isinstance(given, str):
        text = given.strip().strip("{}[]()")
        given = text.split(",") if text.strip() else []
    if not isinstance(given, list | tuple):
        raise ManipulationError(f"{where}: {given!r} is not an array: give {{1,2,...}}")
    return [_number(value, where) for value in given]


def _number(given: Any, where: str) -> float:
    try:
        number = float(given)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise ManipulationError(f"{where}: {given!r} is not a finite number")
    return number


def _pose(row: Row, column: str, scale: float, where: str) -> Pose:
    where = f"{where}: {column}"
    numbers = _array(row[column], where)
    if len(numbers) != 7:
        raise ManipulationError(
            f"{where}: has {len(numbers)} numbers: give {{x, y, z, qw, qx, qy, qz}}"
        )
    x, y, z, w, *q = numbers
    return pose_of([x * scale, y * scale, z * scale, *q, w], where)


def _posture(row: Row, column: str, names: Sequence[str], where: str) -> dict[str, float]:
    """Joint positions by name; a gripper without the names has joint1, joint2, ..."""
    if row.get(column) in (None, ""):
        return {}
    positions = _array(row[column], f"{where}: {column}")
    if len(names) != len(positions):
        names = [f"joint{n}" for n in range(1, len(positions) + 1)]
    return dict(zip(names, positions, strict=True))


def _type(session: Session, name: str | None) -> str | None:
    """The type that a name tells, if the database has it."""
    guess = guess_type(name) if name else None
    known = column(session, "SELECT name FROM semantic_type")
    return guess.type if guess is not None and guess.type in known else None
