"""Occupancy of OFFICE-40x25 in [0.05, 1.40] m, beside slicing with trimesh, VTK and manifold3d.

One thread, unless a row has two. `python -m benchmarks.slabs --full` takes 2 million triangles.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks import office
from benchmarks.timing import Row, median_seconds, medians_in_turn, print_rows
from navgrid.grid import Grid
from navgrid.slabs import occupancy
from semmap.geometry.mesh import Mesh, join

__all__ = ["Scene", "main", "scene"]

INTERVAL = (0.05, 1.40)
PLANES = [round(0.05 * i, 2) for i in range(1, 29)]
OVERLAPPING = [(0.05 + 0.1 * i, 0.55 + 0.12 * i) for i in range(8)]
GRID = Grid((-0.0137, -0.0171), 0.05, (501, 801))
"""No face of the office lies on a border of its cells: peers round there, each in its way."""
_SHIFT = 14  # bits behind the point for cv2

Segments = NDArray[np.float64]  # (N, 2, 2) x, y


@dataclass(frozen=True, eq=False)
class Scene:
    """The office as one mesh, with the solid of each face."""

    mesh: Mesh
    solid: NDArray[np.int32]

    @property
    def arrays(self) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """The vertices and the faces."""
        return self.mesh.vertices, self.mesh.faces


def scene(edge: float) -> Scene:
    """The office with edges of about that length."""
    parts = office.meshes(edge)
    counts = [len(m.faces) for m in parts]
    return Scene(join(parts), np.repeat(np.arange(len(parts), dtype=np.int32), counts))


def drawn(segments: Segments, thickness: int = 1) -> NDArray[np.bool_]:
    """Segments on the grid by cv2, which rounds to cells."""
    import cv2

    canvas = np.zeros(GRID.shape, np.uint8)
    cells = (segments - np.array(GRID.origin)) / GRID.resolution - 0.5
    ends = np.rint(cells * (1 << _SHIFT)).astype(np.int32)
    cv2.polylines(canvas, list(ends[:, :, None, :]), False, 1, thickness, cv2.LINE_8, _SHIFT)
    return canvas.astype(bool)


def sections_of_trimesh(mesh: Mesh) -> Callable[[], Segments]:
    """trimesh: all planes at once."""
    import trimesh

    body = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)

    def run() -> Segments:
        lines, to_3d, _ = trimesh.intersections.mesh_multiplane(  # type: ignore[no-untyped-call]
            body, plane_origin=(0, 0, 0), plane_normal=(0, 0, 1), heights=PLANES
        )
        world = [
            ends.reshape(-1, 2) @ t[:2, :2].T + t[:2, 3]
            for ends, t in zip(lines, to_3d, strict=True)
            if len(ends)
        ]
        return np.concatenate(world).reshape(-1, 2, 2)

    return run


def sections_of_vtk(mesh: Mesh) -> Callable[[], Segments]:
    """vtkPlaneCutter once a plane."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkPoints, vtkSMPTools
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPlane, vtkPolyData
    from vtkmodules.vtkFiltersCore import vtkPlaneCutter

    vtkSMPTools.SetBackend("Sequential")
    points = vtkPoints()
    points.SetData(numpy_to_vtk(mesh.vertices, deep=True))
    cells = vtkCellArray()
    size = 3 * np.arange(len(mesh.faces) + 1, dtype=np.int64)
    cells.SetData(
        numpy_to_vtkIdTypeArray(size, deep=True),
        numpy_to_vtkIdTypeArray(mesh.faces.ravel().astype(np.int64), deep=True),
    )
    body = vtkPolyData()
    body.SetPoints(points)
    body.SetPolys(cells)
    plane = vtkPlane()
    plane.SetNormal(0, 0, 1)
    cutter = vtkPlaneCutter()
    cutter.SetInputData(body)
    cutter.SetPlane(plane)

    def run() -> Segments:
        segments = []
        for height in PLANES:
            plane.SetOrigin(0, 0, height)
            cutter.Modified()
            cutter.Update()
            cut = cutter.GetOutput()
            if cut.GetNumberOfLines():
                ends = vtk_to_numpy(cut.GetLines().GetConnectivityArray()).reshape(-1, 2)
                segments.append(vtk_to_numpy(cut.GetPoints().GetData())[ends, :2])
        return np.concatenate(segments)

    return run


def projection_of_manifold(parts: Mesh) -> Callable[[], object]:
    """manifold3d: a solid of the arrays, its part between two planes, and its shadow.

    Equal corners are joined beforehand, which it asks for.
    """
    import manifold3d

    vertices, number = np.unique(parts.vertices, axis=0, return_inverse=True)
    faces = number.reshape(-1)[parts.faces]
    degenerate = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    corners = np.ascontiguousarray(vertices)
    triangles = np.ascontiguousarray(faces[~degenerate], dtype=np.uint64)

    def run() -> object:
        body = manifold3d.Manifold(manifold3d.Mesh64(vert_properties=corners, tri_verts=triangles))
        if body.status() != manifold3d.Error.NoError:
            raise RuntimeError(f"manifold3d does not take the office: {body.status()}")
        low, high = INTERVAL
        part = body.trim_by_plane((0, 0, 1), low).trim_by_plane((0, 0, -1), -high)
        return part.project().area()

    return run


