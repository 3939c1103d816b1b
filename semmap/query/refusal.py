"""What PostgreSQL refuses, as errors for users: one sentence for each rule of the tables."""

from __future__ import annotations

import psycopg
from psycopg import errors

from semmap.database.error import DatabaseError
from semmap.database.sure_connection import NotWrittenError, UnsettledError
from semmap.error import Error, InvalidArgumentError, UnknownNameError

_KINDS = "grasp, place, push, turn, open or put"

RULES = {
    "automaton_posture_check": "a posture is a mapping of joints to positions",
    "connector_direction_check": "the direction of a connector is both, forward or backward",
    "connector_form_check": "the form of a connector is door, elevator_door, stairs or ramp",
    "connector_height_check": "the height of a connector is above 0: give it in metres",
    "connector_state_check": "the state of a connector is open, closed or locked",
    "connector_step_check": "the step of a connector is not below 0: give it in metres",
    "connector_width_check": "the width of a connector is above 0: give it in metres",
    "entity_name_check": "a name is not empty",
    "entity_properties_check": "properties are a mapping of names to values",
    "entity_type_fkey": "there is no such type: semmap types lists them",
    "map_name_check": "a map needs a name",
    "map_name_key": "there is a map of this name already",
    "placement_pose_has_seven_finite_numbers": "a pose has finite numbers: give metres and radians",
    "placement_pose_is_within_ten_thousand_kilometres": "a pose is within ten thousand kilometres "
    "of the origin of the map: give x, y and z in metres",
    "placement_not_in_itself": "an entity is not on or in itself: name another holder",
    "room_check": "the ceiling of a room is above its floor",
    "storey_height_check": "the height of a storey is above 0: give it in metres",
    "action_kind_is_known": f"the kind of an action is {_KINDS}",
    "task_kind_is_known": f"the kind of an attempt is {_KINDS}",
    "task_outcome_is_known": "the outcome of an attempt is completed or error",
}
"""Constraints whose names do not say it, as sentences; the names of others are sentences."""


def denied() -> errors.InsufficientPrivilege:
    """Return the error for rows that a policy keeps from a role: a statement leaves them out."""
    return errors.InsufficientPrivilege("the rights of the role do not allow this")


def refusal_text(error: psycopg.Error) -> str:
    """What a statement was refused for, in a sentence."""
    name = error.diag.constraint_name
    if name in RULES:
        return RULES[name]
    if name and not name.endswith(("_check", "_key", "_fkey", "_pkey")):
        return f"refused: {name.replace('_', ' ')}"
    parts = (error.diag.message_primary, error.diag.message_hint)
    return ". ".join(filter(None, parts)) or str(error).strip()


def refused(error: psycopg.Error) -> Error | None:
    """The error for a user; None where the statement is not to blame, or its login."""
    if isinstance(error, errors.NoDataFound):
        return UnknownNameError(refusal_text(error))
    if isinstance(error, psycopg.IntegrityError | psycopg.DataError):
        return InvalidArgumentError(refusal_text(error))
    if isinstance(error, psycopg.OperationalError) and str(error) == "the connection is closed":
        return DatabaseError("the database is closed: open it again by semmap.connect()")
    if isinstance(error, NotWrittenError | UnsettledError):
        return DatabaseError(str(error))
    return None
