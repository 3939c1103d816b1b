"""The map as RDF: queries and updates in SPARQL, files, and the endpoint."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from semmap.api.checked import Positive
from semmap.api.live_events import timer
from semmap.api.map_reasoning import MapReasoning
from semmap.whole_file import write_whole

if TYPE_CHECKING:
    import rdflib

    Progress = Callable[[str, int, int], None]

    from semmap.api.live_events import LiveEvents
    from semmap.knowledge.answer import Answer
    from semmap.knowledge.client import KnowledgeClient
    from semmap.knowledge.sparql.kept_queries import Session
    from semmap.knowledge.standing.subscriptions import Event
    from semmap.knowledge.updates import GraphChanges


class MapKnowledge(MapReasoning):
    """The part of `Map` that is a graph of RDF; see docs/knowledge.md."""

    def sparql(
        self,
        text: str,
        *,
        seconds: float | None = None,
        rows: int | None = None,
        inferred: bool = True,
        plan: bool = False,
    ) -> Answer:
        """Answer a query of SPARQL 1.1 on the facts, geometry and T-Box of the map.

        Returns an answer that yields its rows as plain values, is true or false where it is ASK,
        and has the `names` of its columns, the terms (`rows`), the `graph` of CONSTRUCT, `notes`,
        and an `explanation`: the SQL, or why rdflib evaluated it.

        Parameters
        ----------
        text : the usual prefixes are declared, and the empty one is that of the map's entities, so
            that ``:table1`` is the entity table1
        seconds : stop after this time; by default the limit of `semmap.limits`
        rows : the most rows of an answer; by default the limit of `semmap.limits`
        inferred : see inferences, too
        plan : put the server's plan and its times into the explanation, after each statement

        Raises
        ------
        ValueError
            The text is wrong (with line and column), or a limit is exceeded.
        """
        from semmap.knowledge.queries import query

        with self.reading() as session:
            return query(session, text, seconds=seconds, rows=rows, inferred=inferred, plan=plan)

    def update(self, text: str, *, seconds: float | None = None) -> GraphChanges:
        """Carry out an update of SPARQL 1.1, as a whole or not at all.

        Returns the numbers of facts that were `added` and `removed`.

        Raises
        ------
        ValueError
            The text is wrong, the map or shapes that bind it do not allow a fact, or it took too
            long; nothing was changed.
        """
        from semmap.knowledge.updates import update

        return update(self.connection, text, seconds=seconds)

    def watch_sparql(
        self,
        text: str,
        callback: Callable[[Event], Any] | None = None,
        *,
        seconds: Positive | None = None,
    ) -> LiveEvents[Event]:
        """Follow the map: which answers of a query appear and disappear.

        Returns events with `what` ("appeared" or "disappeared") and `values`, plain values by
        variable. Its `count` is the number of answers that there are already, which are no events.

        Parameters
        ----------
        text : SELECT or ASK
        callback : gets each event, in a thread of its own; without it, loop over the result
        seconds : stop after this time; by default when the result is closed

        Raises
        ------
        ValueError
            The text is wrong, or neither SELECT nor ASK.
        """
        from semmap.api.live_events import LiveEvents
        from semmap.knowledge.standing.subscriptions import Subscriptions

        standing = Subscriptions(self.database.reading_engine, self.name)
        try:
            _, count = standing.add(text, callback=callback)
        except BaseException:
            standing.close()
            raise
        return LiveEvents(count, standing.events(), standing.close, seconds=seconds)

    def knowledge_client(self) -> KnowledgeClient:
        """A client with the interface of KnowledgeCore: revise, find, subscribe; close it."""
        from semmap.knowledge.client import KnowledgeClient

        return KnowledgeClient(self)

    # --- files

    def graph(self, *, inferences: bool = False) -> rdflib.Dataset:
        """Return all facts of the map, with its named graphs.

        `inferences`: with those of `reason`, in the graph ``urn:semmap:inferred``. ValueError
        where the map is not reasoned about.
        """
        from semmap.knowledge.whole_graph import dump

        with self.reading() as session:
            _refuse_unreasoned(session, inferences)
            return dump(session, inferences=inferences)

    def export_rdf(self, path: str | Path, *, inferences: bool = False) -> int:
        """Write all facts of the map to a file, and return how many there are.

        Parameters
        ----------
        path : its ending says the format: .ttl, .jsonld, .trig, .nt, .nq, .rdf or .owl. Named
            graphs are written to .trig, .nq and .jsonld
        inferences : with those of `reason`: in the graph ``urn:semmap:inferred``, or among all
            facts where the format has no graphs

        Raises
        ------
        ValueError
            The ending is unknown, or the map is not reasoned about.
        """
        from semmap.knowledge.rdf_file import format_of
        from semmap.knowledge.whole_graph import serialized

        format_ = format_of(Path(path))
        graph = self.graph(inferences=inferences)
        write_whole(path, serialized(graph, format_))
        return len(graph)

    def r2rml(self, *, inferences: bool = False) -> str:
        """Return the mapping of the map to RDF as R2RML, in Turtle, for Ontop and such programs.

        It makes the facts of `graph` from the database. Comments list the properties that it
        lacks, and why. `inferences`: with those of `reason`, in the graph ``urn:semmap:inferred``.
        ValueError where the map is not reasoned about.
        """
        from semmap.knowledge.r2rml import r2rml

        with self.reading() as session:
            _refuse_unreasoned(session, inferences)
            return r2rml(session, inferences=inferences)

    def export_r2rml(self, path: str | Path, *, inferences: bool = False) -> int:
        """Write `r2rml` to a file, and return how many triples maps it has.

        Raises
        ------
        ValueError
            The map is not reasoned about, and inferences are wanted.
        """
        text = self.r2rml(inferences=inferences)
        write_whole(path, text)
        return text.count(" a rr:TriplesMap ;\n")

    def import_rdf(
        self, path: str | Path, *, progress: Progress = lambda stage, done, total: None
    ) -> int:
        """Add the facts of a file, all or none, and return how many were new.

        `progress` is called with how many were read; the total is 0, as it is not known.

        Raises
        ------
        WorldError, ValueError
            The file cannot be read, is not of its format, or has a fact that the map does not
            allow; the ending is none of `export_rdf`.
        """
        from semmap.knowledge.rdf_file import format_of, read_facts, reported, store_facts

        file = Path(path)
        facts = reported(read_facts(file, format_of(file)), progress)
        return store_facts(self.connection, facts, file)

    # --- programs that go on

    def push_fields(
        self,
        relations: Mapping[str, str] | Sequence[str] | None = None,
        *,
        perspectives: bool = False,
        seconds: Positive | None = None,
        started: Callable[[list[str]], Any] = lambda relations: None,
    ) -> None:
        """Keep relations of the running service of fields as facts of the map, while this runs.

        Standing queries then see them begin and end.

        Parameters
        ----------
        relations : the property of each relation: ``{"sees": "looksAt"}`` or ``["sees=looksAt"]``
        perspectives : put the objects that an agent sees into its model
        seconds : end after this time; by default when it is interrupted
        started : called with the relations when it has begun

        Raises
        ------
        ValueError
            Nothing is to be pushed, a property is computed already, or no service is running.
        """
        from semmap.fields.service.client import find_service, url_of
        from semmap.knowledge.fields.push import FieldPush, read_pushed

        if not relations and not perspectives:
            raise ValueError("name a relation, such as sees=looksAt, or perspectives=True")
        lines: Sequence[str] = relations or ()  # type: ignore[assignment]
        if isinstance(relations, Mapping):
            lines = [f"{relation}={verb}" for relation, verb in relations.items()]
        pushed = read_pushed(lines, self.name)
        with find_service(url_of(self.database.session), self.name) as service:
            if service is None:
                raise ValueError(
                    f"no service of {self.name} is running: start `semmap fields serve`"
                )
            service.send("watch", seconds=seconds)
            started([*pushed])
            follower = FieldPush(self.engine, self.name, pushed, perspectives=perspectives)
            follower.follow(service.replies(), threading.Event())

    def serve_knowledge(
        self,
        host: str = "127.0.0.1",
        port: int = 6969,
        *,
        files: str | Path | None = None,
        seconds: Positive | None = None,
        stop: threading.Event | None = None,
        started: Callable[[str, int], Any] = lambda host, port: None,
    ) -> None:
        """Answer pykb and other clients of KnowledgeCore by its network protocol, while this runs.

        Whoever reaches the port acts with the rights of the database role of this process.

        Parameters
        ----------
        host : where to listen; by default, this machine alone reaches it
        port : where to listen; 0 chooses a free port
        files : a folder of RDF files that clients may have loaded; by default, none
        seconds : end after this time; by default when `stop` is set
        started : called with the host and the port when it answers

        Raises
        ------
        ValueError
            The address cannot be used.
        """
        from semmap.knowledge.knowledge_core_server import serving

        stop = stop or threading.Event()
        ending = timer(seconds, stop.set)
        try:
            with serving(self, host, port, None if files is None else Path(files)) as chosen:
                started(host, chosen)
                stop.wait()
        finally:
            ending.cancel()


def _refuse_unreasoned(session: Session, inferences: bool) -> None:
    from semmap.knowledge.map_view import MapView
    from semmap.knowledge.reasoning.runs import is_reasoned

    if inferences and not is_reasoned(MapView.of(session)):
        raise ValueError("nothing is inferred from this map: run semmap knowledge reason")
