"""Answers about fields without a service: from the map, and what sources and users kept."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from semmap.whole_file import write_whole

if TYPE_CHECKING:
    from datetime import datetime

    from semmap.api.map_questions import MapQuestions
    from semmap.fields.queries.catalogue import FieldCatalogue
    from semmap.fields.store.mirror_state import MirrorState
    from semmap.fields.store.voxel_mirror import VoxelMirror
    from semmap.query.map_handle import MapSource

    Mirror = MirrorState | VoxelMirror

Note = Callable[[str], Any]
"""Gets what a user should know."""


def current_mirror(map: MapQuestions, voxel_size: float, note: Note) -> Mirror:
    """Return the voxels of the present state of a map.

    They are those of the kept state where the map did not change since. Else they are computed, and
    kept for the next call.
    """
    from semmap.fields.store.mirror_state import is_current, load_state

    with map.snapshot() as seen:
        state = load_state(seen, voxel_size)
        if state is not None and is_current(seen, state):
            return state
    return resumed_mirror(map, voxel_size, note)


def resumed_mirror(map: MapSource, voxel_size: float, note: Note) -> VoxelMirror:
    """Return a mirror that has read the map, and keep its state."""
    from semmap.fields.store.voxel_mirror import VoxelMirror

    mirror = VoxelMirror.resume(map.engine, map.name, voxel_size)
    if mirror.catch_up():
        mirror.try_to_save()  # a user who may only read computes them each time
    for name, reason in mirror.left_out.items():
        note(f"left out: {name}: {reason}")
    return mirror


def kept_space(map: MapQuestions, voxel_size: float, note: Note) -> Mirror:
    """Return the present state of a map, with what sources saw last."""
    from semmap.fields.store.field_store import has_maps

    mirror = current_mirror(map, voxel_size, note)
    with map.snapshot() as seen:
        if has_maps(seen):
            from semmap.fields.service.kept_answer import PlainVocabulary, show_kept

            newest = show_kept(mirror, seen, PlainVocabulary())
            if newest is not None:
                note(f"no service is running: sources as kept at {newest:%Y-%m-%d %H:%M:%S %Z}")
    return mirror


def query_kept(
    map: MapQuestions, voxel_size: float, note: Note, text: str, **given: Any
) -> dict[str, Any]:
    """Answer a query; `given` and the reply are those of `query_reply`."""
    from semmap.fields.service.replies import query_reply

    catalogue, _, newest = _catalogue(map, voxel_size, note, open_snapshot=map.snapshot)
    sources = f", sources as kept at {newest:%Y-%m-%d %H:%M:%S %Z}" if newest else ""
    note(f"no service is running: answered from the kept state of the map{sources}")

    @contextmanager
    def transaction() -> Iterator[Any]:
        with map.transaction():
            yield map.connection

    return query_reply(catalogue, text, transaction, **given)


def update_kept(map: MapQuestions, voxel_size: float, note: Note, text: str) -> dict[str, Any]:
    """Carry out an update; the reply is that of `update_map`."""
    from semmap.fields.service.replies import update_map

    catalogue, mirror, _ = _catalogue(map, voxel_size, note)
    return update_map(mirror, catalogue, text, map.connection)


def _catalogue(
    map: MapQuestions, voxel_size: float, note: Note, **past: Any
) -> tuple[FieldCatalogue, Mirror, datetime | None]:
    """The fields of a map and of its sources, its voxels, and when a source saw last."""
    from semmap.fields.queries.mirror_catalogue import mirror_catalogue
    from semmap.fields.service.kept_answer import show_kept
    from semmap.fields.store.names import read_map_vocabulary, read_names

    vocabulary = read_map_vocabulary()
    mirror = current_mirror(map, voxel_size, note)
    with map.snapshot() as seen:
        newest, names = show_kept(mirror, seen, vocabulary), read_names(seen)
    found = mirror_catalogue(mirror, names, vocabulary, **past)
    return found, mirror, newest


def export_entities(mirror: Mirror, folder: Path) -> dict[str, Any]:
    """Write the voxels of all entities: OpenVDB, the sets of entities, and points."""
    import numpy as np

    from semmap.fields.maps.export import write_points

    regions = mirror.regions
    bodies = [n for n in mirror.names if n not in mirror.spaces]
    parts = [np.zeros((0, 3), np.int32), *(regions.voxels(n) for n in bodies)]
    voxels = np.unique(np.concatenate(parts), axis=0)
    centres = (voxels + 0.5) * regions.voxel_size
    numbers = regions.set_numbers_at(centres)
    sets = {
        number: sorted(mirror.names[n] for n in members)
        for number, members in regions.sets(numbers).items()
    }
    folder.mkdir(parents=True, exist_ok=True)
    regions.write(folder / "sets.vdb")
    write_whole(folder / "sets.json", json.dumps(sets, indent=1) + "\n")
    write_points(folder / "points.ply", centres, numbers, name="set")
    return {
        "folder": str(folder),
        "voxel_size": regions.voxel_size,
        "voxels": len(voxels),
        "entities": len(mirror.names),
        "sets": len(sets),
        "bytes_per_voxel": round(regions.memory().bytes_per_voxel, 2),
    }


def export_field(map: MapQuestions, name: str, version: int | None, folder: Path) -> dict[str, Any]:
    """Write a stored field as OpenVDB, its legend, and its voxels as points."""
    from semmap.fields.maps.export import write_grid
    from semmap.fields.store import field_store

    with map.snapshot() as seen:
        field = field_store.load(seen, name, version)
    folder.mkdir(parents=True, exist_ok=True)
    write_grid(folder / "field.vdb", field.grid, name)
    write_grid(folder / "points.ply", field.grid, name)
    if field.legend is not None:
        write_whole(folder / "legend.json", json.dumps(field.legend, indent=1) + "\n")
    return {
        "folder": str(folder),
        "name": name,
        "version": field.version,
        "voxel_size": field.grid.voxel_size,
        "voxels": len(field.grid),
    }
