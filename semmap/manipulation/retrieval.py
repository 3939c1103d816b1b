"""Retrieval before generation: stored grasps, else candidates, which are then stored.

Ranked by what was learned from them, from similar shapes and from other grippers (Tosello et al.,
IV-B: the Action Generator works where the knowledge base has nothing).
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import trimesh

from semmap.belief.store.beliefs import Session
from semmap.geometry.pose import Pose
from semmap.manipulation.candidates import Grasps
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.found_actions import FoundActions
from semmap.manipulation.generation import grasps_of_mesh, is_enough, shape_grasps
from semmap.manipulation.gripper import Gripper
from semmap.manipulation.gripper_reader import kept_gripper, read_gripper
from semmap.manipulation.linked import fitting_rows, prepare_links
from semmap.manipulation.ranking import best_first, moved_alike, ranked
from semmap.manipulation.reader import STORED, actions_on, entities_meant
from semmap.manipulation.solids import PrimitiveShape
from semmap.manipulation.steadiness import steady_rows, unsteady
from semmap.manipulation.store.actions import add_actions
from semmap.manipulation.store.devices import add_gripper, gripper_id
from semmap.manipulation.store.model_shapes import (
    mesh_shape,
    model_mesh,
    shape_of,
    stored_shape,
)
from semmap.manipulation.suction import Cup
from semmap.manipulation.suitability import reasons_against
from semmap.manipulation.surroundings import Surroundings, enclosure_of, entity_pose
from semmap.query.entity_query import entity_id
from semmap.query.snapshot import Snapshot
from semmap.query.stated_mass import stated_mass

DEFAULT_GRIPPER = Path(__file__).with_name("parallel_gripper.urdf")
"""The gripper of maps whose robots have none."""

MODELS = 20
"""The most object models of one query for which candidates are generated."""


def find_grasps(
    seen: Snapshot,
    *,
    name: str | None = None,
    function: str | None = None,
    point: Sequence[float] | None = None,
    tolerance: float = 0.05,
    gripper: str | None = None,
    limit: int = 10,
    check: bool = True,
) -> FoundActions:
    """The best grasps of objects; those of models without any are generated and stored.

    They are ranked (`ranked`), and moved as those of similar shapes were. Grasps of linked models
    count as stored ones. What the ontology excludes (`reasons_against`) is left out. `check` leaves
    out those at which the gripper touches what is around, or the object before it closes. Else as
    `actions_on`.
    """
    asked = {"name": name, "function": function, "point": point, "tolerance": tolerance}
    entities = entities_meant(seen, **asked)  # type: ignore[arg-type]
    chosen = gripper_name(seen.session, gripper)
    form = _form(seen.session, chosen)
    excluded = reasons_against(seen, "grasp", form, entities)
    prepare_links(seen, entities)

    def stored() -> tuple[list[dict[str, Any]], list[str]]:
        rows = actions_on(seen, **asked, gripper=chosen, limit=STORED)  # type: ignore[arg-type]
        return fitting_rows(seen, [row for row in rows if row["entity"] not in excluded])

    rows, problems = stored()
    known = [*excluded, *{row["entity"] for row in rows if row["link"] is not None}]
    missing = seen.session.execute(MISSING, (entities, chosen, known)).fetchall()
    generated = []
    for (entity,) in sorted(missing)[:MODELS]:
        try:
            if generate(seen, entity, chosen):
                generated.append(entity)
            else:
                shape, opening = shape_of(seen, entity), _opening(seen.session, chosen)
                problems.append(misfit(entity, shape, chosen, opening, form))
        except ManipulationError as error:
            problems.append(str(error))
    if generated:
        excluded = reasons_against(seen, "grasp", form, entities)  # their shapes are known now
        rows, _ = stored()
    problems += excluded.values()
    if _move_alike(seen.session, [row for row in rows if row["link"] is None], chosen):
        rows, _ = stored()
    hand = None
    with suppress(ManipulationError):  # its URDF is not on this machine
        hand = stored_gripper(seen.session, chosen)
    known_rows = rows
    if hand is not None or form != "suction":
        rows = _steady(seen, rows, hand, problems)
    elif rows:
        problems.append(f"not judged by weight: the URDF of the suction cup {chosen} is not there")
    rows = _ranked(seen.session, rows, chosen)
    if not check:
        rows = rows[:limit]
    elif rows:
        every = rows
        try:
            hand = stored_gripper(seen.session, chosen)
            level = [row for row in every if hand.can_tilt_to(row["pose"].matrix)]
            rows = Surroundings(seen, hand).free_rows(level, limit)
        except ManipulationError as error:
            level = every
            rows = every[:limit]
            problems.append(f"not checked for collisions: {error}")
        if not rows:
            names = ", ".join(dict.fromkeys(row["entity"] for row in every))
            if level:
                why = touching(seen, names, len(level))
            else:
                why = slanting(names, len(every), chosen)
            problems.append(why)
            if hand is not None and hand.cup is not None:
                left = Counter(row["entity"] for row in every)
                fell = Counter(row["entity"] for row in known_rows) - left
                problems += [unsteady(each, fell[each], hand) for each in left if fell[each]]
    return FoundActions(rows, problems, generated)


def known_grasps(
    seen: Snapshot,
    entity: str,
    name: str,
    gripper: Gripper,
    *,
    shape: PrimitiveShape | None = None,
) -> list[dict[str, Any]]:
    """The stored grasps of an object by a gripper of a name, else its candidates; none is stored.

    Rows have what is needed to check them, as those of `actions_on`. `shape` is that of the object,
    by default that of its mesh. ManipulationError where the object has no mesh or no volume.
    """
    if reasons_against(seen, "grasp", gripper.kind, [entity_id(seen.session, entity)]):
        return []
    if seen.session.execute(HAS_GRIPPER, (name,)).fetchone():
        rows = actions_on(seen, name=entity, gripper=name, limit=STORED)
        rows = [row for row in fitting_rows(seen, rows)[0] if row["entity"] == entity]
        if rows:
            return _steady(seen, rows, gripper, [])
    mass = None if gripper.cup is None else known_masses(seen, [entity])[entity]
    stands = entity_pose(seen, entity).matrix
    known = shape or mesh_shape(seen, entity)
    rows = [
        {
            "entity": entity,
            "model_pose": Pose.from_matrix(grasp.pose),
            "pose": Pose.from_matrix(stands @ grasp.pose),
            "pre_pose": Pose.from_matrix(stands @ grasp.pre_grasp),
            "approach": grasp.approach,
            "family": grasp.family,
            "width": grasp.width,
            "expected": grasp.quality,
            "attempts": 0,
            "successes": 0,
            "shift": None,
        }
        for grasp in model_grasps(seen, entity, known, gripper)
    ]
    return steady_rows(rows, known, gripper, mass)


def model_grasps(seen: Snapshot, entity: str, shape: PrimitiveShape, gripper: Gripper) -> Grasps:
    """The grasps of an entity's mesh, or of its shape where that is enough or it has no mesh."""
    if is_enough(shape, gripper) and len(found := shape_grasps(shape, gripper)):
        return found
    try:
        mesh = model_mesh(seen, entity)
    except ManipulationError:
        return shape_grasps(shape, gripper)
    digest = hashlib.sha256(mesh.triangles.tobytes() + shape.pose.tobytes()).digest()
    return _grasps(_Model(digest, shape.kind, shape.size, gripper, mesh, shape))


