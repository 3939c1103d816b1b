"""Reasoning about a map: inferences, contradictions and their explanation, and shapes."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from semmap.api.checked import Positive
from semmap.api.live_events import timer
from semmap.api.map_questions import MapQuestions

if TYPE_CHECKING:
    from semmap.knowledge.reasoning.explanations import Why
    from semmap.knowledge.reasoning.runs import Reasoned
    from semmap.knowledge.shacl import Violation


class MapReasoning(MapQuestions):
    """The part of `Map` that infers facts, and validates them."""

    def reason(self, *, complete: bool = False, seconds: float | None = None) -> Reasoned:
        """Infer facts by RDFS and OWL 2 RL; from then on, each `update` does so, too.

        Returns how many inferences were `added` and `removed`, and how many `inferences` and
        `contradictions` there are now.

        Parameters
        ----------
        complete : read all facts again, even if only few changed
        seconds : after which it is stopped; by default the limit of `semmap.limits`

        Raises
        ------
        ValueError
            It took too long; nothing was changed.
        """
        from semmap.knowledge.reasoning.runs import reason

        return reason(self.connection, complete=complete, seconds=seconds)

    def keep_reasoning(
        self,
        callback: Callable[[Reasoned], Any] = lambda done: None,
        *,
        seconds: Positive | None = None,
        stop: threading.Event | None = None,
    ) -> None:
        """Infer after each change of the map, while this runs.

        `callback` gets each run that read all facts or changed inferences. It ends after `seconds`,
        when `stop` is set, or when it is interrupted.
        """
        from semmap.query.change_feed import ChangeFeed

        stop = stop or threading.Event()

        def infer(payloads: tuple[str, ...] | None) -> None:
            if payloads == ():
                return
            if self.connection.closed:  # the server was away
                self.close()
            done = self.reason()
            if done.complete or done.added or done.removed:
                callback(done)

        ending = timer(seconds, stop.set)
        try:
            ChangeFeed(self.database.engine, self.name).follow(stop, infer)
        finally:
            ending.cancel()

    def forget_inferences(self) -> None:
        """Remove all inferences; the map is reasoned about no more."""
        from semmap.knowledge.reasoning.runs import forget

        forget(self.connection)

    def contradictions(self) -> list[Why]:
        """List the facts that contradict an axiom, each with the `axiom` and `because`."""
        from semmap.knowledge.reasoning.explanations import contradictions

        with self.reading() as session:
            return contradictions(session)

    def why(self, fact: str) -> Why:
        """Explain why a fact is one: the axioms, down to facts that were told.

        Returns the proof: its `fact`, the `axiom` ("" where the fact was told), and `because`, the
        proofs of what it follows from.

        Parameters
        ----------
        fact : a triple, such as ``:cup1 a semmap:Drinkware``

        Raises
        ------
        ValueError, LookupError
            It is not a triple, or not a fact of the map.
        """
        from semmap.knowledge.reasoning.explanations import why

        with self.reading() as session:
            return why(session, fact)

    # --- shapes

    def validate(
        self,
        shapes: str | Path | Sequence[str | Path] | None = None,
        *,
        seconds: float | None = None,
    ) -> list[Violation]:
        """Return the parts of the map that do not conform to shapes of SHACL.

        Parameters
        ----------
        shapes : files in Turtle; by default the shipped shapes, for a robot's map
        seconds : after which it is stopped; by default the limit of `semmap.limits`

        Raises
        ------
        WorldError, ValueError
            A file cannot be used; it took too long.
        """
        from semmap.knowledge.shacl import domain_shapes, read_shapes, validate

        paths = [shapes] if isinstance(shapes, str | Path) else shapes or ()
        chosen = [read_shapes(Path(path), seconds=seconds) for path in paths] or [domain_shapes()]
        with self.reading() as session:
            return validate(session, chosen, seconds=seconds)

    def bind_shapes(self, path: str | Path) -> None:
        """Let the shapes of a file bind the map: an update that breaks them is refused.

        `path`: SHACL in Turtle.

        Raises
        ------
        WorldError, ValueError
            The file cannot be used; the map does not conform to them now.
        """
        from semmap.knowledge.shacl import bind_shapes, read_shapes

        bind_shapes(self.connection, read_shapes(Path(path)))

    def unbind_shapes(self, name: str) -> None:
        """Let shapes bind the map no more; their name is that of their file, without its ending."""
        from semmap.knowledge.shacl import unbind_shapes

        unbind_shapes(self.connection, name)

    @property
    def binding_shapes(self) -> list[str]:
        """The names of the shapes that bind the map."""
        from semmap.knowledge.map_view import MapView
        from semmap.knowledge.shacl import binding_shapes

        with self.reading() as session:
            return [each.name for each in binding_shapes(MapView.of(session))]
