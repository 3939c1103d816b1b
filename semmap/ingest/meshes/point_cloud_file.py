"""Point clouds of scanners: LAS and LAZ, PCD and E57, as one object each."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.mesh import Mesh
from semmap.ingest.georeference import frame_of, heights_into_frame, into_frame, scale_note
from semmap.ingest.meshes.laz_points import laz_points
from semmap.ingest.world import Entry, Shape, World, WorldError
from semmap.limits import EXTENT, MESH_BYTES, TRIANGLES

FEWER = "Export fewer points, for example one a voxel."

Points = NDArray[np.float64]
Check = Callable[[int], None]


def read_point_cloud(
    path: Path, *, scale: float = 1.0, georeference: Mapping[str, float] | None = None
) -> World:
    """Return a world of one object with a point cloud, in metres.

    `scale` is metres per unit. The points of a LAS file with a CRS that are far from its origin, or
    in degrees, are brought into the frame of a map with a `georeference`, heights too; without
    one, they set it, and heights stay above the level of the file. All scans of an
    E57 file are joined by their poses. Needs the extra `semmap[clouds]`. A WorldError refuses a
    file that cannot be read, has no points or more than the limit, or lies too far away.
    """
    refused = partial(WorldError, path, "points")
    MESH_BYTES.check(path.stat().st_size, refused, FEWER)
    read = READERS[path.suffix.lower()]
    try:
        points, crs = read(path, lambda count: TRIANGLES.check(count, refused, FEWER))
    except WorldError:
        raise
    except ImportError as error:
        fix = "Install the extra: pip install 'semmap[clouds]'."
        raise WorldError(path, "file", f"needs {error.name}", fix) from error
    except BaseException as error:  # readers of broken bytes raise anything, and that of LAZ panics
        if not isinstance(error, Exception) and type(error).__module__ != "pyo3_runtime":
            raise
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        fix = "The file may be truncated or of another format: export it again."
        raise WorldError(path, "file", f"cannot be read ({reason})", fix) from error
    points = scale * points[np.isfinite(points).all(axis=1)]
    if not len(points):
        raise WorldError(path, "points", "has none", "Give another file.")
    world = World(path.stem, path)
    far = EXTENT.exceeded_by(float(np.abs(points[:, :2]).max()))
    if crs is not None and (far or crs.is_geographic):
        if georeference is None:
            world.notes += scale_note(points[:, :2], crs)
        frame = georeference or frame_of(points[:, :2], crs)
        points[:, :2] = into_frame(points[:, :2], crs, frame)
        points[:, 2] = heights_into_frame(points[:, 2], crs, frame)
        if georeference is None:
            world.georeference, world.surveyed = dict(frame), True
    if EXTENT.exceeded_by(float(np.abs(points).max())):
        raise WorldError(
            path,
            "points",
            f"reach {np.abs(points).max():.0f} m from the origin, and no CRS is stated",
            f"Shift them to the map's frame. {EXTENT.variable} raises the limit.",
        )
    cloud = Mesh(np.unique(points, axis=0), np.empty((0, 3), np.int32))
    world.entries.append(Entry(path.stem, "object", shapes=[Shape("cloud", cloud, uri=path.name)]))
    return world


def _read_las(path: Path, check: Check) -> tuple[Points, Any]:
    import laspy

    _check_records(path)
    with laspy.open(path) as file:
        check(file.header.point_count)
        if file.header.are_points_compressed:
            _check_chunks(path, file.header.offset_to_point_data, file.header.point_count)
            _check_chunk_size(file.header)
            points = laz_points(path)
        else:
            points = np.asarray(file.read().xyz, float)
        return _all(points, file.header.point_count), file.header.parse_crs()


def _all(points: Points, stated: int) -> Points:
    """Return the points of a file that states how many they are; it may be truncated."""
    if len(points) != stated:
        raise ValueError(f"{len(points)} of its {stated} points")
    return points


def _check_records(path: Path) -> None:
    """Refuse a header that claims more records than the file can hold: laspy would read them all.

    LAS 1.4, table 3: their numbers are at bytes 100 and 243; each has at least 54 or 60 bytes.
    """
    with path.open("rb") as file:
        header = file.read(375)
    (records,) = struct.unpack_from("<I", header, 100)
    (extended,) = struct.unpack_from("<I", header, 243) if header[25] >= 4 else (0,)
    if 54 * records + 60 * extended > path.stat().st_size:
        raise ValueError(f"{records + extended} records in {path.stat().st_size} bytes")


def _check_chunks(path: Path, start: int, points: int) -> None:
    """Refuse a LAZ table that claims more chunks than points: its reader would allocate for all."""
    with path.open("rb") as file:
        file.seek(start)
        (table,) = struct.unpack("<q", file.read(8))
        if table == -1:  # written at the end
            file.seek(-8, 2)
            (table,) = struct.unpack("<q", file.read(8))
        file.seek(table)
        _, chunks = struct.unpack("<II", file.read(8))
    if chunks > points:
        raise ValueError(f"{chunks} chunks of {points} points")


def _check_chunk_size(header: Any) -> None:
    """Refuse chunks that are larger than a mesh file: the reader makes room for one of them.

    LAZ: the size is at byte 12 of its record; the highest number means that sizes vary.
    """
    (packing,) = (v for v in header.vlrs if v.record_id == 22204)
    (points,) = struct.unpack_from("<I", packing.record_data_bytes(), 12)
    if points != 2**32 - 1:
        MESH_BYTES.check(points * header.point_format.size, _damaged, FEWER, "its chunks have")


def _damaged(problem: str, fix: str) -> ValueError:
    return ValueError(f"{problem}. {fix}")


def _read_pcd(path: Path, check: Check) -> tuple[Points, None]:
    from pypcd4.pypcd4 import PointCloud

    cloud = PointCloud.from_path(path)
    check(cloud.points)
    return _all(cloud.numpy(("x", "y", "z")).astype(float), cloud.points), None


def _read_e57(path: Path, check: Check) -> tuple[Points, None]:
    import pye57

    file = pye57.E57(str(path))
    try:
        check(sum(file.get_header(number).point_count for number in range(file.scan_count)))
        scans = []
        for number in range(file.scan_count):
            data = file.read_scan(number, ignore_missing_fields=True)
            axes = [data[f"cartesian{axis}"] for axis in "XYZ"]
            scans.append(np.column_stack(axes))
        return np.concatenate([np.empty((0, 3)), *scans]), None
    finally:
        file.close()


READERS: dict[str, Callable[[Path, Check], tuple[Points, Any]]] = {
    ".las": _read_las,
    ".laz": _read_las,
    ".pcd": _read_pcd,
    ".e57": _read_e57,
}
"""The reader of each ending: points (N, 3) in the file's units, and their CRS if it is stated."""
