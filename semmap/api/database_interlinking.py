"""Which records of two data sets are the same: files, objects of maps, and object models."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from semmap.api.map import Map
    from semmap.database.sure_connection import SureConnection
    from semmap.interlinking.interlink import Interlinking, PairQuestion
    from semmap.interlinking.records import Records

    Labels = Mapping[tuple[str, str], bool]
    Progress = Callable[[str, int, int], None]


def link_records(
    left: Records,
    right: Records,
    labels: Labels,
    *,
    ask: Callable[[PairQuestion], bool | None] | None = None,
    questions: int = 25,
    progress: Progress = lambda stage, done, total: None,
) -> Interlinking:
    """Return which records of two data sets are the same; arguments of `Database.interlink`."""
    from semmap.interlinking.interlink import Workbench

    work = Workbench(left, right, labels, progress)
    if ask is not None:
        work.ask(lambda a, b: ask(work.question(a, b)), questions)
    return work.interlink()


class DatabaseInterlinking:
    """The part of `Database` that links data sets."""

    if TYPE_CHECKING:

        @property
        def session(self) -> SureConnection:
            """A psycopg connection with autocommit, its search path on the schema."""

    def interlink(
        self,
        left: str | Path | Map | Records,
        right: str | Path | Map | Records,
        labels: Labels | str | Path | None = None,
        *,
        ask: Callable[[PairQuestion], bool | None] | None = None,
        questions: int = 25,
        type: str | None = None,
        store: bool = True,
        progress: Progress = lambda stage, done, total: None,
    ) -> Interlinking:
        """Find which records of two data sets are the same, and store the links.

        Returns `links()`, `pattern`, `quality(reference)`, `correspondences`, ...

        Parameters
        ----------
        left, right : a map, whose objects are the records; ``models``, the object models of
            manipulation; a CSV or RDF file; or records
        labels : whether (left key, right key) are the same, for few pairs; or a file of them: CSV
            of left, right and yes or no, or an alignment. Some may be wrong: `doubted` of the
            result has those that were left out. `dropped` counts those of unknown records
        ask : answers whether a pair is the same, None to end; called for the most informative
            pairs, and each fourth time for a pair again
        questions : the most calls of `ask`
        type : of the resources in RDF files
        store : store a link set; its number is `link_set` of the result

        Raises
        ------
        LookupError, ValueError
            A file or labels that cannot be used, such as of other data sets only, or data sets
            without a common property.
        """
        from semmap.interlinking.link_file import read_labels
        from semmap.interlinking.store import store_links

        known = read_labels(Path(labels)) if isinstance(labels, str | Path) else labels or {}
        sets = self._records(left, type), self._records(right, type)
        found = link_records(*sets, known, ask=ask, questions=questions, progress=progress)
        return replace(found, link_set=store_links(self.session, found)) if store else found

    def list_link_sets(self) -> list[dict[str, Any]]:
        """The stored link sets, the newest first: `id`, `left`, `right`, `links`, `labels`, ..."""
        from semmap.interlinking.store import link_sets

        return link_sets(self.session)

    def merged_records(self, link_set: int) -> list[dict[str, Any]]:
        """Both data sets of a link set as one: a row for each resource.

        A row has `resource` (None without links), `left_keys`, `right_keys`, `confidence` of the
        least sure link, and `properties`.
        """
        from semmap.interlinking.store import merged_records

        return merged_records(self.session, link_set)

    def undo_links(self, link_set: int) -> int:
        """Take a link set and data sets that no other one uses back; return its number of links."""
        from semmap.interlinking.store import undo_links

        return undo_links(self.session, link_set)

    def _records(self, given: str | Path | Map | Records, type: str | None) -> Records:
        from semmap.api.map_questions import MapQuestions
        from semmap.interlinking.data_set_file import read_records
        from semmap.interlinking.reader import read_map_objects, read_object_models
        from semmap.interlinking.records import Records

        if isinstance(given, Records):
            return given
        if isinstance(given, MapQuestions):
            return read_map_objects(given._seen)
        if given == "models":
            return read_object_models(self.session)
        return read_records(Path(given), type)
