"""Point clouds of scanners, written by the libraries of their formats."""

import struct

import laspy
import numpy as np
import pye57
import pytest
from pypcd4.pypcd4 import PointCloud
from pyproj import CRS, Proj
from scipy.spatial import cKDTree

from semmap.ingest.importer import read_world
from semmap.ingest.world import WorldError

POINTS = np.random.default_rng(5).uniform((-2, 1, 0), (3, 4, 2.5), (400, 3)).round(3)


def same_points(found, known):
    """Whether each known point is found within 2 mm, once."""
    distances, which = cKDTree(found).query(known)
    return len(found) == len(known) == len(set(which)) and distances.max() < 2e-3


def write_las(path, points=POINTS, crs=None):
    header = laspy.LasHeader(point_format=6 if "+" in (crs or "") else 3, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), np.floor(points.min(axis=0))
    if crs is not None:
        header.add_crs(CRS.from_user_input(crs))
    file = laspy.LasData(header)
    file.x, file.y, file.z = points.T
    file.write(str(path))


def write_pcd(path):
    PointCloud.from_xyz_points(POINTS.astype(np.float32)).save(path)


def write_e57(path):
    """Two scans, the second turned by a right angle and shifted."""
    file = pye57.E57(str(path), mode="w")
    half = len(POINTS) // 2
    quarter = np.array([np.cos(np.pi / 4), 0, 0, np.sin(np.pi / 4)])
    for points, turn, shift in (
        (POINTS[:half], np.array([1.0, 0, 0, 0]), np.zeros(3)),
        (POINTS[half:], quarter, np.array([1.0, 2.0, 0.5])),
    ):
        local = points - shift
        if turn is quarter:  # the scan's frame: turned back by a right angle about z
            local = np.column_stack([local[:, 1], -local[:, 0], local[:, 2]])
        data = {f"cartesian{axis}": local[:, i] for i, axis in enumerate("XYZ")}
        file.write_scan_raw(data, rotation=turn, translation=shift)
    file.close()


@pytest.mark.parametrize(
    ("name", "write"),
    [("a.las", write_las), ("a.laz", write_las), ("a.pcd", write_pcd), ("a.e57", write_e57)],
)
def test_each_format_gives_the_points_in_metres(tmp_path, name, write):
    write(tmp_path / name)
    (entry,) = read_world(tmp_path / name).entries
    (shape,) = entry.shapes
    assert (entry.name, shape.kind, len(shape.mesh.faces)) == ("a", "cloud", 0)
    assert same_points(shape.mesh.vertices, POINTS)
    (scaled,) = read_world(tmp_path / name, scale=0.5).entries
    assert same_points(scaled.shapes[0].mesh.vertices, POINTS / 2)


def test_the_crs_of_a_survey_becomes_the_georeference(tmp_path):
    east, north = Proj("EPSG:32632")(11.57, 48.14)
    survey = np.add(POINTS, (east, north, 500))
    write_las(tmp_path / "survey.las", survey, "EPSG:32632")
    world = read_world(tmp_path / "survey.las")
    frame = world.georeference
    assert frame["crs"] == 32632
    vertices = world.entries[0].shapes[0].mesh.vertices
    assert vertices[:, :2].min() >= 0
    assert vertices[:, :2].max() < 7
    back = np.add(vertices, (frame["easting"], frame["northing"], 0))
    assert same_points(back, survey)
    placed = {"crs": 32632, "easting": east, "northing": north, "height": 0.0, "rotation": 0.0}
    again = read_world(tmp_path / "survey.las", georeference=placed)
    assert again.georeference is None
    assert same_points(again.entries[0].shapes[0].mesh.vertices[:, :2], POINTS[:, :2])


@pytest.mark.parametrize("crs", ["EPSG:2263", "EPSG:2263+6360", "EPSG:2263+5703"])
def test_heights_in_feet_become_metres(tmp_path, crs):
    """5703 is in metres, also over a grid in feet; the oracle is the definition of the US foot."""
    foot = 1200 / 3937
    unit = np.array([foot, foot, 1.0 if crs.endswith("5703") else foot])
    write_las(tmp_path / "feet.las", np.add(POINTS / unit, (985000, 195000, 30)), crs)
    world = read_world(tmp_path / "feet.las")
    points = world.entries[0].shapes[0].mesh.vertices
    expected = POINTS[:, 2] + 30 * unit[2]
    assert np.sort(points[:, 2]) == pytest.approx(np.sort(expected), abs=1e-3)
    assert np.ptp(points[:, :2], axis=0) == pytest.approx(np.ptp(POINTS[:, :2], axis=0), abs=0.2)
    (note,) = world.notes
    assert note.startswith("lengths in ")
    assert len(note) < 140


