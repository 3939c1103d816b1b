"""Where objects of a map probably are."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Any

from semmap.api.checked import EntityName
from semmap.api.map_questions import MapQuestions, aware

if TYPE_CHECKING:
    from semmap.belief.believed_places import BelievedPlaces
    from semmap.belief.identify import Detection, Identity
    from semmap.belief.store.learning import LearnedBelief


class MapBeliefs(MapQuestions):
    """The part of `Map` about beliefs; they follow from what `MapObservations` stores."""

    def where(
        self, name: EntityName, at: datetime | None = None, *, moves: float | None = None
    ) -> BelievedPlaces:
        """Where an object or agent probably is: a mapping of places to probabilities.

        The most probable place is the first; `elsewhere` is no place of the map. They sum to 1.

        Parameters
        ----------
        name : of the object or agent, or a type: where any one of that type is
        at : by statements and observations until then; local without a time zone, by default now
        moves : seconds in which an object of mobility 1 moves once; by default those of the map

        Raises
        ------
        LookupError, ValueError
            The map has no such entity, and none of such a type; or it is not an object or agent.
        """
        return self.beliefs([name], at, moves=moves)[name]

    def beliefs(
        self,
        names: Sequence[EntityName],
        at: datetime | None = None,
        *,
        occlusion: bool = False,
        moves: float | None = None,
    ) -> dict[str, BelievedPlaces]:
        """Where several objects probably are, by name.

        Parameters
        ----------
        at, moves : as for `where`
        occlusion : the larger ones of these objects may hide the smaller ones

        Raises
        ------
        LookupError, ValueError
            As `where`; `occlusion` and `moves` together, or an object of unknown volume.
        """
        from semmap.belief.believed_places import BelievedPlaces
        from semmap.belief.motion import MotionModel
        from semmap.belief.store.beliefs import where

        if occlusion and moves is not None:
            raise ValueError("choose occlusion or moves: no model has both")
        moment = aware(at)
        if moves is not None:
            moves = MotionModel(moves).seconds
        with self.snapshot() as seen:
            found = {n: BelievedPlaces(n, where(seen, n, moment, moves), moment) for n in names}
            if not occlusion:
                return found
            from semmap.belief.believed_places import belief_with_occlusion

            estimates = belief_with_occlusion(seen, names, moment)
        return found | {name: found[name].revised(of) for name, of in estimates.items()}

    def which(
        self, kind: EntityName, place: EntityName, at: datetime | None = None
    ) -> dict[str, float]:
        """Which object of a type was in or on a place: its probability by name, largest first.

        Looks since then count, too: what is seen there today was probably there yesterday evening.
        That the map puts it there today says nothing of yesterday.

        Parameters
        ----------
        kind : a type; or one object
        place : a place, or what holds places, as a room or storey
        at : local without a time zone, by default now; it may be later

        Raises
        ------
        LookupError, ValueError
            The map has no such place or object; none of them can be there; or it is an agent.
        """
        from semmap.belief.store.was_there import which

        with self.snapshot() as seen:
            return which(seen, kind, place, aware(at))

    def initial_belief(
        self, names: Sequence[EntityName], at: datetime | None = None
    ) -> dict[str, list[Any]]:
        """The initial belief as a message: `location`, and the probabilities for each name.

        `at`: as for `where`. `location` has the names of all places, `elsewhere` last; each of
        `names` has its probabilities in that order. Errors are those of `where`; an object of the
        name ``location`` is one, too.
        """
        from semmap.belief.store.beliefs import initial_belief

        with self.snapshot() as seen:
            return initial_belief(seen, names, aware(at))

    def identify(
        self,
        detections: Sequence[Detection],
        *,
        frame: EntityName | None = None,
        at: datetime | None = None,
        moves: float = 86_400.0,
        hit: float = 0.9,
        false_alarm: float = 0.001,
        new: float = 0.05,
    ) -> list[Identity]:
        """Which objects the detections of one view are: known ones, perhaps moved, or new ones.

        Returns for each detection its `place`, the probability of each `known` object, of a `new`
        one, and of a `false_alarm`; they sum to 1.

        Parameters
        ----------
        detections, frame, at : as for `Map.observe_objects`
        moves : seconds in which an object of mobility 1 moves once
        hit : P(the detector finds an object | it is there)
        false_alarm : expected number of objects of a type at a place that it finds in vain
        new : expected number of objects of a type at a place that the map lacks

        Raises
        ------
        LookupError, ValueError
            There is no such type or agent, or a point is not finite or at no place.
        """
        from semmap.belief.identify import identify
        from semmap.belief.motion import MotionModel

        motion = MotionModel(moves)
        with self.snapshot() as seen:
            rates = {"hit": hit, "false_alarm": false_alarm, "new": new}
            return identify(seen, detections, frame=frame, at=aware(at), motion=motion, **rates)

    def learn_belief(self, hold_out: float = 0.0, time_zone: str | None = None) -> LearnedBelief:
        """Learn from the map's history where things are kept, and how often they move, and when.

        With the rates of detectors: of looks of agents that state none. What was learned before is
        replaced, and beliefs follow. Learn again, each night or so, as the history grows.

        Parameters
        ----------
        hold_out : days; what the history before the last ones teaches is judged by their looks,
            until the last look
        time_zone : of the building, by whose clock people live, as `Europe/Berlin`; the map keeps
            it, and has UTC at first

        Raises
        ------
        ValueError
            The map has no history of objects, no looks to judge by, or nothing before these days;
            the time zone is unknown; this login may not learn; or another session learns.
        """
        from semmap.belief.store.learning import learn_belief

        with self.transaction(), self.snapshot() as seen:
            return learn_belief(seen, hold_out, time_zone)

    def forget_learned(self) -> int:
        """Delete what `learn_belief` learned; returns how many lifts. Beliefs follow.

        ValueError: this login may not do this, or another session learns.
        """
        from semmap.belief.store.learning import forget_learned

        with self.transaction(), self.snapshot() as seen:
            return forget_learned(seen.session)

    def belief_field(
        self,
        name: EntityName,
        keep_as: str | None = None,
        *,
        voxel_size: float = 0.05,
        at: datetime | None = None,
    ) -> dict[str, Any]:
        """Store a belief as a field of probabilities, for queries and costmaps.

        Returns `field`, its name, with its `version` and how many `voxels` it has.

        Parameters
        ----------
        name, at : as for `where`
        keep_as : the name of the field; by default ``belief-NAME``
        voxel_size : edge of a voxel in metres

        Raises
        ------
        LookupError, ValueError
            As `where`; a name that no field can have, or an edge that is not above 0.
        """
        from semmap.belief.belief_field import belief_map
        from semmap.belief.reader import read_places
        from semmap.fields.store.map_store import save_map
        from semmap.fields.store.names import read_map_vocabulary

        moment = aware(at)
        belief = self.where(name, moment)
        with self._change() as seen:
            made = belief_map(
                read_map_vocabulary(),
                read_places(seen, name),
                belief,
                about=name,
                voxel_size=voxel_size,
                time=moment,
            )
            field = keep_as or f"belief-{name}"
            return {
                "field": field,
                "version": save_map(seen.session, field, made),
                "voxels": len(made),
            }

    def export_belief(
        self, names: Sequence[EntityName], *, occlusion: bool = False, at: datetime | None = None
    ) -> str:
        """Priors and observations of objects as a ProbLog program, for other programs.

        `occlusion`: the larger ones of `names` may hide the smaller ones. `at`: as for `where`.
        Errors are those of `where`; a name that appears twice, or with occlusion an unknown volume,
        is one, too.
        """
        from semmap.belief.problog_program import problog_program
        from semmap.belief.reader import read_columns, read_model

        with self.snapshot() as seen:
            columns, model = read_columns(seen, names, aware(at)), read_model(seen)
        return problog_program(
            columns.prior,
            columns.observations,
            columns.mobility,
            columns.objects,
            columns.places,
            columns.known_volume() if occlusion else None,
            model=model,
        )