def touched(segments: Segments) -> NDArray[np.bool_]:
    """The cells in which points of segments lie, a tenth of a cell apart; cv2 marks others, too."""
    lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    counts = np.maximum(2, np.ceil(lengths / (0.1 * GRID.resolution)).astype(int) + 1)
    which = np.repeat(np.arange(len(segments)), counts)
    share = (np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)) / (
        counts[which] - 1
    )
    points = segments[which, 0] + share[:, None] * (segments[which, 1] - segments[which, 0])
    columns, rows = np.floor((points - np.array(GRID.origin)) / GRID.resolution).astype(int).T
    inside = (rows >= 0) & (rows < GRID.shape[0]) & (columns >= 0) & (columns < GRID.shape[1])
    cells = np.zeros(GRID.shape, np.bool_)
    cells[rows[inside], columns[inside]] = True
    return cells


def one_processor(run: Callable[[], object]) -> Callable[[], object]:
    """A call whose threads, whatever library starts them, share one processor."""

    def pinned() -> object:
        allowed = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {min(allowed)})
        try:
            return run()
        finally:
            os.sched_setaffinity(0, allowed)

    return pinned


def ratio_row(job: str, ours: float, theirs: float, peer: str, least: float) -> Row:
    """A claim that ours is that many times as fast as a peer."""
    ratio = theirs / ours
    return Row(
        job,
        f"{1e3 * ours:.2f} ms: {ratio:.0f}x",
        f"{peer}: {1e3 * theirs:.0f} ms",
        f"at least {least:g}x",
        ratio >= least,
    )


def main(edges: tuple[float, ...] = (0.285,)) -> None:
    """Print the table, for each edge length."""
    import cv2

    cv2.setNumThreads(1)
    for edge in edges:
        rows = measure(scene(edge))
        count = sum(len(m.faces) for m in office.meshes(edge))
        print_rows(f"Slabs: OFFICE-40x25, {count:,} triangles, 801 x 501 cells", rows)


def measure(building: Scene) -> list[Row]:
    """The rows of one size of the office."""
    arrays, faces = building.arrays, len(building.mesh.faces)
    large = faces > 1_000_000
    few = 1 if large else 3

    def one() -> NDArray[np.bool_]:
        return occupancy(arrays, [INTERVAL], GRID, threads=1)

    def filled() -> NDArray[np.bool_]:
        return occupancy(arrays, [INTERVAL], GRID, solid=building.solid, fill=True, threads=1)

    ours = median_seconds(one, 15)
    rows = [
        Row(
            "one interval",
            f"{1e3 * ours:.2f} ms, {faces / ours / 1e6:.0f} M triangles/s",
            "",
            "",
            True,
        )
    ]
    for peer, make, least in (
        ("trimesh, 28 planes", sections_of_trimesh, 80),
        ("vtkPlaneCutter, 28 planes", sections_of_vtk, 50),
    ):
        run = make(building.mesh)
        theirs = median_seconds(one_processor(lambda run=run: drawn(run())), few)  # type: ignore[misc]
        ours = median_seconds(one, 15)
        rows.append(ratio_row("one interval", ours, theirs, peer, least))
        found, exact = touched(run()), one()[0]
        covered = np.count_nonzero(found & exact) / np.count_nonzero(found)
        missed = 1 - np.count_nonzero(found & exact) / np.count_nonzero(exact)
        rows.append(
            Row(
                "cells of the peer that are found",
                f"{100 * covered:.2f} %",
                f"{peer}: misses {100 * missed:.0f} % of ours",
                "99.9 %",
                bool(covered >= 0.999),
            )
        )
    theirs = median_seconds(one_processor(projection_of_manifold(building.mesh)), few)
    rows.append(
        ratio_row("filled", median_seconds(filled, 15), theirs, "manifold3d trim + project", 100)
    )
    single, many = medians_in_turn(
        one, lambda: occupancy(arrays, OVERLAPPING, GRID, threads=1), times=15
    )
    rows.append(
        Row(
            "8 overlapping intervals",
            f"{1e3 * many:.2f} ms: {many / single:.2f}x",
            f"one interval: {1e3 * single:.2f} ms",
            "at most 2.5x",
            many / single <= 2.5,
        )
    )
    alone, both = medians_in_turn(
        one, lambda: occupancy(arrays, [INTERVAL], GRID, threads=2), times=21
    )
    rows.append(
        Row(
            "two threads",
            f"{1e3 * both:.2f} ms: {alone / both:.2f}x",
            f"one thread: {1e3 * alone:.2f} ms",
            "1.7x" if large else "1.7x at 2 M triangles",
            not large or alone / both >= 1.7,
        )
    )
    return rows


if __name__ == "__main__":
    main((0.285, 0.0827) if "--full" in sys.argv else (0.285,))