@dataclass(frozen=True)
class _Model:
    """What the grasps of a mesh depend on: the first four are all that tells two apart."""

    digest: bytes
    kind: str
    size: tuple[float, ...]
    gripper: Gripper
    mesh: trimesh.Trimesh = field(compare=False)
    shape: PrimitiveShape = field(compare=False)


@lru_cache(maxsize=64)
def _grasps(of: _Model) -> Grasps:
    """The grasps of a mesh, kept: plans ask for them again and again."""
    return grasps_of_mesh(of.mesh, of.shape, of.gripper)


HAS_GRIPPER = "SELECT 1 FROM gripper g JOIN device d ON d.id = g.device_id WHERE d.name = %s"


def stored_actions(seen: Snapshot, *, kind: str, **asked: Any) -> FoundActions:
    """The best stored actions of a kind, as of `actions_on`; none is generated."""
    rows = actions_on(seen, kind=kind, **asked)
    excluded: dict[str, str] = {}
    if rows:
        meant = {entity_id(seen.session, row["entity"]) for row in rows}
        form = _form(seen.session, asked.get("gripper"))
        excluded = reasons_against(seen, kind, form, meant)
    rows, problems = fitting_rows(seen, [row for row in rows if row["entity"] not in excluded])
    problems += excluded.values()
    if not rows and not problems:
        problems = [f"no {kind} is stored for such an object"]
    return FoundActions(rows, problems)


