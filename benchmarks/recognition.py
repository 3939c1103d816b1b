"""The recogniser on views of YCB objects: a confusion matrix, for clear and for hidden objects.

``python -m benchmarks recognition`` needs the folder of real worlds, see ``tests/conftest.py``.
"""

from __future__ import annotations

import os
import statistics
import time
from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from semmap.draw.depth_camera import DepthCamera, look_at
from semmap.geometry.mesh import Mesh, box_mesh, join
from semmap.ingest.meshes.mesh_file import read_mesh
from semmap.perception.models import ObjectModel, depth_points, train_model
from semmap.perception.recognition import Scene, recognise_cluster
from semmap.perception.tabletop import segment_tabletop

__all__ = ["main", "placed", "view_of", "ycb_meshes"]

WORLDS = Path(os.environ.get("SEMMAP_WORLDS", "../shared/worlds"))

STRANGERS = ("Vase_01", "Tablet_01", "LightC_01", "SecurityCamera_01", "SeasoningBox_01")
"""Objects of small_house that no model is of."""

NOISE = 0.001
"""Standard deviation of depths, metres."""


def ycb_meshes(worlds: Path) -> dict[str, Mesh]:
    """Return the YCB objects by name, z up."""
    files = sorted((worlds / "ycb" / "meshes").glob("*.gltf"))
    return {file.stem[4:].removesuffix("_textured"): read_mesh(file) for file in files}


def placed(mesh: Mesh, random: np.random.Generator, at: tuple[float, float] = (0, 0)) -> Mesh:
    """Return a mesh on the table z = 0: upright or on a side, at a random heading."""
    side = random.integers(0, 3)
    turn = np.roll(np.eye(3), side, axis=0)
    cos, sin = np.cos(yaw := random.uniform(0, 2 * np.pi)), np.sin(yaw)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]) @ turn
    corners = mesh.vertices @ turn.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    shift = np.array([*np.subtract(at, (low + high)[:2] / 2), -low[2]])
    return Mesh(corners + shift, mesh.faces)


def view_of(
    scene: Mesh, random: np.random.Generator, eye: NDArray[np.float64], target: tuple[float, ...]
) -> tuple[NDArray[np.float64], DepthCamera]:
    """Return the cloud (240, 320, 3) that a camera takes, in its frame, and the camera."""
    camera = DepthCamera((320, 240), (480.0, 480.0, 159.5, 119.5), look_at(eye, target))
    depths, _ = camera.image(scene.triangles)
    noisy = depths + random.normal(0, NOISE, depths.shape)
    return depth_points(camera, noisy), camera


def trial(
    mesh: Mesh,
    models: list[ObjectModel],
    random: np.random.Generator,
    hidden: bool,
) -> tuple[str, float, float]:
    """Put an object on a table, look at it; return the answer, the hidden share and seconds."""
    body = placed(mesh, random)
    table = box_mesh((-0.5, -0.4, -0.03), (0.5, 0.4, 0.0))
    yaw, pitch = random.uniform(0, 2 * np.pi), random.uniform(np.radians(25), np.radians(60))
    ahead = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
    eye = random.uniform(0.6, 0.9) * ahead
    parts = [table, body]
    middle = (0.0, 0.0, float(np.ptp(body.vertices[:, 2])) / 2)
    blocked = 0.0
    if hidden:
        front = 0.16 * np.array([np.cos(yaw), np.sin(yaw)])
        front += random.uniform(-1, 1) * 0.05 * np.array([-np.sin(yaw), np.cos(yaw)])
        width, top = 0.02, random.uniform(0.06, 0.16)
        parts.append(
            box_mesh(
                (front[0] - width, front[1] - width, 0), (front[0] + width, front[1] + width, top)
            )
        )
        camera = DepthCamera((320, 240), (480.0, 480.0, 159.5, 119.5), look_at(eye, middle))
        count = len(table.faces), len(table.faces) + len(body.faces)
        seen = [camera.image(join(p).triangles)[1] for p in (parts[:2], parts)]
        shown = [int(((f >= count[0]) & (f < count[1])).sum()) for f in seen]
        blocked = 1 - shown[1] / max(shown[0], 1)
    cloud, camera = view_of(join(parts), random, eye, middle)
    up = camera.pose[:3, :3].T @ (0, 0, 1)
    start = time.perf_counter()
    top_ = segment_tabletop(cloud, up=up)
    where = camera.pose[:3, :3].T @ (np.array(middle) - eye)
    near = [c for c in top_.clusters if np.linalg.norm(c.mean(axis=0) - where) < 0.1]
    if not near:
        return "not found", blocked, time.perf_counter() - start
    found = recognise_cluster(near[0], models, Scene(cloud))
    return found.name or "unknown", blocked, time.perf_counter() - start


def main(trials: int = 30) -> None:
    """Print the matrices."""
    meshes = ycb_meshes(WORLDS)
    if not meshes:
        print(f"{WORLDS}/ycb is absent: set SEMMAP_WORLDS to the folder of real worlds")
        return
    models = [train_model(name, mesh) for name, mesh in meshes.items()]
    random = np.random.default_rng(3)
    seconds: list[float] = []
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
    print(f"{1e3 * statistics.median(seconds):.0f} ms a view with segmentation (median)")


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
