"""What a map is told: what was seen where, or looked for in vain, and what is taught in words."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from semmap.api.checked import EntityName
from semmap.api.map_questions import MapQuestions, aware

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from semmap.belief.teaching import KnownAction


class MapObservations(MapQuestions):
    """The part of `Map` that stores observations and teachings; `Map.where` follows them."""

    def observe(
        self,
        name: EntityName,
        place: EntityName,
        *,
        seen: bool = True,
        at: datetime | None = None,
        visible: float = 1.0,
        position: Sequence[float] | None = None,
        inside: bool | None = None,
        observer: EntityName | None = None,
        hit: float | None = None,
        false_alarm: float | None = None,
    ) -> dict[str, Any]:
        """Store that an object or agent was seen at a place, or looked for and not seen.

        Parameters
        ----------
        name, place : of the object or agent, and of furniture, a room, ...
        at : local without a time zone, by default now
        visible : the share of the place in view, in (0, 1]
        position : (x, y, z) in the frame of the place, metres
        inside : anywhere in the place, also on or in the furniture there; by default so for rooms,
            storeys and regions without a position
        hit, false_alarm : P(seen | there) and P(seen | not there) of the detector

        Raises
        ------
        LookupError
            The map has no such object, place or agent.
        ValueError
            A number out of its range, a time in the future, or a place without room for the object.
        """
        from semmap.belief.reader import is_wide
        from semmap.belief.store.beliefs import add_observations

        row: dict[str, Any] = {"object": name, "place": place, "seen": seen, "at": aware(at)}
        row |= {"visible": visible, "observer": observer, "hit": hit, "false_alarm": false_alarm}
        with self.transaction(), self.snapshot() as now:
            if inside is None:
                inside = position is None and is_wide(now, place)
            row |= {"inside": inside, "position": position}
            add_observations(now.session, [row])
        return row

    def observe_point(
        self,
        name: EntityName,
        point: Sequence[float],
        *,
        frame: EntityName | None = None,
        at: datetime | None = None,
        hit: float | None = None,
        false_alarm: float | None = None,
    ) -> dict[str, Any]:
        """Store that an object was detected at a point; the map tells at which `place` that is.

        Parameters
        ----------
        point : (x, y, z) metres
        frame : the agent in whose frame the point is; by default that of the map
        at, hit, false_alarm : as for `observe`

        Raises
        ------
        LookupError, ValueError
            As `observe`; the point is at no place.
        """
        from semmap.belief.looks import observe_point

        rates: dict[str, Any] = {"hit": hit, "false_alarm": false_alarm}
        with self._change() as now:
            return observe_point(now, name, point, frame=frame, at=aware(at), **rates)

    def observe_view(
        self,
        view: Sequence[float],
        looked_for: Collection[EntityName] = (),
        seen: Mapping[str, Sequence[float]] | None = None,
        *,
        frame: EntityName | None = None,
        cloud: str | Path | ArrayLike | None = None,
        without: Collection[EntityName] = (),
        opening: float = 1.05,
        furthest: float = 5.0,
        at: datetime | None = None,
        hit: float | None = None,
        false_alarm: float | None = None,
    ) -> list[dict[str, Any]]:
        """Store detections in the view of a camera, and looks in vain for the other objects.

        The meshes of the map tell which share of each place was in view. Returns the observations.

        Parameters
        ----------
        view : x, y, z (metres), yaw and pitch (radians, downwards) of the camera
        looked_for : objects that the detector knows
        seen : (x, y, z) in metres of those that it detected, by name
        frame : the agent in whose frame `view` and `seen` are; by default that of the map
        cloud : points in the optical frame (x right, y down, z ahead), metres: a PLY or NPY file,
            or an array (n, 3); `looked_for` are recognised in it, in place of `seen`
        without : furniture whose points are removed from the cloud first, such as a shelf
        opening : horizontal opening angle, radians
        furthest : range of the detector, metres
        at, hit, false_alarm : as for `observe`

        Raises
        ------
        LookupError, ValueError
            As `observe`; no name, a camera out of range, or a cloud without a table.
        """
        from semmap.belief.looks import agent_view, observe_view

        if not seen and not looked_for:
            raise ValueError("name the objects that are looked for, or where some were seen")
        if cloud is not None and seen:
            raise ValueError("give one of cloud and seen: objects are found in the cloud")
        if cloud is None and without:
            raise ValueError("without is for a cloud: furniture to remove from its points")
        moment = aware(at)
        options: dict[str, Any] = {"furthest": furthest, "at": moment, "observer": frame}
        options |= {"hit": hit, "false_alarm": false_alarm}
        with self._change() as now:
            camera, detected = agent_view(now, view, opening, seen or {}, frame, moment)
            if cloud is None:
                return observe_view(now, camera, looked_for, detected, **options)
            from semmap.belief.cloud_looks import observe_cloud
            from semmap.perception.point_cloud import read_cloud

            points = read_cloud(Path(cloud)) if isinstance(cloud, str | Path) else cloud
            return observe_cloud(now, camera, points, looked_for, without=without, **options)

    # --- in words

    def teach(self, teaching: str | Path | Mapping[str, Any]) -> dict[str, int]:
        """Teach sentences, knowledge, relations, actions, objects and where they were seen.

        All is stored or nothing. Returns how many `types`, `relations`, `actions`, `objects` and
        `observations` were stored.

        Parameters
        ----------
        teaching : a sentence of `grammar` that states something, such as "the mug is on the table";
            a JSON file, a Map.xml of the thesis, or the same as a mapping
            (`semmap.belief.teaching.parse_teaching` describes it). A text with a space is a
            sentence, unless it ends with .json or .xml

        Raises
        ------
        LookupError, ValueError
            A name or number cannot be used, or contradicts the map.
        """
        from semmap.belief.store.teaching import teach
        from semmap.belief.teaching import is_sentence, parse_teaching, read_teaching

        if is_sentence(teaching):
            parsed, name = parse_teaching({"sentences": [teaching]}), str(teaching)
        elif isinstance(teaching, str | Path):
            parsed, name = read_teaching(Path(teaching)), Path(teaching).name
        else:
            parsed, name = parse_teaching(teaching), "teaching"
        return teach(self.connection, parsed, name)

    def list_teachings(self) -> list[dict[str, Any]]:
        """What was taught to the map, the newest first: `id`, `name`, `facts`, `by` and `at`."""
        from semmap.belief.store.taught_facts import list_teachings

        with self.snapshot() as seen:
            return list_teachings(seen.session)

    def undo_teaching(self, teaching: int) -> list[str]:
        """Take a teaching back: all that it added or changed is as it was before.

        What another teaching states, too, stays. What others use or changed since stays as well,
        and is returned: such as a class of which there are other objects.

        Parameters
        ----------
        teaching : its `id` of `list_teachings`

        Raises
        ------
        LookupError, ValueError
            The map has no such teaching, or this login may not take it back.
        """
        from semmap.belief.store.taught_facts import undo_teaching

        return undo_teaching(self.connection, teaching)

    def how_to(self, goal: str, given: Sequence[str] = ()) -> list[KnownAction]:
        """The shortest chain of taught actions that brings about a goal, the first one first.

        Parameters
        ----------
        goal : a taught state, or an entity or type
        given : states that hold already

        Raises
        ------
        LookupError, ValueError
            There is no such goal, or no action brings it about.
        """
        from semmap.belief.store.teaching import how_to

        with self.snapshot() as seen:
            return how_to(seen, goal, given)

    def grammar(self, format: Literal["gbnf", "jsgf"] = "gbnf") -> str:
        """A grammar of the names that the map knows, for speech recognisers and language models.

        `format` is ``gbnf``, of llama.cpp and others, or ``jsgf``, of speech recognisers.
        ValueError for another one, or if the map has no names.
        """
        from semmap.belief.grammar import write_grammar
        from semmap.belief.store.teaching import vocabulary

        with self.snapshot() as seen:
            return write_grammar(vocabulary(seen), format)
