"""One map of an environment: imports, and entities that are added; `MapQuestions` reads it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from semmap.api.map_entity import MapEntity
from semmap.api.map_fields import MapSpace
from semmap.api.map_knowledge import MapKnowledge
from semmap.api.map_questions import MapQuestions

if TYPE_CHECKING:
    import shapely
    import trimesh

    from semmap.geometry.mesh import Mesh
    from semmap.ingest.importer import ImportSummary
    from semmap.ingest.store.model_store import Progress

__all__ = ["Map"]

PlanarPose = Sequence[float]
"""(x, y, z, yaw): metres and radians in the map's frame; yaw may be left out."""


class Map(MapKnowledge, MapSpace, MapQuestions):
    """A map of one environment, by the names of its entities.

    Attributes
    ----------
    database : Database
    name : the name of the map
    """

    def import_file(
        self,
        path: str | Path,
        *,
        geometry: Literal["visual", "collision"] = "visual",
        mesh_as: Literal["object", "room"] = "object",
        strict: bool = False,
        source: str | None = None,
        model_path: Sequence[str | Path] = (),
        scale: float = 1.0,
        progress: Progress = lambda stage, done, total: None,
    ) -> ImportSummary:
        """Read a world file into the map, in one transaction; a repeated import updates it.

        `model_path` has folders of SDF models, searched first; `scale` is metres per unit of a mesh
        file.

        Raises
        ------
        WorldError
            The file cannot be used as a whole; the map stays as it was.
        """
        from semmap.ingest.importer import import_file

        return import_file(
            self.database.engine,
            Path(path),
            map_name=self.name,
            geometry=geometry,
            mesh_as=mesh_as,
            strict=strict,
            source=source,
            model_path=[Path(folder) for folder in model_path],
            scale=scale,
            progress=progress,
        )

    def add_storey(
        self, name: str, *, elevation: float = 0.0, height: float | None = None
    ) -> MapEntity:
        """Add a storey: its floor's height above the map's origin and its clear height, metres."""
        from semmap.api.additions import storey

        return self._add(storey(name, elevation, height))

    def add_room(
        self,
        name: str,
        polygon: shapely.Polygon | Sequence[Sequence[float]],
        *,
        floor: float = 0.0,
        ceiling: float | None = None,
        storey: str | None = None,
        type: str | None = None,
        label: str | None = None,
    ) -> MapEntity:
        """Add a room.

        Parameters
        ----------
        polygon : the outline, (N, 2) metres in the map's frame
        floor, ceiling : heights in the map's frame, metres
        storey : by default the one on whose floor it is, if there is one

        Raises
        ------
        ValueError
            The name is taken, the outline is none, or the ceiling is not above the floor.
        """
        from semmap.api.additions import room

        return self._add(room(name, polygon, floor, ceiling, type, label), storey=storey)

    def add_region(
        self,
        name: str,
        polygon: shapely.Polygon | Sequence[Sequence[float]],
        *,
        floor: float = 0.0,
        ceiling: float | None = None,
        type: str | None = None,
        label: str | None = None,
        storey: str | None = None,
    ) -> MapEntity:
        """Add a region (a zone): an outline with a meaning; as `add_room`."""
        from semmap.api.additions import region

        return self._add(region(name, polygon, floor, ceiling, type, label), storey=storey)

    def add_object(
        self,
        name: str,
        *,
        type: str | None = None,
        mesh: str | Path | trimesh.Trimesh | Mesh | None = None,
        size: Sequence[float] | None = None,
        pose: PlanarPose | None = None,
        on: str | None = None,
        in_: str | None = None,
        label: str | None = None,
        properties: Mapping[str, Any] | None = None,
    ) -> MapEntity:
        """Add an object.

        Parameters
        ----------
        mesh : the geometry in the object's own frame, metres: a file, a trimesh or a `Mesh`
        size : instead of a mesh, a box of (x, y, z) metres that stands on its frame's origin
        pose : (x, y, z, yaw) in the map's frame; by default the middle of `on` or `in_`
        on, in_ : names of what holds it; without them, the geometry says it

        Raises
        ------
        ValueError
            The name is taken, a part contradicts another, or the pose is not on or in the holder.
        LookupError
            There is no such holder.
        """
        from semmap.api.additions import thing

        return self._add(
            thing(name, "object", type, mesh, size, pose, label, properties), on=on, in_=in_
        )

    def add_agent(
        self,
        name: str,
        *,
        type: str | None = None,
        size: Sequence[float] | None = None,
        mesh: str | Path | trimesh.Trimesh | Mesh | None = None,
        pose: PlanarPose | None = None,
        in_: str | None = None,
    ) -> MapEntity:
        """Add a robot or a person; as `add_object`."""
        from semmap.api.additions import thing

        return self._add(thing(name, "agent", type, mesh, size, pose, None, None), in_=in_)

    def add_door(
        self,
        name: str,
        place_a: str,
        place_b: str | None,
        line: Sequence[Sequence[float]],
        *,
        width: float | None = None,
        state: Literal["open", "closed", "locked"] = "open",
        form: Literal["door", "elevator_door", "stairs", "ramp"] = "door",
        direction: Literal["both", "forward", "backward"] = "both",
        height: float = 0.0,
        clearance: float = 0.6,
    ) -> MapEntity:
        """Add a connector of two places.

        Parameters
        ----------
        place_a, place_b : names of rooms; `place_b` None: it leads outside
        line : ((x, y), (x, y)): the opening from post to post, metres in the map's frame
        width : of the clear opening; by default the line's length
        height : of the floor in the map's frame, metres
        clearance : how far from the line a robot stands before and behind it, metres

        Raises
        ------
        LookupError
            There is no such room.
        ValueError
            The name is taken, or neither side of the line is in `place_a`.
        """
        from semmap.api.additions import DoorShape, door

        rooms = [self[place] for place in (place_a, place_b) if place is not None]
        distances = [partial(self._distance, room) for room in rooms]
        shape = DoorShape(line, width, height, clearance)
        return self._add(door(name, place_a, place_b, shape, distances, form, direction, state))

    def teach(self, teaching: str | Path | Mapping[str, Any]) -> dict[str, int]:
        """Teach knowledge, relations, actions, objects and where they were seen; all or nothing.

        Parameters
        ----------
        teaching : a JSON file, a Map.xml of the thesis, or the same as a mapping
            (`semmap.belief.teaching.parse_teaching` describes it)

        Returns
        -------
        How many `types`, `relations`, `actions`, `objects` and `observations` were stored.

        Raises
        ------
        LookupError, ValueError
            As `semmap.belief.store.teaching.teach`: what contradicts the map is refused.
        """
        from semmap.belief.store.teaching import teach
        from semmap.belief.teaching import parse_teaching, read_teaching

        parsed = (
            read_teaching(Path(teaching))
            if isinstance(teaching, str | Path)
            else parse_teaching(teaching)
        )
        return teach(self.connection, parsed)

    def observe(self, name: str, place: str, *, seen: bool = True, **values: Any) -> None:
        """Store that an object or agent was seen at a place, or looked for and not seen.

        Parameters
        ----------
        values : `at`, `visible`, `hit`, `false_alarm`, `position`, `inside`, `observer`, as of
            `semmap.belief.store.beliefs.add_observations`

        Raises
        ------
        LookupError, ValueError
            As `semmap.belief.store.beliefs.add_observations`.
        """
        from semmap.belief.store.beliefs import add_observations

        add_observations(self.connection, [{"object": name, "place": place, "seen": seen} | values])

    def spot(self, holder: MapEntity, relation: str) -> tuple[float, float, float]:
        """A point on or in a holder: the middle of its highest surface, or of its floor."""
        from semmap.api.additions import spot

        return spot(self, holder, relation)

    def _distance(self, room: MapEntity, x: float, y: float) -> float:
        row = self.execute(
            "SELECT ST_Distance(footprint, ST_MakePoint(%s, %s)) FROM world WHERE entity_id = %s",
            x,
            y,
            room.id,
        )
        if not row or row[0][0] is None:
            raise ValueError(f"{room.name} has no outline")
        return float(row[0][0])

    def _add(
        self,
        entry: Any,
        *,
        on: str | None = None,
        in_: str | None = None,
        storey: str | None = None,
    ) -> MapEntity:
        from semmap.api.additions import add_entry

        return add_entry(self, entry, on=on, in_=in_, storey=storey)
