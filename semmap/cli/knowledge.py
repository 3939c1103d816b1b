"""The commands `semmap sparql`, `semmap rdf` and `semmap knowledge`."""

from __future__ import annotations

import sys
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from typer import Argument, Option

from semmap import cli

# rdflib and SQLAlchemy are slow to import: the functions below import what they use.
if TYPE_CHECKING:
    from semmap.knowledge.answer import Answer
    from semmap.knowledge.reasoning.runs import Reasoned

rdf = typer.Typer(no_args_is_help=True, help="Write the map as RDF, and read facts from RDF.")

knowledge = typer.Typer(
    no_args_is_help=True, help="Infer facts, explain contradictions, and validate against shapes."
)

ENDINGS = ".ttl, .jsonld, .trig, .nt, .nq"


def sparql_command(
    text: str = Argument(help="SPARQL 1.1, a file with it, or - for standard input."),
    update: bool = Option(False, "--update", help="TEXT is an update: it may change the map."),
    explain: bool = Option(False, "--explain", help="Print what is asked of fields, and the SQL."),
    watch: bool = Option(
        False, "--watch", help="Follow the map: print which rows appear and disappear."
    ),
    seconds: float | None = Option(
        None, min=0.001, help="Stop after this time; by default 60, --watch never."
    ),
    rows: int | None = Option(None, min=1, help="The most rows of an answer."),
    told: bool = Option(False, "--told", help="Leave out what semmap knowledge reason inferred."),
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Answer a SPARQL query on the map: facts, geometry and T-Box.

    The prefixes semmap:, prop:, rel:, geo:, geof:, bot:, oro: and the usual ones are declared; the
    empty prefix is that of the map's entities, so that :table1 is the entity table1.
    """
    text = _text(text)
    if watch and (update or explain or rows is not None or told):
        raise typer.BadParameter("--watch does not go with --update, --explain, --rows or --told")
    if watch:
        _watch(text, map_name, seconds, json_)
    elif update:
        with cli.chosen_map(map_name) as chosen:
            changes = chosen.update(text, seconds=seconds)
        if json_:
            cli.print_json({"added": changes.added, "removed": changes.removed})
        else:
            print(f"{changes.added} added, {changes.removed} removed")
    else:
        with cli.chosen_map(map_name) as chosen:
            answer = chosen.sparql(text, seconds=seconds, rows=rows, inferred=not told)
        _show(answer, explain, json_)


def _watch(text: str, map_name: str | None, seconds: float | None, json_: bool) -> None:
    """Print events until the time is over, or Ctrl-C."""
    from semmap.knowledge.results import event_json, shown
    from semmap.knowledge.vocabulary import prefixes

    with (
        cli.chosen_map(map_name) as chosen,
        suppress(KeyboardInterrupt),
        chosen.watch_sparql(text, seconds=seconds) as events,
    ):
        known = prefixes(chosen.name)
        print(f"{events.count} rows now; Ctrl-C stops", file=sys.stderr, flush=True)
        for event in events:
            if json_:
                print(event_json(event.what, event.bindings), flush=True)
            else:
                row = (f"?{n} = {shown(term, known)}" for n, term in event.bindings.items())
                print(f"{event.what}: {', '.join(row) or 'yes'}", flush=True)


def _show(answer: Answer, explain: bool, json_: bool) -> None:
    from semmap.knowledge.results import shown, sparql_json
    from semmap.knowledge.vocabulary import prefixes
    from semmap.knowledge.whole_graph import serialized

    for note in answer.notes:
        print(note, file=sys.stderr)
    for part in answer.explanation if explain else ():
        print(part, file=sys.stderr if json_ else sys.stdout)
    if explain and not json_:
        return
    if json_ and answer.graph is not None:
        print(serialized(answer.graph, "json-ld"))
    elif json_:
        print(sparql_json(answer))
    elif answer.graph is not None:
        print(serialized(answer.graph, "turtle"), end="")
    elif answer.form == "ASK":
        print("yes" if answer.truth else "no")
    else:
        known = prefixes(answer.map_name)
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
    file: Path | None = Argument(None, help=f"Its ending is one of {ENDINGS}."),
    inferences: bool = Option(
        False, "--inferences", help="Write what semmap knowledge reason inferred, too."
    ),
    map_name: cli.MapName = None,
) -> None:
    """Write all facts of the map to a file, or as Turtle to standard output.

    Protégé opens the file. Named graphs are written to .trig, .nq and .jsonld: there, inferences
    are in the graph urn:semmap:inferred, else among all facts.
    """
    from semmap.knowledge.whole_graph import serialized

    with cli.chosen_map(map_name) as chosen:
        if file is None:
            print(serialized(chosen.graph(inferences=inferences), "turtle"), end="")
        else:
            print(f"{chosen.export_rdf(file, inferences=inferences)} facts -> {file}")


@rdf.command("import")
def import_(
    files: list[Path] = Argument(help=f"Endings: {ENDINGS}."),
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Add the facts of RDF files to the map, each file as a whole or not at all."""
    with cli.chosen_map(map_name) as chosen:
        counts = [{"file": str(path), "added": chosen.import_rdf(path)} for path in files]
    if json_:
        cli.print_json(counts)
        return
    for count in counts:
        print(f"{count['file']}: {count['added']} added")


@rdf.command()
def push(
    relations: list[str] | None = Argument(
        None, help="RELATION=PROPERTY, such as sees=looksAt; all others are pulled."
    ),
    perspectives: bool = Option(
        False, "--perspectives", help="Put what agents see into their models."
    ),
    seconds: float | None = Option(None, min=0.001, help="Stop after this time; by default never."),
    map_name: cli.MapName = None,
) -> None:
    """Keep relations of the service of fields as facts of the map; Ctrl-C stops and removes them.

    `semmap sparql --watch` and subscriptions then see them begin and end.
    """
    if not relations and not perspectives:
        raise typer.BadParameter("name a relation, such as sees=looksAt, or --perspectives")

    with cli.chosen_map(map_name) as chosen, suppress(KeyboardInterrupt):

        def say(pushed: list[str]) -> None:
            names = ", ".join(pushed) or "perspectives"
            print(f"pushing {names} of {chosen.name}; Ctrl-C stops", flush=True)

        chosen.push_fields(relations, perspectives=perspectives, seconds=seconds, started=say)


@rdf.command()
def serve(
    host: str = Option("127.0.0.1", help="The address to listen on."),
    port: int = Option(8890, min=0, max=65535),
    tokens: Path | None = Option(None, help="A file: a token and its database role a line."),
    seconds: float = Option(60, min=0.001, help="Stop a query after this time."),
    rows: int = Option(1_000_000, min=1, help="The most rows of an answer."),
    map_name: cli.MapName = None,
) -> None:
    """Serve the map by the SPARQL 1.1 protocol: /sparql, /update and /graph.

    Everybody who reaches the address may read; changes need a token.
    """
    with cli.chosen_map(map_name) as chosen:

        def say(url: str) -> None:
            print(f"map {chosen.name}: {url}", flush=True)

        chosen.serve_sparql(host, port, tokens=tokens, seconds=seconds, rows=rows, started=say)


@knowledge.command("reason")
def reason_(
    complete: bool = Option(False, "--complete", help="Read all facts again, whatever changed."),
    watch: bool = Option(False, "--watch", help="Infer after each change of the map."),
    off: bool = Option(False, "--off", help="Remove all inferences."),
    seconds: float | None = Option(
        None, min=0.001, help="Stop after this time; --watch never stops."
    ),
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Infer what follows by RDFS and OWL 2 RL; from then on, each update of facts does so, too.

    The exit code is 1 if facts contradict each other.
    """
    if off and (complete or watch):
        raise typer.BadParameter("--off does not go with --complete or --watch")
    with cli.chosen_map(map_name) as chosen:
        if watch:
            with suppress(KeyboardInterrupt):
                chosen.keep_reasoning(lambda done: _show_run(done, json_), seconds=seconds)
            return
        if off:
            chosen.forget_inferences()
            print("no inferences are kept")
            return
        done = chosen.reason(complete=complete, seconds=seconds)
    _show_run(done, json_)
    if done.contradictions:
        raise typer.Exit(1)


def _show_run(done: Reasoned, json_: bool) -> None:
    if json_:
        cli.print_json(asdict(done))
    else:
        what = "all facts read" if done.complete else "changes only"
        print(
            f"{done.inferences:,} inferences, {done.added:,} new, {done.removed:,} removed "
            f"({what}, {done.seconds:.2f} s)"
        )
        if done.contradictions:
            print(f"{done.contradictions:,} contradictions: semmap knowledge contradictions")
    sys.stdout.flush()


@knowledge.command()
def contradictions(map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List which facts contradict which axiom; exit code 1 if any do."""
    with cli.chosen_map(map_name) as chosen:
        found = chosen.contradictions()
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
    fact: str = Argument(help="A triple, such as ':cup1 a semmap:Drinkware'."),
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Explain why a fact is one: the axioms, down to facts that were told."""
    with cli.chosen_map(map_name) as chosen:
        proof = chosen.why(fact)
    if json_:
        cli.print_json(proof.as_json())
    elif not proof.axiom:
        print(f"{proof.fact}: told")
    else:
        print("\n".join(proof.lines()))


@knowledge.command("validate")
def validate_(
    shapes: list[Path] | None = Option(
        None, help="SHACL in Turtle; by default what a robot's map must have."
    ),
    seconds: float | None = Option(None, min=0.001, help="Stop after this time."),
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Validate the map against SHACL shapes; exit code 1 if there are violations."""
    with cli.chosen_map(map_name) as chosen:
        found = chosen.validate(shapes, seconds=seconds)
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
    shapes: Path | None = Argument(None, help="SHACL in Turtle; without a file, list what binds."),
    remove: str | None = Option(None, metavar="NAME", help="Let these shapes bind no more."),
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Let shapes bind the map: from then on, an update that breaks them is refused as a whole."""
    if shapes is not None and remove is not None:
        raise typer.BadParameter("--remove does not go with a file")
    with cli.chosen_map(map_name) as chosen:
        if shapes is not None:
            chosen.bind_shapes(shapes)
        if remove is not None:
            chosen.unbind_shapes(remove)
        names = chosen.binding_shapes
    if json_:
        cli.print_json(names)
    else:
        print(f"binding shapes: {', '.join(names) or 'none'}")
