"""The recogniser on views of YCB objects: a confusion matrix, for clear and for hidden objects.

``python -m benchmarks recognition`` needs the folder of real worlds, see ``tests/conftest.py``.
"""

from __future__ import annotations

import os
import statistics
import time
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rich.console import Console
from rich.table import Table

from semmap.draw.depth_camera import DepthCamera, look_at
from semmap.geometry.mesh import Mesh, box_mesh, join
from semmap.ingest.meshes.mesh_file import read_mesh
from semmap.perception.models import KnownObject, depth_points, train_model
from semmap.perception.recognition import Scene, recognise_cluster
from semmap.perception.tabletop import segment_tabletop

__all__ = ["camera_at", "cloud_of", "main", "random_view", "rates", "trial", "ycb_meshes"]

WORLDS = Path(os.environ.get("SEMMAP_WORLDS", "../shared/worlds"))

STRANGERS = ("Vase_01", "Tablet_01", "LightC_01", "SecurityCamera_01", "SeasoningBox_01")
"""Objects of small_house that no model is of."""

NOISE = 0.001
"""Standard deviation of depths, metres."""


def ycb_meshes(worlds: Path) -> dict[str, Mesh]:
    """Return the YCB objects by name, z up."""
    files = sorted((worlds / "ycb" / "meshes").glob("*.gltf"))
    return {file.stem[4:].removesuffix("_textured"): read_mesh(file) for file in files}


def placed(mesh: Mesh, random: np.random.Generator) -> Mesh:
    """Return a mesh on the table z = 0: upright or on a side, at a random heading."""
    side = random.integers(0, 3)
    turn = np.roll(np.eye(3), side, axis=0)
    cos, sin = np.cos(yaw := random.uniform(0, 2 * np.pi)), np.sin(yaw)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]) @ turn
    corners = mesh.vertices @ turn.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    shift = np.array([*-(low + high)[:2] / 2, -low[2]])
    return Mesh(corners + shift, mesh.faces)


def camera_at(eye: ArrayLike, target: ArrayLike) -> DepthCamera:
    """Return a camera of 320 x 240 pixels that opens 37 degrees."""
    return DepthCamera((320, 240), (480.0, 480.0, 159.5, 119.5), look_at(eye, target))


def cloud_of(
    camera: DepthCamera, parts: list[Mesh], random: np.random.Generator
) -> NDArray[np.float64]:
    """Return the cloud (240, 320, 3) that a camera takes of meshes, with noise, in its frame."""
    depths, _ = camera.image(join(parts).triangles)
    return depth_points(camera, depths + random.normal(0, NOISE, depths.shape))


class View(NamedTuple):
    """A table with an object, and where a camera is."""

    parts: list[Mesh]
    eye: NDArray[np.float64]
    middle: tuple[float, float, float]
    hidden: float


def random_view(mesh: Mesh, random: np.random.Generator, hidden: bool) -> View:
    """Return an object on a table, in view; a tenth to seven tenths of it behind a post."""
    table = box_mesh((-0.5, -0.4, -0.03), (0.5, 0.4, 0.0))
    while True:
        body = placed(mesh, random)
        yaw, pitch = random.uniform(0, 2 * np.pi), random.uniform(np.radians(25), np.radians(60))
        ahead = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
        eye = random.uniform(0.6, 0.9) * ahead
        middle = (0.0, 0.0, float(np.ptp(body.vertices[:, 2])) / 2)
        if not hidden:
            return View([table, body], eye, middle, 0.0)
        at = random.uniform(0.14, 0.2) * np.array([np.cos(yaw), np.sin(yaw)])
        at += random.uniform(-0.06, 0.06) * np.array([-np.sin(yaw), np.cos(yaw)])
        (x0, y0), (x1, y1) = at - (half := random.uniform(0.015, 0.04)), at + half
        post = box_mesh((x0, y0, 0.0), (x1, y1, random.uniform(0.08, 0.25)))
        camera = camera_at(eye, middle)
        first, last = len(table.faces), len(table.faces) + len(body.faces)
        seen = [camera.image(join(p).triangles)[1] for p in ([table, body], [table, body, post])]
        alone, beside = (int(((f >= first) & (f < last)).sum()) for f in seen)
        if 0.1 < (share := 1 - beside / max(alone, 1)) < 0.7:
            return View([table, body, post], eye, middle, share)


