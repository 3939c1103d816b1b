"""Sources: they make maps from percepts, each at its own rate (reMap, sections 3.1.1 and 5.1)."""

from semmap.fields.sources.gaze import GazeSource
from semmap.fields.sources.manager import SourceManager, SourceStatus
from semmap.fields.sources.percepts import (
    Gaze,
    Motion,
    People,
    RobotState,
    Segmentation,
    Zone,
    Zones,
)
from semmap.fields.sources.personal_space import PersonalSpaceSource
from semmap.fields.sources.robot_body import RobotBodySource
from semmap.fields.sources.segmentation import ObjectSource, PeopleSource
from semmap.fields.sources.source import Source, installed_sources, make_source
from semmap.fields.sources.zones import ZoneSource

__all__ = [
    "Gaze",
    "GazeSource",
    "Motion",
    "ObjectSource",
    "People",
    "PeopleSource",
    "PersonalSpaceSource",
    "RobotBodySource",
    "RobotState",
    "Segmentation",
    "Source",
    "SourceManager",
    "SourceStatus",
    "Zone",
    "ZoneSource",
    "Zones",
    "installed_sources",
    "make_source",
]
