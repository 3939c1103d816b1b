"""Sources: what makes maps of percepts, and what keeps them at work."""

from semmap.fields.sources.gaze import GazeSource
from semmap.fields.sources.manager import Manager, Status
from semmap.fields.sources.percepts import (
    Gaze,
    Moving,
    People,
    RobotState,
    Segmentation,
    Zone,
    Zones,
)
from semmap.fields.sources.personal_space import PersonalSpaceSource
from semmap.fields.sources.robot_body import RobotBodySource
from semmap.fields.sources.segmentation import ObjectSource, PeopleSource
from semmap.fields.sources.source import Source, discovered, make_source
from semmap.fields.sources.zones import ZoneSource

__all__ = [
    "Gaze",
    "GazeSource",
    "Manager",
    "Moving",
    "ObjectSource",
    "People",
    "PeopleSource",
    "PersonalSpaceSource",
    "RobotBodySource",
    "RobotState",
    "Segmentation",
    "Source",
    "Status",
    "Zone",
    "ZoneSource",
    "Zones",
    "discovered",
    "make_source",
]