def trial(
    mesh: Mesh, models: list[KnownObject], random: np.random.Generator, hidden: bool
) -> tuple[str, float, float]:
    """Look at an object on a table; return the answer, the hidden share and the seconds."""
    view = random_view(mesh, random, hidden)
    camera = camera_at(view.eye, view.middle)
    cloud = cloud_of(camera, view.parts, random)
    start = time.perf_counter()
    table = segment_tabletop(cloud, up=camera.pose[:3, :3].T @ (0, 0, 1))
    there = camera.pose[:3, :3].T @ (view.middle - view.eye)
    clusters = [c for c in table.clusters if np.linalg.norm(c.mean(axis=0) - there) < 0.1]
    answer = "not found"
    if clusters:
        answer = recognise_cluster(clusters[0], models, Scene(cloud)).name or "unknown"
    return answer, view.hidden, time.perf_counter() - start


def main(trials: int = 12) -> None:
    """Print the matrices."""
    meshes = ycb_meshes(WORLDS)
    if not meshes:
        print(f"{WORLDS}/ycb is absent: set SEMMAP_WORLDS to the folder of real worlds")
        return
    models = [train_model(name, mesh) for name, mesh in meshes.items()]
    random = np.random.default_rng(3)
    seconds: list[float] = []
    matrices = []
    for hidden in (False, True):
        answers: dict[str, Counter[str]] = {}
        shares: list[float] = []
        for name, mesh in meshes.items():
            answers[name] = Counter()
            for _ in range(trials):
                answer, share, took = trial(mesh, models, random, hidden)
                answers[name][answer] += 1
                shares.append(share)
                seconds.append(took)
        for number, left_out in enumerate(meshes):
            others = models[:number] + models[number + 1 :]
            of = answers.setdefault("(without its model)", Counter())
            for _ in range(trials // 6):
                of[trial(meshes[left_out], others, random, hidden)[0]] += 1
        of = answers.setdefault("(of small_house)", Counter())
        for stranger in STRANGERS:
            file = next(
                (WORLDS / "small_house" / "models").glob(f"*_{stranger}/meshes/*visual.DAE")
            )
            mesh = read_mesh(file, dae_up_axis=False)
            for _ in range(trials // 6):
                of[trial(mesh, models, random, hidden)[0]] += 1
        _show("partly hidden" if hidden else "in clear view", answers, [*meshes], shares)
        matrices.append(answers)
    hit, false_alarm = rates(matrices, [*meshes])
    print(
        f"P(answered | it is this object) {hit:.2f}, "
        f"P(answered | it is another one) {false_alarm:.3f}"
    )
    print(f"{1e3 * statistics.median(seconds):.0f} ms a view with segmentation (median)")


def rates(matrices: list[dict[str, Counter[str]]], names: list[str]) -> tuple[float, float]:
    """Return how often an object is answered if it is there, and if it is another, on average."""
    rows = [(true, counts) for matrix in matrices for true, counts in matrix.items()]
    hits = sum(counts[true] for true, counts in rows if true in names)
    own = sum(counts.total() for true, counts in rows if true in names)
    wrong = sum(counts[name] for true, counts in rows for name in names if name != true)
    others = sum(counts.total() for true, counts in rows for name in names if name != true)
    return hits / own, wrong / others


def _show(
    title: str, answers: dict[str, Counter[str]], names: list[str], shares: list[float]
) -> None:
    right = sum(answers[name][name] for name in names)
    every = sum(answers[name].total() for name in names)
    wrong = every - right - sum(answers[n]["unknown"] + answers[n]["not found"] for n in names)
    table = Table(
        title=f"{title}: {right / every:.1%} right, {wrong / every:.1%} wrong; "
        f"{np.mean(shares):.0%} hidden on average",
        title_justify="left",
    )
    columns = [*names, "unknown", "not found"]
    table.add_column("object \\ answer")
    for column in columns:
        table.add_column(column.replace("_", " "), justify="right", overflow="fold")
    for name, counts in answers.items():
        table.add_row(name.replace("_", " "), *(str(counts[c] or "") for c in columns))
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
