"""Whether the gripper of a robot can take an object of the map: plans ask before missions try."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from typing import TYPE_CHECKING, Any

from semmap.query.snapshot import Snapshot

if TYPE_CHECKING:
    from semmap.manipulation.gripper import Gripper


def grasp_check(
    seen: Snapshot, *, gripper: str | None = None, robots: tuple[str | None, ...] = ()
) -> Callable[[str], str | None]:
    """A function that says why no grasp of an object fits; None if one does.

    It knows the gripper that is named, else that of the first of the stored robots, or of the URDFs
    of the classes, that has one. Without any, and of an object without a mesh, nothing is known.
    """

    @cache
    def hand() -> tuple[str, Gripper] | None:  # reads a URDF: only where something is picked up
        return _hand(seen.session, gripper, [name for name in robots if name is not None])

    def misfit(item: str) -> str | None:
        found = hand()
        return None if found is None else _misfit(seen, item, *found)

    return misfit


def assumed_misfits(
    seen: Snapshot, items: Iterable[str], *, robots: tuple[str | None, ...] = ()
) -> list[str]:
    """Why missions may fail to pick up items for which `grasp_check` knows no gripper.

    A mission then has the preferred stored gripper, else the default one. Empty where a gripper is
    known: a plan refuses what does not fit in it.
    """
    from semmap.manipulation.error import ManipulationError
    from semmap.manipulation.gripper import read_gripper
    from semmap.manipulation.retrieval import (
        ANY_GRIPPER,
        DEFAULT_GRIPPER,
        gripper_name,
        stored_gripper,
    )

    items, session = list(items), seen.session
    if not items or _hand(session, None, [name for name in robots if name is not None]):
        return []
    try:
        if session.execute(ANY_GRIPPER).fetchone():
            name = gripper_name(session, None)
            gripper = stored_gripper(session, name)
        else:
            name, gripper = DEFAULT_GRIPPER.stem, read_gripper(DEFAULT_GRIPPER)
    except (LookupError, ManipulationError):  # several, or its URDF is not on this machine
        return []
    found = (_misfit(seen, item, name, gripper) for item in items)
    return [
        f"{why}. A robot that states no gripper has it in missions, and fails if it tries grasps"
        for why in found
        if why is not None
    ]


def _hand(session: Any, gripper: str | None, robots: list[str]) -> tuple[str, Gripper] | None:
    from semmap.manipulation.automata import automaton_of, class_gripper
    from semmap.manipulation.error import ManipulationError
    from semmap.manipulation.retrieval import stored_gripper

    found = automaton_of(session, *robots)
    named = gripper or (found and found[1])
    try:
        if named:
            return named, stored_gripper(session, named)
    except ManipulationError:
        return None  # its URDF is not on this machine
    for name in robots:
        own = class_gripper(session, name)
        if own is not None:
            return own.name, own
    return None


def _misfit(seen: Snapshot, item: str, name: str, gripper: Gripper) -> str | None:
    from semmap.manipulation.candidates import grasp_candidates
    from semmap.manipulation.error import ManipulationError
    from semmap.manipulation.store.model_shapes import model_mesh
    from semmap.perception.mesh_shapes import mesh_primitive
    from semmap.perception.point_cloud import PerceptionError

    known = seen.session.execute(_KNOWN, {"item": item, "gripper": name}).fetchone()
    if known is not None and known[0]:
        return None
    try:
        shape = mesh_primitive(model_mesh(seen, item))
    except (ManipulationError, PerceptionError):
        return None
    if len(grasp_candidates(shape, gripper)):
        return None
    sizes = " x ".join(f"{size:.3g}" for size in shape.size)
    return (
        f"{item}: no grasp fits its shape ({shape.kind} {sizes} m); "
        f"gripper {name} opens {gripper.opening:.3g} m"
    )


_KNOWN = """
SELECT EXISTS (SELECT FROM gripper g JOIN device d ON d.id = g.device_id AND d.name = %(gripper)s,
               LATERAL actions_on(ARRAY[entity_id(%(item)s)], d.name, 'grasp', 1))
"""
