"""One map of an environment: imports, and entities that are added; `MapQuestions` reads it."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from semmap.api.checked import EntityName, Finite, Positive, Properties, checked_class
from semmap.api.entity_collection import MapCollections
from semmap.api.map_drawing import MapDrawing
from semmap.api.map_entity import MapEntity
from semmap.api.map_events import MapEvents
from semmap.api.map_export import MapExport
from semmap.api.map_knowledge import MapKnowledge
from semmap.api.map_manipulation import MapManipulation
from semmap.api.map_questions import aware
from semmap.api.map_regions import MapRegions
from semmap.api.map_sentences import MapSentences
from semmap.api.spatial_fields import SpatialFields
from semmap.error import InvalidArgumentError
from semmap.snake_case import snake_case

if TYPE_CHECKING:
    import shapely
    import trimesh

    from navgrid.found_rooms import FoundRooms
    from semmap.api.map_entity import Door
    from semmap.belief.identify import Detection
    from semmap.geometry.mesh import Mesh
    from semmap.ingest.importer import ImportSummary

PlanarPose = Sequence[float]
"""(x, y, z, yaw): metres and radians in the map's frame; yaw may be left out."""


@checked_class
class Map(
    MapDrawing,
    MapCollections,
    MapEvents,
    MapExport,
    MapSentences,
    MapManipulation,
    MapRegions,
    MapKnowledge,
):
    """A map of one environment, by the names of its entities; of a `database`, with a `name`."""

    @cached_property
    def fields(self) -> SpatialFields:
        """The fields of the map: the content of space, with voxels of 5 cm."""
        return SpatialFields(self.database.address, self.name, lambda: self)

    def import_file(self, path: str | Path, **options: Any) -> ImportSummary:
        """Read a world file into the map; options and errors as of `Database.import_file`."""
        return self.database.import_file(path, map=self.name, **options)

    def add_storey(
        self, name: str, *, elevation: Finite = 0.0, height: Positive | None = None
    ) -> MapEntity:
        """Add a storey: its floor's height above the map's origin and its clear height, metres.

        It holds the rooms and regions on its floor that nothing holds yet.
        """
        from semmap.api.additions import add_entry, hold_rooms
        from semmap.geometry.pose import Pose
        from semmap.ingest.world import Entry, StoreyDetail

        detail = StoreyDetail(elevation, height)
        with self.transaction():
            made = add_entry(self, Entry(name, "storey", pose=Pose(z=elevation), detail=detail))
            hold_rooms(self, made, elevation)
        return made

    def add_room(
        self,
        name: str,
        polygon: shapely.Polygon | Sequence[Sequence[float]],
        *,
        floor: float = 0.0,
        ceiling: float | None = None,
        storey: EntityName | None = None,
        type: str | None = None,
        label: str | None = None,
        define: bool = False,
    ) -> MapEntity:
        """Add a room.

        Parameters
        ----------
        polygon : the outline, (N, 2) metres in the map's frame
        floor, ceiling : heights in the map's frame, metres
        storey : by default the one on whose floor it is, if there is one
        define : add a type that the map does not have; otherwise it is refused

        Raises
        ------
        ValueError
            The name is taken, the outline is none, the ceiling is not above the floor, or the floor
            is below or above the storey.
        """
        from semmap.api.additions import add_entry, drawn

        made = drawn(name, "room", polygon, floor, ceiling, type, label)
        return add_entry(self, made, storey=storey, define=define)

    def add_region(
        self,
        name: str,
        polygon: shapely.Polygon | Sequence[Sequence[float]],
        *,
        floor: float = 0.0,
        ceiling: float | None = None,
        type: str | None = None,
        label: str | None = None,
        storey: EntityName | None = None,
        define: bool = False,
    ) -> MapEntity:
        """Add a region (a zone): an outline with a meaning; as `add_room`."""
        from semmap.api.additions import add_entry, drawn

        made = drawn(name, "region", polygon, floor, ceiling, type, label)
        return add_entry(self, made, storey=storey, define=define)

    def add_object(
        self,
        name: str,
        *,
        type: str | None = None,
        mesh: str | Path | trimesh.Trimesh | Mesh | None = None,
        size: Sequence[float] | None = None,
        pose: PlanarPose | None = None,
        on: EntityName | None = None,
        in_: EntityName | None = None,
        label: str | None = None,
        properties: Properties | None = None,
        define: bool = False,
    ) -> MapEntity:
        """Add an object.

        Parameters
        ----------
        mesh : the geometry in the object's own frame, metres: a file, a trimesh or a `Mesh`
        size : instead of a mesh, a box of (x, y, z) metres that stands on its frame's origin
        pose : (x, y, z, yaw) in the map's frame; by default the free
            place that is nearest to the middle of `on` or `in_`
        on, in_ : names of its holder; without them, the geometry says it
        define : add a type that the map does not have; otherwise it is refused

        Raises
        ------
        ValueError
            The name is taken, a part contradicts another, the pose is not on or in the holder, or
            nothing on or in it is free.
        LookupError
            There is no such holder, or no such type: the message names similar ones.
        """
        from semmap.api.additions import add_entry, thing

        made = thing(name, "object", type, mesh, size, pose, label, properties)
        return add_entry(self, made, on=on, in_=in_, define=define)

    def observe_objects(
        self,
        detections: Sequence[Detection],
        *,
        frame: EntityName | None = None,
        at: datetime | None = None,
        hit: float = 0.9,
        false_alarm: float = 0.001,
        new: float = 0.05,
    ) -> list[dict[str, Any]]:
        """Store the detections of one view: sightings of known objects or agents, or new ones.

        Each is associated by its type, size, place, position there and time; no two with the same
        object. One that is surely a known object is seen, and moves there; one that is surely new
        is added; in doubt, nothing moves or is added, and the belief about each object that it
        rather is than a new one says how probable that is.

        Returns for each detection its `type`, the most probable `object` (None: none), its
        `probability`, whether it was added as `new`, its `place`, and all that it `may_be`.

        Parameters
        ----------
        detections : `semmap.belief.identify.Detection` (type, point, sides), metres
        frame : the agent in whose frame the points are; by default that of the map
        at : the time of the detections; local without a time zone, by default now
        hit : P(the detector finds an object | it is there)
        false_alarm : expected number of objects of a type at a place that it finds in vain
        new : expected number of objects of a type at a place that the map lacks

        Raises
        ------
        LookupError, ValueError
            As `identify`; nothing is stored.
        """
        from semmap.api.additions import check_object_type
        from semmap.belief.identify import Detection, observe_detections

        for seen in detections:
            if not isinstance(seen, Detection):
                raise InvalidArgumentError(
                    f"{seen!r} is no detection: give semmap.belief.identify.Detection(type, point)"
                )
            kinds = ("room", "storey", "elevator", "connector")
            check_object_type(self, "what was detected", seen.type, kinds)

        agents = {row[0] for row in self._rows("SELECT unnest(subtypes('agent'))")}

        def add(name: str, detected: Detection, point: tuple[float, float, float]) -> None:
            if snake_case(detected.type) in agents:  # the sighting places it on the floor
                self.add_agent(name, type=detected.type, size=detected.sides)
                return
            x, y, z = point
            low = z - (detected.sides[2] / 2 if detected.sides else 0.0)
            self.add_object(name, type=detected.type, size=detected.sides, pose=(x, y, low, 0.0))

        with self._change() as now:
            rates = {"hit": hit, "false_alarm": false_alarm, "new": new}
            return observe_detections(now, detections, add, frame=frame, at=aware(at), **rates)

    def add_agent(
        self,
        name: str,
        *,
        type: str | None = None,
        size: Sequence[float] | None = None,
        mesh: str | Path | trimesh.Trimesh | Mesh | None = None,
        pose: PlanarPose | None = None,
        in_: EntityName | None = None,
        define: bool = False,
    ) -> MapEntity:
        """Add a robot or a person; as `add_object`."""
        from semmap.api.additions import add_entry, thing

        made = thing(name, "agent", type, mesh, size, pose, None, None)
        return add_entry(self, made, in_=in_, define=define)

    def add_door(
        self,
        name: str,
        place_a: EntityName,
        place_b: EntityName | None,
        line: Sequence[Sequence[float]],
        *,
        width: Positive | None = None,
        state: Literal["open", "closed", "locked"] = "open",
        form: Literal["door", "elevator_door", "stairs", "ramp"] = "door",
        direction: Literal["both", "forward", "backward"] = "both",
        height: Finite | None = None,
        clearance: Finite = 0.6,
    ) -> Door:
        """Add a connector of two places.

        Parameters
        ----------
        place_a, place_b : names of rooms; `place_b` None: it leads outside
        line : ((x, y), (x, y)): the opening from post to post, metres in the map's frame
        width : of the clear opening; by default the line's length
        height : of the floor in the map's frame, metres; by default that of the lower room
        clearance : how far from the line a robot stands before and behind it, metres; of stairs
            and ramps about half of their length: it stands on the floors of the two rooms

        Raises
        ------
        LookupError, ValueError
            There is no such room; the name is taken; the line is not at a wall of the rooms from
            post to post, narrower than 0.2 m, or shorter than the width; a room is on both
            sides of a way outside; the floor of a room is over half a metre above or below.
        """
        from semmap.api.additions import add_entry, door

        places, detail = (place_a, place_b), {"type": form, "direction": direction, "state": state}
        made = door(self, name, places, line, height, clearance, width=width, **detail)
        add_entry(self, made)
        return self.doors[name]

    def find_rooms(
        self, *, storey: EntityName | None = None, add: bool = False
    ) -> list[FoundRooms]:
        """Find rooms and doorways between walls, stairs and lifts; by storey, the lowest first.

        Rooms and connectors that the map has already are left as they are, and out. A storey
        without walls has a `problem` in their place.

        Parameters
        ----------
        storey : only this one
        add : put them into the map; their property `found` has the confidence. A doorway that is
            no sound door, as in a wall thicker than 1.2 m, is left out: `problem` says which

        Raises
        ------
        LookupError, ValueError
            There is no such storey; no storey has walls.
        """
        from navgrid.found_lifts import with_lifts
        from navgrid.found_rooms import FoundRooms, find_rooms
        from navgrid.found_stairs import with_stairs
        from semmap.api.additions import (
            ROOMS_OF_TYPES,
            add_found_lifts,
            add_found_rooms,
            add_found_stairs,
        )
        from semmap.query.storey_reader import read_storeys
        from semmap.query.supertypes import read_supertypes

        with self.snapshot() as seen:
            scenes = read_storeys(seen, storey)
            rows = seen.connection.exec_driver_sql(ROOMS_OF_TYPES)
            shows = {row.name: row.rooms for row in rows}
            places = {room for rooms in shows.values() for room in rooms}
            supertypes = read_supertypes(seen, places)
        found = []
        for scene in scenes:
            try:
                found.append(find_rooms(scene, shows, supertypes))
            except ValueError as error:
                found.append(FoundRooms(scene.storey, scene.elevation, problem=str(error)))
        if all(each.problem for each in found):
            raise ValueError("; ".join(str(each.problem) for each in found))
        found = with_lifts(scenes, with_stairs(scenes, found))
        if add:
            with self._change():
                found = [add_found_rooms(self, each) for each in found]
                for step in (add_found_stairs, add_found_lifts):
                    for each in found:
                        step(self, each)
        return found

    def merge_rooms(self, name: EntityName, others: EntityName | Sequence[EntityName]) -> None:
        """Make rooms that lie side by side one room, the first of them.

        Doors between them go, the others' doors and contents become those of the first. The strip
        of a wall between them becomes floor.

        Parameters
        ----------
        name : the room that stays
        others : rooms beside it, which become parts of it

        Raises
        ------
        LookupError, ValueError
            There is no such room; they are not beside each other on one storey, at most a wall's
            0.3 m apart.
        """
        from semmap.api.room_edits import merge

        more = [others] if isinstance(others, str) else others
        with self._change():
            merge(self, [self.rooms[each] for each in (name, *more)])

    def split_room(self, name: EntityName, new: str, line: Sequence[Sequence[float]]) -> MapEntity:
        """Cut a room in two along a line; return the new one, the smaller part.

        An opening as wide as the line joins both; doors and contents belong to the part that they
        are in.

        Parameters
        ----------
        name : the room; it keeps the larger part
        new : the name of the other part
        line : points (x, y) from wall to wall, or beyond, metres in the map's frame

        Raises
        ------
        LookupError, ValueError
            There is no such room; the name is taken, or the line does not cut the room in two.
        """
        from semmap.api.room_edits import cut

        with self._change():
            return cut(self, self.rooms[name], line, new)

    def spot(
        self, holder: MapEntity, relation: str, size: Sequence[float] = (0, 0, 0), moved: int = 0
    ) -> tuple[float, float, float]:
        """A free point on or in a holder, nearest to the middle of its highest surface or floor.

        Parameters
        ----------
        relation : ``on`` or ``in``
        size : (x, y, z) of the thing to put there, metres in the map's frame
        moved : the id of this thing, which is not in its own way

        Raises
        ------
        ValueError
            The holder has no geometry, or others are wherever there would be space.
        """
        from semmap.api.additions import spot

        return spot(self, holder, relation, size, moved)
