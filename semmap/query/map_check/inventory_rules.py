"""Rules on data of objects: world poses, rooms, holders, geometry and places."""

from __future__ import annotations

import numpy as np

from semmap.query.geometry_notes import listed
from semmap.query.map_check.building import (
    CONTACT,
    STEP,
)
from semmap.query.map_check.fixes import Found
from semmap.query.map_check.support import SupportedBuilding

MOSTLY = 0.6
"""Part of a footprint in a room from which it is there, wherever the limits lie exactly."""


def stale_poses(building: SupportedBuilding) -> Found:
    """World poses that are not those of the holders times the placements."""
    for entity in building.entities:
        world = entity.row["world"]
        if entity.pose is None:
            continue
        shown = np.array(world if world is not None else [np.inf] * 7, float)
        here = np.array(entity.pose)
        turn = min(np.abs(shown[3:] - here[3:]).max(), np.abs(shown[3:] + here[3:]).max())
        size = 1 + np.abs(here[:3]).max()
        if max(np.abs(shown[:3] - here[:3]).max(), turn) > 1e-6 * size:
            text = f"the world pose of {entity.name} is not its holder's pose times its placement"
            ids = f"ARRAY[{entity.row['id']}]"
            fix = f"SELECT refresh_world({ids}), record_change('reshaped', {ids})"
            yield (entity.name,), text, fix


def wrong_rooms(building: SupportedBuilding) -> Found:
    """Objects whose room in the inventory is not that of their place."""
    for entity in [*building.objects, *building.agents]:
        if building.is_part(entity) or (entity.outline is None and entity.low is entity.high):
            continue
        if entity.holder is not None and entity.holder.kind in ("object", "agent"):
            continue  # its room is that of its place, not that of what it stands on
        shares = building.shares(entity)
        said = next((e for e in entity.chain if e.kind == "room"), None)
        says = None if said is None else said.name
        best = max(shares, key=lambda n: shares[n], default=None)
        lost = said is not None and (
            says in {r.name for r in building.rooms}
            and not shares.get(says)
            and entity.ground.distance(building.by_id[said.row["id"]].ground) > STEP
        )
        elsewhere = (
            best not in (None, says)
            and shares[best] >= MOSTLY
            and (says is None or shares.get(says, 0.0) < 1 - MOSTLY)
        )
        if elsewhere and sum(share >= MOSTLY for share in shares.values()) > 1:
            continue  # rooms overlap: another rule says so
        if not lost and not elsewhere:
            continue
        place = "in no room" if best is None else f"in {best} ({shares[best]:.0%} of its ground)"
        held = "no room" if says is None else says
        text = f"the inventory has {entity.name} in {held}, but it is {place}"
        fix = f"SELECT derive_again(ARRAY[{entity.row['id']}])"
        yield (entity.name, *([] if says is None else [says])), text, fix


def wrong_holders(building: SupportedBuilding) -> Found:
    """Objects that are apart from their holders."""
    for entity in building.solids:
        holder = entity.holder
        if holder is None or holder.kind != "object" or not len(holder.triangles):
            continue
        gaps = np.maximum(holder.low - entity.high, entity.low - holder.high)
        apart = float(gaps.max())
        if apart > 2 * CONTACT:
            text = (
                f"the inventory has {entity.name} {entity.row['relation']} {holder.name}, "
                f"but they are {apart:.2f} m apart"
            )
            fix = f"SELECT derive_again(ARRAY[{entity.row['id']}])"
            yield (entity.name, holder.name), text, fix


def shapeless_objects(building: SupportedBuilding) -> Found:
    """Objects without geometry."""
    names = tuple(e.name for e in building.objects if e.outline is None)
    if names:
        count = f"{len(names)} object{'s have' if len(names) > 1 else ' has'}"
        text = f"{count} no geometry, so grids take them as free: {listed(names)}"
        if near := [e.name for e in building.not_judged]:
            text += f"; it is not known whether these stand on them or float: {listed(near)}"
        fix = "by hand: import again with the model_path of their models, or assume_sizes=True"
        yield names, text, fix


def objects_without_place(building: SupportedBuilding) -> Found:
    """Objects with geometry, but without a pose."""
    names = tuple(
        e.name
        for e in building.entities
        if e.kind == "object" and e.pose is None and e.row["models"]
    )
    if names:
        count = f"{len(names)} object{'s have' if len(names) > 1 else ' has'}"
        text = f"{count} geometry, but no place, so no grid or plan has them: {listed(names)}"
        fix = "by hand: give each a place with move_to or put_on, or delete it"
        yield names, text, fix