def _ranked(session: Any, rows: Sequence[dict[str, Any]], gripper: str) -> list[dict[str, Any]]:
    """Rows by all outcomes; those of linked models count by the confidence of the link."""
    alone = [row | {"expected": row["expected"] / (row["link"] or 1)} for row in rows]
    found = ranked(session, alone, gripper)
    if all(row["link"] is None for row in rows):
        return found
    return best_first(row | {"expected": row["expected"] * (row["link"] or 1)} for row in found)


def _steady(
    seen: Snapshot, rows: Sequence[dict[str, Any]], gripper: Gripper | None, problems: list[str]
) -> list[dict[str, Any]]:
    """Rows of stored grasps by how steadily they hold the objects as they stand, too.

    Those of linked models stay as they are: their frames are of other objects. The mass counts for
    suction cups.
    """
    found = [row for row in rows if row["link"] is not None]
    own = [row for row in rows if row["link"] is None]
    masses: dict[str, float | None] = {}
    if gripper is not None and gripper.cup is not None:
        masses = known_masses(seen, [row["entity"] for row in own])
        lost = dict.fromkeys(row["entity"] for row in own if row["pose"] is None)
        problems += [f"{name}: not judged by weight: it has no pose in the map" for name in lost]
    of_rows = [(row["object_id"], masses.get(row["entity"])) for row in own]
    for number, mass in dict.fromkeys(of_rows):
        some = [row for row, of in zip(own, of_rows, strict=True) if of == (number, mass)]
        shape = stored_shape(seen.session, number)
        steady = some if shape is None else steady_rows(some, shape, gripper, mass)
        if not steady:
            names = ", ".join(dict.fromkeys(row["entity"] for row in some))
            problems.append(unsteady(names, len(some), gripper))
        found += steady
    return found


def known_masses(seen: Snapshot, entities: Sequence[str]) -> dict[str, float | None]:
    """The kilograms of entities (`stated_mass`), None where nothing states them.

    ManipulationError names the entity where they are no number above 0.
    """
    rows = seen.session.execute(
        "SELECT name, properties FROM entity WHERE map_id = current_map() AND name = ANY (%s)",
        (list(dict.fromkeys(entities)),),
    ).fetchall()
    found = {}
    for name, properties in rows:
        try:
            found[name] = stated_mass(properties)
        except ValueError as error:
            raise ManipulationError(f"{name}: {error}") from error
    return found


MISSING = """
SELECT DISTINCT ON (coalesce(object_of(e.id)::text, m.digest)) e.name FROM entity e
LEFT JOIN entity_model em ON em.entity_id = e.id
LEFT JOIN model m ON m.id = em.model_id AND m.triangles > 0
WHERE e.id = ANY (%s) AND NOT EXISTS (
    SELECT FROM action a WHERE a.object_id = object_of(e.id) AND a.gripper_id = gripper_named(%s)
       AND a.kind = 'grasp' AND a.replaced_by IS NULL)
  AND e.name <> ALL (%s::text[])
ORDER BY coalesce(object_of(e.id)::text, m.digest), e.name
"""
"""One entity of each model that has no stored grasp; without those for which links give some."""


