"""Sources: they make maps from percepts, each at its own rate (reMap, sections 3.1.1 and 5.1)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from semmap.lazy_names import load_on_use

if TYPE_CHECKING:
    from semmap.fields.sources.manager import SourceManager, SourceStatus
    from semmap.fields.sources.people import GazeSource, PersonalSpaceSource, StandingPeopleSource
    from semmap.fields.sources.percepts import (
        Gaze,
        People,
        PersonMotion,
        RobotState,
        Segmentation,
        Zone,
        Zones,
    )
    from semmap.fields.sources.robot_body import RobotBodySource
    from semmap.fields.sources.segmentation import ObjectSource, PeopleSource
    from semmap.fields.sources.source import Source, installed_sources, make_source
    from semmap.fields.sources.zones import ZoneSource

__all__ = [
    "Gaze",
    "GazeSource",
    "ObjectSource",
    "People",
    "PeopleSource",
    "PersonMotion",
    "PersonalSpaceSource",
    "RobotBodySource",
    "RobotState",
    "Segmentation",
    "Source",
    "SourceManager",
    "SourceStatus",
    "StandingPeopleSource",
    "Zone",
    "ZoneSource",
    "Zones",
    "installed_sources",
    "make_source",
]

_HOMES = {
    "Gaze": "semmap.fields.sources.percepts",
    "GazeSource": "semmap.fields.sources.people",
    "PersonMotion": "semmap.fields.sources.percepts",
    "ObjectSource": "semmap.fields.sources.segmentation",
    "People": "semmap.fields.sources.percepts",
    "PeopleSource": "semmap.fields.sources.segmentation",
    "PersonalSpaceSource": "semmap.fields.sources.people",
    "RobotBodySource": "semmap.fields.sources.robot_body",
    "RobotState": "semmap.fields.sources.percepts",
    "Segmentation": "semmap.fields.sources.percepts",
    "Source": "semmap.fields.sources.source",
    "SourceManager": "semmap.fields.sources.manager",
    "SourceStatus": "semmap.fields.sources.manager",
    "StandingPeopleSource": "semmap.fields.sources.people",
    "Zone": "semmap.fields.sources.percepts",
    "ZoneSource": "semmap.fields.sources.zones",
    "Zones": "semmap.fields.sources.percepts",
    "installed_sources": "semmap.fields.sources.source",
    "make_source": "semmap.fields.sources.source",
}

__getattr__ = load_on_use(__name__, _HOMES)
