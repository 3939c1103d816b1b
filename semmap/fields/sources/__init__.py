"""Sources: they make maps from percepts, each at its own rate (reMap, sections 3.1.1 and 5.1)."""

from typing import TYPE_CHECKING

from semmap.lazy_names import load_on_use

if TYPE_CHECKING:
    from semmap.fields.sources.manager import SourceManager as SourceManager
    from semmap.fields.sources.manager import SourceStatus as SourceStatus
    from semmap.fields.sources.people import GazeSource as GazeSource
    from semmap.fields.sources.people import PersonalSpaceSource as PersonalSpaceSource
    from semmap.fields.sources.people import StandingPeopleSource as StandingPeopleSource
    from semmap.fields.sources.percepts import Gaze as Gaze
    from semmap.fields.sources.percepts import People as People
    from semmap.fields.sources.percepts import PersonMotion as PersonMotion
    from semmap.fields.sources.percepts import RobotState as RobotState
    from semmap.fields.sources.percepts import Segmentation as Segmentation
    from semmap.fields.sources.percepts import Zone as Zone
    from semmap.fields.sources.percepts import Zones as Zones
    from semmap.fields.sources.robot_body import RobotBodySource as RobotBodySource
    from semmap.fields.sources.segmentation import ObjectSource as ObjectSource
    from semmap.fields.sources.segmentation import PeopleSource as PeopleSource
    from semmap.fields.sources.source import Source as Source
    from semmap.fields.sources.source import installed_sources as installed_sources
    from semmap.fields.sources.source import make_source as make_source
    from semmap.fields.sources.zones import ZoneSource as ZoneSource

__getattr__, __all__ = load_on_use(__name__)