def _opening(session: Session, gripper: str) -> float:
    """How wide a stored gripper opens, metres."""
    ((opening,),) = session.execute(
        "SELECT opening FROM gripper WHERE device_id = %s", (gripper_id(session, gripper),)
    )
    return float(opening)


def _form(session: Session, gripper: str | None) -> str:
    """The form of a stored gripper, by default the preferred one, such as parallel."""
    ((form,),) = session.execute(
        "SELECT form FROM gripper WHERE device_id = %s", (gripper_id(session, gripper),)
    )
    return str(form)


def misfit(
    entity: str, shape: PrimitiveShape, gripper: str, opening: float, form: str = "parallel"
) -> str:
    """Why no grasp of an entity's shape fits a gripper of a form, whose opening is in metres."""
    sizes = " x ".join(f"{size:.3g}" for size in shape.size)
    if form == "suction":
        return (
            f"{entity}: the suction cup {gripper} of {opening:.3g} m is tight nowhere on its "
            f"surface (about a {shape.kind} of {sizes} m), or too weak where it is"
        )
    return (
        f"{entity}: no grasp fits its shape ({shape.kind} {sizes} m); "
        f"gripper {gripper} opens {opening:.3g} m"
    )


def touching(seen: Snapshot, entity: str, grasps: int) -> str:
    """Why none of an entity's grasps is free."""
    around = enclosure_of(seen, entity)
    if around is not None and around.shut:
        return f"{entity}: is inside of {around.name}, which is shut; open it first"
    if around is not None:
        return (
            f"{entity}: is inside of {around.name}; from no side of it, the gripper gets straight "
            f"to one of {grasps} grasps without touching something"
        )
    return (
        f"{entity}: at all {grasps} grasps, the gripper touches what is around, "
        "or the object before it closes"
    )


def slanting(entity: str, grasps: int, gripper: str) -> str:
    """Why none of an entity's grasps is taken by a gripper that its arm cannot tilt."""
    return (
        f"{entity}: its {grasps} grasps need gripper {gripper} at another slant than that at which "
        "its arm keeps it"
    )


def generate(seen: Snapshot, entity: str, gripper: str | None = None) -> list[int]:
    """Store all candidates for the model of an entity; return their ids."""
    chosen = gripper_name(seen.session, gripper)
    with seen.session.transaction():
        shape = shape_of(seen, entity)
        grasps = list(model_grasps(seen, entity, shape, stored_gripper(seen.session, chosen)))
        return add_actions(seen.session, entity, chosen, grasps) if grasps else []


MAY_STORE = "SELECT has_column_privilege('action', 'pose', 'INSERT')"


def _move_alike(session: Any, rows: Sequence[dict[str, Any]], gripper: str) -> int:
    """Store grasps that are moved as those of similar shapes were; return how many there are."""
    if not rows or not session.execute(MAY_STORE).fetchone()[0]:
        return 0
    opening, count = _opening(session, gripper), 0
    for number in dict.fromkeys(row["object_id"] for row in rows):
        of_model = {row["action_id"]: row for row in rows if row["object_id"] == number}
        grasps = moved_alike(session, list(of_model.values()), gripper, opening)
        count += len(add_actions(session, number, gripper, grasps) if grasps else ())
    return count


def register_gripper(
    session: Session,
    path: Path,
    name: str | None = None,
    *,
    palm: str | None = None,
    preferred: bool | None = None,
    cup: Cup | None = None,
) -> str:
    """Store the gripper of a URDF; return its name. ManipulationError where it has none.

    With `cup`, a suction cup on the link `palm`.
    """
    gripper = read_gripper(path, palm, cup)
    chosen = name or gripper.name
    limits = {j.name: j.limits for j in gripper.robot.joints if j.name in gripper.joints}
    add_gripper(
        session,
        chosen,
        form=gripper.kind,
        opening=gripper.opening,
        depth=gripper.depth,
        swept=gripper.swept_volume or None,
        force=None if gripper.cup is None else gripper.cup.force,
        urdf=path.read_text("utf-8"),
        source=f"{path.resolve()}#{gripper.palm}",
        joints=limits,
        preferred=preferred,
    )
    return chosen


