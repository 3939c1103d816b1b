"""The commands `semmap sparql` and `semmap rdf`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from semmap import cli

# rdflib and SQLAlchemy are slow to import: the functions below import what they use.
if TYPE_CHECKING:
    from semmap.knowledge.map_view import Session
    from semmap.knowledge.queries import Answer
    from semmap.knowledge.reasoning.runs import Reasoned

__all__ = ["knowledge", "rdf", "sparql_command"]

rdf = typer.Typer(no_args_is_help=True, help="Write the map as RDF, and read facts from RDF.")

knowledge = typer.Typer(
    no_args_is_help=True, help="Infer facts, explain contradictions, and validate against shapes."
)

FORMATS = {".ttl": "turtle", ".jsonld": "json-ld", ".trig": "trig", ".nt": "nt", ".nq": "nquads"}
"""Endings of files, with rdflib's names of their formats."""


def sparql_command(
    text: Annotated[
        str, typer.Argument(help="SPARQL 1.1, a file with it, or - for standard input.")
    ],
    update: Annotated[
        bool, typer.Option("--update", help="TEXT is an update: it may change the map.")
    ] = False,
    explain: Annotated[
        bool, typer.Option("--explain", help="Print what is asked of fields, and the SQL.")
    ] = False,
    watch: Annotated[
        bool, typer.Option("--watch", help="Follow the map: print which rows appear and disappear.")
    ] = False,
    seconds: Annotated[
        float | None,
        typer.Option(min=0.001, help="Stop after this time; by default 60, --watch never."),
    ] = None,
    rows: Annotated[int | None, typer.Option(min=1, help="The most rows of an answer.")] = None,
    told: Annotated[
        bool, typer.Option("--told", help="Leave out what semmap knowledge reason inferred.")
    ] = False,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Answer a SPARQL query on the map: facts, geometry and T-Box.

    The prefixes semmap:, prop:, rel:, geo:, geof:, bot:, oro: and the usual ones are declared; the
    empty prefix is that of the map's entities, so that :table1 is the entity table1.
    """
    from semmap.knowledge.queries import query
    from semmap.knowledge.updates import update as update_map

    text = _text(text)
    if watch:
        if update or explain or rows is not None or told:
            raise typer.BadParameter(
                "--watch does not go with --update, --explain, --rows or --told"
            )
        _watch(text, map_name, seconds, json_)
        return
    with _session(map_name, write=update) as session:
        if update:
            changes = update_map(session, text, seconds=seconds)
            if json_:
                cli.print_json({"added": changes.added, "removed": changes.removed})
            else:
                print(f"{changes.added} added, {changes.removed} removed")
            return
        answer = query(session, text, seconds=seconds, rows=rows, inferred=not told)
        known = _prefixes(session)
    for note in answer.notes:
        print(note, file=sys.stderr)
    if explain:
        for part in answer.explanation:
            print(part, file=sys.stderr if json_ else sys.stdout)
        if not json_:
            return
    _show(answer, known, json_)


def _watch(text: str, map_name: str | None, seconds: float | None, json_: bool) -> None:
    """Print events until the time is over, or Ctrl-C."""
    import threading
    from contextlib import suppress

    from semmap.database.reader import as_reader
    from semmap.knowledge.results import event_json, shown
    from semmap.knowledge.standing.subscriptions import Subscriptions
    from semmap.knowledge.vocabulary import prefixes

    engine = cli.engine()
    reader = as_reader(engine)
    with engine.connect() as connection:
        name = cli.choose_map(connection, map_name)
    known = prefixes(name)
    with Subscriptions(reader or engine, name) as standing, suppress(KeyboardInterrupt):
        _, count = standing.add(text)
        print(f"{count} rows now; Ctrl-C stops", file=sys.stderr, flush=True)
        timer = threading.Timer(seconds or 0, standing.close)
        timer.daemon = True
        if seconds is not None:
            timer.start()
        for event in standing.events():
            if json_:
                print(event_json(event.what, event.bindings), flush=True)
            else:
                row = (f"?{n} = {shown(term, known)}" for n, term in event.bindings.items())
                print(f"{event.what}: {', '.join(row) or 'yes'}", flush=True)
        timer.cancel()


def _prefixes(session: Session) -> dict[str, str]:
    from semmap.knowledge.map_view import MapView
    from semmap.knowledge.vocabulary import prefixes

    return prefixes(MapView.of(session).name)


def _show(answer: Answer, known: dict[str, str], json_: bool) -> None:
    from semmap.knowledge.results import shown, sparql_json
    from semmap.knowledge.whole_graph import serialized

    if json_:
        if answer.graph is not None:
            print(serialized(answer.graph, "json-ld"))
        else:
            print(sparql_json(answer))
    elif answer.graph is not None:
        print(serialized(answer.graph, "turtle"), end="")
    elif answer.form == "ASK":
        print("yes" if answer.truth else "no")
    else:
        rows = [tuple(shown(term, known) for term in row) for row in answer.rows]
        cli.show_rows(list(answer.names), rows, False)


def _text(text: str) -> str:
    """Return a text, that of a file, or of standard input."""
    if text == "-":
        return sys.stdin.read()
    if "\n" not in text and len(text) < 1000 and text.endswith((".rq", ".ru", ".sparql")):
        path = Path(text)
        if not path.is_file():
            raise typer.BadParameter(f"there is no file {text}")
        return path.read_text(encoding="utf-8")
    return text


@rdf.command()
def export(
    file: Annotated[
        Path | None, typer.Argument(help=f"Its ending is one of {', '.join(FORMATS)}.")
    ] = None,
    inferences: Annotated[
        bool,
        typer.Option("--inferences", help="Write what semmap knowledge reason inferred, too."),
    ] = False,
    map_name: cli.MapName = None,
) -> None:
    """Write all facts of the map to a file, or as Turtle to standard output.

    Protégé opens the file. Named graphs are written to .trig, .nq and .jsonld: there, inferences
    are in the graph urn:semmap:inferred, else among all facts.
    """
    from semmap.knowledge.map_view import MapView
    from semmap.knowledge.mapping import INFERRED_GRAPH
    from semmap.knowledge.reasoning.runs import is_reasoned
    from semmap.knowledge.whole_graph import dump, has_graphs, serialized

    format_ = "turtle" if file is None else _format(file)
    with _session(map_name) as session:
        if inferences and not is_reasoned(MapView.of(session)):
            raise ValueError("nothing is inferred from this map: run semmap knowledge reason")
        dataset = dump(session, inferences=inferences)
    if inferences and not has_graphs(format_):
        for triple in dataset.graph(INFERRED_GRAPH):
            dataset.default_graph.add(triple)
    written = serialized(dataset, format_)
    if file is None:
        print(written, end="")
    else:
        file.write_text(written, encoding="utf-8")
        print(f"{len(dataset)} facts -> {file}")


@rdf.command("import")
def import_(
    files: Annotated[list[Path], typer.Argument(help=f"Endings: {', '.join(FORMATS)}.")],
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Add the facts of RDF files to the map, each file as a whole or not at all."""
    from semmap.knowledge.rdf_file import read_facts, store_facts

    counts = []
    with _session(map_name, write=True) as session:
        for path in files:
            facts = read_facts(path, _format(path))
            counts.append({"file": str(path), "added": store_facts(session, facts, path)})
    if json_:
        cli.print_json(counts)
        return
    for count in counts:
        print(f"{count['file']}: {count['added']} added")


@rdf.command()
def push(
    relations: Annotated[
        list[str] | None,
        typer.Argument(help="RELATION=PROPERTY, such as sees=looksAt; all others are pulled."),
    ] = None,
    perspectives: Annotated[
        bool, typer.Option("--perspectives", help="Put what an agent sees into its model.")
    ] = False,
    seconds: Annotated[
        float | None, typer.Option(min=0.001, help="Stop after this time; by default never.")
    ] = None,
    map_name: cli.MapName = None,
) -> None:
    """Keep relations of the service of fields as facts of the map; Ctrl-C stops and removes them.

    `semmap sparql --watch` and subscriptions then see them begin and end.
    """
    import threading
    from contextlib import suppress

    from semmap.fields.service.client import find_service
    from semmap.knowledge.fields.push import FieldPush, read_pushed

    if not relations and not perspectives:
        raise typer.BadParameter("name a relation, such as sees=looksAt, or --perspectives")
    engine = cli.engine()
    with engine.connect() as connection:
        name = cli.choose_map(connection, map_name)
    pushed = read_pushed(relations or (), name)
    with find_service(cli.chosen_url(), name) as service:
        if service is None:
            raise ValueError(f"no service of {name} is running: start `semmap fields serve`")
        service.send("watch", seconds=seconds)
        print(f"pushing {', '.join(pushed) or 'perspectives'} of {name}; Ctrl-C stops", flush=True)
        with suppress(KeyboardInterrupt):
            follower = FieldPush(engine, name, pushed, perspectives=perspectives)
            follower.follow(service.replies(), threading.Event())


@rdf.command()
def serve(
    host: Annotated[str, typer.Option(help="The address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535)] = 8890,
    tokens: Annotated[
        Path | None,
        typer.Option(help="A file with a token and its database role in each line."),
    ] = None,
    seconds: Annotated[float, typer.Option(min=0.001, help="Stop a query after this time.")] = 60,
    rows: Annotated[int, typer.Option(min=1, help="The most rows of an answer.")] = 1_000_000,
    map_name: cli.MapName = None,
) -> None:
    """Serve the map by the SPARQL 1.1 protocol: /sparql, /update and /graph.

    Everybody who reaches the address may read; changes need a token.
    """
    try:
        import uvicorn

        from semmap.knowledge.service import SparqlEndpoint, read_tokens, session_opener
    except ModuleNotFoundError as error:
        raise typer.BadParameter(
            f"{error.name} is not installed: pip install 'semmap[knowledge]'"
        ) from None
    from semmap.database.reader import as_reader

    known = {} if tokens is None else read_tokens(tokens)
    engine = cli.engine()
    reader = as_reader(engine)
    with engine.connect() as connection:
        name = cli.choose_map(connection, map_name)
    endpoint = SparqlEndpoint(
        session_opener(reader or engine, name),
        session_opener(engine, name),
        known,
        seconds=seconds,
        rows=rows,
    )
    print(f"map {name}: http://{host}:{port}/sparql", flush=True)
    uvicorn.run(endpoint.app, host=host, port=port, log_level="warning")


@knowledge.command("reason")
def reason_(
    complete: Annotated[
        bool, typer.Option("--complete", help="Read all facts again, whatever changed.")
    ] = False,
    watch: Annotated[
        bool, typer.Option("--watch", help="Follow the map, and infer after each change of it.")
    ] = False,
    off: Annotated[bool, typer.Option("--off", help="Remove all inferences.")] = False,
    seconds: Annotated[
        float | None, typer.Option(min=0.001, help="Stop after this time; --watch never stops.")
    ] = None,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Infer what follows by RDFS and OWL 2 RL; from then on, each update of facts does so, too.

    The exit code is 1 if facts contradict each other.
    """
    from semmap.knowledge.reasoning.runs import forget, reason

    if off and (complete or watch):
        raise typer.BadParameter("--off does not go with --complete or --watch")
    if watch:
        _keep_reasoning(map_name, seconds, json_)
        return
    with _session(map_name, write=True) as session:
        if off:
            forget(session)
            print("no inferences are kept")
            return
        done = reason(session, complete=complete, seconds=seconds)
    _show_run(done, json_)
    if done.contradictions:
        raise typer.Exit(1)


def _show_run(done: Reasoned, json_: bool) -> None:
    if json_:
        cli.print_json(asdict(done))
        return
    what = "all facts read" if done.complete else "changes only"
    print(
        f"{done.inferences:,} inferences, {done.added:,} new, {done.removed:,} removed "
        f"({what}, {done.seconds:.2f} s)"
    )
    if done.contradictions:
        print(f"{done.contradictions:,} contradictions: semmap knowledge contradictions")


def _keep_reasoning(map_name: str | None, seconds: float | None, json_: bool) -> None:
    """Infer after each change, until the time is over, or Ctrl-C."""
    import threading
    from contextlib import suppress

    from semmap.knowledge.reasoning.runs import reason
    from semmap.query.change_feed import ChangeFeed

    engine = cli.engine()
    with engine.connect() as connection:
        name = cli.choose_map(connection, map_name)
    feed, stop = ChangeFeed(engine, name), threading.Event()

    def infer(payloads: tuple[str, ...] | None) -> None:
        if payloads == ():
            return
        with _session(name, write=True) as session:
            done = reason(session)
        if done.complete or done.added or done.removed:
            _show_run(done, json_)
            sys.stdout.flush()

    timer = threading.Timer(seconds or 0, stop.set)
    timer.daemon = True
    if seconds is not None:
        timer.start()
    with suppress(KeyboardInterrupt):
        feed.follow(stop, infer)
    timer.cancel()


@knowledge.command()
def contradictions(map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List which facts contradict which axiom; exit code 1 if any do."""
    from semmap.knowledge.reasoning.runs import contradictions

    with _session(map_name) as session:
        found = contradictions(session)
    if json_:
        keys = ("name", "axiom", "because")
        cli.print_json([dict(zip(keys, each.as_json().values(), strict=True)) for each in found])
    for each in () if json_ else found:
        print(f"{each.fact}: {each.axiom}, but:")
        for because in each.because:
            print("\n".join(because.lines("  ")))
    if found:
        raise typer.Exit(1)


@knowledge.command("why")
def why_(
    fact: Annotated[str, typer.Argument(help="A triple, such as ':cup1 a semmap:Drinkware'.")],
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Explain why a fact is one: the axioms, down to facts that were told."""
    from semmap.knowledge.reasoning.runs import why

    with _session(map_name) as session:
        proof = why(session, fact)
    if json_:
        cli.print_json(proof.as_json())
    elif not proof.axiom:
        print(f"{proof.fact}: told")
    else:
        print("\n".join(proof.lines()))


@knowledge.command("validate")
def validate_(
    shapes: Annotated[
        list[Path] | None,
        typer.Option(help="SHACL in Turtle; by default what a robot's map must have."),
    ] = None,
    seconds: Annotated[float | None, typer.Option(min=0.001, help="Stop after this time.")] = None,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Validate the map against SHACL shapes; exit code 1 if there are violations."""
    from semmap.knowledge.shapes import domain_shapes, read_shapes, validate

    chosen = [read_shapes(path) for path in shapes or ()] or [domain_shapes()]
    with _session(map_name) as session:
        found = validate(session, chosen, seconds=seconds)
    if json_:
        cli.print_json([asdict(each) for each in found])
    else:
        columns = ["severity", "name", "message", "path", "value"]
        rows = [(f.severity, f.name, f.message, f.path, f.value) for f in found]
        cli.show_rows(columns, rows, False)
    if any(each.severity == "violation" for each in found):
        raise typer.Exit(1)


@knowledge.command()
def bind(
    shapes: Annotated[
        Path | None, typer.Argument(help="SHACL in Turtle; without a file, list what binds.")
    ] = None,
    remove: Annotated[
        str | None, typer.Option(metavar="NAME", help="Let these shapes bind no more.")
    ] = None,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Let shapes bind the map: from then on, an update that breaks them is refused as a whole."""
    from semmap.knowledge.map_view import MapView
    from semmap.knowledge.shapes import bind_shapes, binding_shapes, read_shapes, unbind_shapes

    if shapes is not None and remove is not None:
        raise typer.BadParameter("--remove does not go with a file")
    read = None if shapes is None else read_shapes(shapes)
    with _session(map_name, write=True) as session:
        if read is not None:
            bind_shapes(session, read)
        if remove is not None:
            unbind_shapes(session, remove)
        names = [each.name for each in binding_shapes(MapView.of(session))]
    if json_:
        cli.print_json(names)
    else:
        print(f"binding shapes: {', '.join(names) or 'none'}")


def _format(path: Path) -> str:
    known = FORMATS.get(path.suffix.lower())
    if known is None:
        raise typer.BadParameter(
            f"{path}: the ending {path.suffix!r} is not one of {', '.join(FORMATS)}"
        )
    return known


@contextmanager
def _session(map_name: str | None, *, write: bool = False) -> Iterator[Session]:
    """A session that sees the map; of an embedded database, by a login that only reads."""
    import psycopg

    from semmap.database.reader import as_reader

    engine = cli.engine()
    reader = None if write else as_reader(engine)
    try:
        with (reader or engine).connect() as connection:
            cli.choose_map(connection, map_name)
            driver = connection.connection.driver_connection
            assert isinstance(driver, psycopg.Connection)
            driver.commit()  # each query is a transaction of its own
            yield driver
    finally:
        if reader is not None:
            reader.dispose()
