"""What people and programs teach a map in words: knowledge, relations, actions, objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from semmap.api.map_questions import MapQuestions

if TYPE_CHECKING:
    from semmap.belief.teaching import KnownAction


class MapTeaching(MapQuestions):
    """The part of `Map` about teachings."""

    def teach(self, teaching: str | Path | Mapping[str, Any]) -> dict[str, int]:
        """Teach knowledge, relations, actions, objects and where they were seen; all or nothing.

        Returns how many `types`, `relations`, `actions`, `objects` and `observations` were stored.

        Parameters
        ----------
        teaching : a JSON file, a Map.xml of the thesis, or the same as a mapping
            (`semmap.belief.teaching.parse_teaching` describes it)

        Raises
        ------
        LookupError, ValueError
            A name or number cannot be used, or contradicts the map.
        """
        from semmap.belief.store.teaching import teach
        from semmap.belief.teaching import parse_teaching, read_teaching

        parsed = (
            read_teaching(Path(teaching))
            if isinstance(teaching, str | Path)
            else parse_teaching(teaching)
        )
        return teach(self.connection, parsed)

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

    def grammar(self, format: str = "gbnf") -> str:
        """A grammar of the names that the map knows, for speech recognisers and language models.

        `format` is ``gbnf``, of llama.cpp and others, or ``jsgf``, of speech recognisers.
        ValueError for another one, or if the map has no names.
        """
        from semmap.belief.grammar import write_grammar
        from semmap.belief.store.teaching import vocabulary

        with self.snapshot() as seen:
            return write_grammar(vocabulary(seen), format)