def is_urdf(given: str | Path) -> bool:
    """Whether the name of a device is the path of a URDF."""
    return Path(given).suffix in (".urdf", ".xml")


def gripper_or_urdf(session: Session, given: str | Path | None) -> str | None:
    """The name of a gripper; that of a URDF is stored first (`register_gripper`)."""
    if given is None or not is_urdf(given):
        return given if given is None else str(given)
    return register_gripper(session, Path(given))


def stored_gripper(session: Session, name: str) -> Gripper:
    """A stored gripper, from its URDF; ManipulationError where that is not on this machine."""
    ((source, form, opening, force),) = session.execute(
        "SELECT d.source, g.form, g.opening, g.force FROM device d "
        "JOIN gripper g ON g.device_id = d.id WHERE d.id = %s",
        (gripper_id(session, name),),
    )
    path, _, palm = (source or "").rpartition("#")
    if name == DEFAULT_GRIPPER.stem and not Path(path).is_file():
        path = str(DEFAULT_GRIPPER)  # semmap was installed elsewhere since
    if not path or not Path(path).is_file():
        where = f"its URDF {path} is not there" if path else "its URDF is not stored"
        raise ManipulationError(
            f"gripper {name}: {where}, so no grasps can be generated: "
            f"semmap manipulation add-gripper URDF --name {name}"
        )
    return kept_gripper(path, palm, Cup.of(opening / 2, force) if form == "suction" else None)


ANY_GRIPPER = "SELECT 1 FROM gripper LIMIT 1"


def usual_gripper(session: Session) -> tuple[str, Gripper, bool]:
    """The gripper of robots that state none, its name, and whether nothing states it.

    As `usual_name`; nothing is stored. Raises ManipulationError without its URDF.
    """
    name = usual_name(session)
    if name is None:
        return DEFAULT_GRIPPER.stem, kept_gripper(DEFAULT_GRIPPER), True
    return name, stored_gripper(session, name), is_default(session, name)


def usual_name(session: Session) -> str | None:
    """The gripper of robots that state none: the preferred one, else the only one of no robot.

    None for the default one, where it is not stored. Raises LookupError: several are of no robot,
    and none is preferred.
    """
    rows = session.execute(
        "SELECT d.name, g.preferred FROM gripper g JOIN device d ON d.id = g.device_id "
        "WHERE g.preferred OR NOT EXISTS (SELECT FROM automaton a WHERE a.gripper_id = d.id) "
        "ORDER BY g.preferred DESC"
    ).fetchall()
    if len(rows) > 1 and not rows[0][1]:
        return gripper_name(session, None)  # raises
    return str(rows[0][0]) if rows else None


def is_default(session: Session, name: str) -> bool:
    """Whether a stored gripper is the default one, and not preferred over others."""
    if name != DEFAULT_GRIPPER.stem:
        return False
    number = gripper_id(session, name)
    return session.execute(
        "SELECT preferred FROM gripper WHERE device_id = %s", (number,)
    ).fetchone() == (False,)


def stored_usual(session: Any) -> str:
    """As `usual_name`; the default gripper is stored first."""
    with session.transaction():  # another robot may store it at the same time
        session.execute("SELECT pg_advisory_xact_lock(hashtext('semmap default gripper'))")
        return usual_name(session) or register_gripper(session, DEFAULT_GRIPPER, preferred=False)


def gripper_name(session: Any, name: str | None) -> str:
    """The name of the gripper meant; where there is none at all, the default is stored."""
    if name is None and not session.execute(ANY_GRIPPER).fetchone():
        return stored_usual(session)
    ((found,),) = session.execute(
        "SELECT name FROM device WHERE id = %s", (gripper_id(session, name),)
    )
    return str(found)