def test_heights_come_into_the_frame_of_a_map_above_the_sea(tmp_path):
    survey = np.add(POINTS, (691600, 5334700, 520))
    write_las(tmp_path / "survey.las", survey, "EPSG:32632")
    frame = {"crs": 32632, "easting": 691600, "northing": 5334700, "height": 520, "rotation": 0}
    world = read_world(tmp_path / "survey.las", georeference=frame)
    assert same_points(world.entries[0].shapes[0].mesh.vertices, POINTS)


def test_a_survey_in_degrees_comes_into_metres(tmp_path):
    grid = Proj("EPSG:32632")
    east, north = grid(11.57, 48.14)
    header = laspy.LasHeader(point_format=3, version="1.4")
    header.scales, header.offsets = [1e-9, 1e-9, 0.001], [11.57, 48.14, 0]
    header.add_crs(CRS.from_epsg(4326))
    file = laspy.LasData(header)
    file.x, file.y = grid(POINTS[:, 0] + east, POINTS[:, 1] + north, inverse=True)
    file.z = POINTS[:, 2]
    file.write(str(tmp_path / "degrees.las"))
    frame = {"crs": 32632, "easting": east, "northing": north, "height": 0, "rotation": 0}
    world = read_world(tmp_path / "degrees.las", georeference=frame)
    assert same_points(world.entries[0].shapes[0].mesh.vertices, POINTS)


@pytest.mark.parametrize("ending", [".las", ".laz", ".pcd", ".e57"])
@pytest.mark.parametrize("content", [b"", b"LASF", b"\0" * 5000])
def test_a_broken_file_is_refused(tmp_path, ending, content):
    path = tmp_path / f"broken{ending}"
    path.write_bytes(content)
    with pytest.raises(WorldError, match=r"cannot be read|has none"):
        read_world(path)


def test_points_far_away_without_a_crs_are_refused(tmp_path):
    write_las(tmp_path / "far.las", np.add(POINTS, (691600, 5334700, 0)))
    with pytest.raises(WorldError, match="no CRS is stated"):
        read_world(tmp_path / "far.las")


def test_more_points_than_the_limit_are_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("SEMMAP_MAX_TRIANGLES", "100")
    for name, write in (("a.las", write_las), ("a.pcd", write_pcd), ("a.e57", write_e57)):
        write(tmp_path / name)
        with pytest.raises(WorldError, match="SEMMAP_MAX_TRIANGLES"):
            read_world(tmp_path / name)


def test_headers_that_claim_more_than_the_file_holds_are_refused_at_once(tmp_path):
    """Their readers would read, or allocate, for minutes."""
    write_las(tmp_path / "a.las")
    records = bytearray((tmp_path / "a.las").read_bytes())
    struct.pack_into("<I", records, 100, 4_000_000_000)
    (tmp_path / "records.las").write_bytes(records)
    with pytest.raises(WorldError, match="records in"):
        read_world(tmp_path / "records.las")

    write_las(tmp_path / "a.laz")
    chunks = bytearray((tmp_path / "a.laz").read_bytes())
    (start,) = struct.unpack_from("<I", chunks, 96)  # LAS 1.4, table 3: offset to the points
    (table,) = struct.unpack_from("<q", chunks, start)
    struct.pack_into("<I", chunks, table + 4, 1_000_000)
    (tmp_path / "chunks.laz").write_bytes(chunks)
    with pytest.raises(WorldError, match="chunks of"):
        read_world(tmp_path / "chunks.laz")


@pytest.mark.parametrize(("write", "ending"), [(write_las, "las"), (write_pcd, "pcd")])
def test_a_file_that_lacks_whole_points_is_refused(write, ending, tmp_path):
    """One, or all but one: the rest could be read."""
    path = tmp_path / f"scan.{ending}"
    write(path)
    whole, size = path.read_bytes(), 12
    if ending == "las":
        with laspy.open(path) as file:
            size = file.header.point_format.size
    for lacking in (1, len(POINTS) - 1):
        path.write_bytes(whole[: -lacking * size])
        with pytest.raises(
            WorldError, match=f"{len(POINTS) - lacking} of its {len(POINTS)} points"
        ):
            read_world(path)
