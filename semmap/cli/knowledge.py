"""The commands `semmap sparql`, `semmap rdf` and `semmap knowledge`."""

from __future__ import annotations

import sys
import threading
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from typer import Argument, Option

from semmap.cli.operation_command import MethodCall, command_of, group
from semmap.cli.options import Json
from semmap.cli.output import StageBars, print_json, show_rows, show_table
from semmap.cli.signals import stop_on_signals

# rdflib and SQLAlchemy are slow to import: the functions below import what they use.
if TYPE_CHECKING:
    from semmap.knowledge.answer import Answer
    from semmap.knowledge.reasoning.runs import Reasoned


@command_of("Map.sparql", inferred="--told", plan=None)
def sparql_command(
    call: MethodCall,
    update: bool = Option(False, "--update", help="TEXT is an update: it may change the map."),
    explain: bool = Option(
        False,
        "--explain",
        help="Print a script of psql instead: the SQL, its plan, what fields and rdflib answer.",
    ),
    watch: bool = Option(
        False, "--watch", help="Follow the map: print which rows appear and disappear."
    ),
    json_: Json = False,
) -> None:
    """Answer a SPARQL query on the map: facts, geometry and T-Box.

    TEXT is SPARQL 1.1, a file with it, or - for standard input. The prefixes semmap:, prop:, rel:,
    geo:, geof:, bot:, oro: and the usual ones are declared; the empty prefix is that of the map's
    entities, so that :table1 is the entity table1. --watch never stops without --seconds.
    """
    text, seconds = _text(call.values.pop("text")), call.texts["seconds"]
    if watch and (update or explain or call.texts["rows"] or call.texts["inferred"]):
        raise typer.BadParameter("--watch does not go with --update, --explain, --rows or --told")
    if watch:
        _watch(call, text, json_)
    elif update:
        changes = call.handle.update(text, seconds=seconds)
        if json_:
            print_json({"added": changes.added, "removed": changes.removed})
        else:
            print(f"{changes.added} added, {changes.removed} removed")
    else:
        _show(call(text=text, plan=explain), explain, json_)


def _watch(call: MethodCall, text: str, json_: bool) -> None:
    """Print events until the time is over, or Ctrl-C."""
    from semmap.knowledge.results import event_json, shown
    from semmap.knowledge.vocabulary import prefixes

    known, seconds = prefixes(call.handle.name), call.texts["seconds"]
    with suppress(KeyboardInterrupt), call.handle.watch_sparql(text, seconds=seconds) as events:
        print(f"{events.count} rows now; Ctrl-C stops", file=sys.stderr, flush=True)
        for event in events:
            if json_:
                print(event_json(event.what, event.bindings), flush=True)
            else:
                row = (f"?{n} = {shown(term, known)}" for n, term in event.bindings.items())
                print(f"{event.what}: {', '.join(row) or 'yes'}", flush=True)


def _show(answer: Answer, explain: bool, json_: bool) -> None:
    from semmap.knowledge.results import explained_json, explained_script, shown, sparql_json
    from semmap.knowledge.vocabulary import prefixes
    from semmap.knowledge.whole_graph import serialized

    for note in answer.notes:
        print(note, file=sys.stderr)
    if explain:
        print(explained_json(answer) if json_ else explained_script(answer))
    elif json_ and answer.graph is not None:
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
        show_rows(list(answer.names), rows, False)


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


@command_of("Map.export_rdf", path="[FILE]")
def _export(call: MethodCall) -> None:
    """Write all facts of the map to a file, or as Turtle to standard output.

    Protégé opens the file. Named graphs are written to .trig, .nq and .jsonld: there, inferences
    are in the graph urn:semmap:inferred, else among all facts.
    """
    from semmap.knowledge.whole_graph import serialized

    if "path" in call.values:
        print(f"{call()} facts -> {call.values['path']}")
    else:
        print(serialized(call.handle.graph(**call.values), "turtle"), end="")


@command_of("Map.export_r2rml", path="[FILE]")
def _mapping(call: MethodCall) -> None:
    """Write the mapping of the map to RDF as R2RML to a file, or to standard output.

    Ontop answers SPARQL on the database by the file. Its comments list which properties it lacks.
    """
    if "path" in call.values:
        print(f"{call()} triples maps -> {call.values['path']}")
    else:
        print(call.handle.r2rml(**call.values), end="")


@command_of("Map.import_rdf", path=None, progress=None)
def _import(
    call: MethodCall,
    files: list[Path] = Argument(help="Endings: .ttl, .jsonld, .trig, .nt, .nq, .rdf, .owl."),
    json_: Json = False,
) -> None:
    """Add the facts of RDF files to the map, each file as a whole or not at all."""
    counts = []
    for path in files:
        with StageBars() as bars:
            counts.append({"file": str(path), "added": call(path=path, progress=bars.report)})
    if json_:
        print_json(counts)
        return
    for count in counts:
        print(f"{count['file']}: {count['added']} added")


@command_of("Map.push_fields", relations="[RELATION=PROPERTY]...")
def _push(call: MethodCall) -> None:
    """Keep relations of the service of fields as facts of the map; Ctrl-C stops and removes them.

    `semmap sparql --watch` and subscriptions then see them begin and end. All other relations are
    pulled by queries.
    """

    def say(pushed: list[str]) -> None:
        names = ", ".join(pushed) or "perspectives"
        print(f"pushing {names} of {call.handle.name}; Ctrl-C stops", flush=True)

    with suppress(KeyboardInterrupt):
        call(started=say)


@command_of("Map.reason")
def _reason(
    call: MethodCall,
    watch: bool = Option(False, "--watch", help="Infer after each change of the map."),
    off: bool = Option(False, "--off", help="Remove all inferences."),
    json_: Json = False,
) -> None:
    """Infer what follows by RDFS and OWL 2 RL; from then on, each update of facts does so, too.

    The exit code is 1 if facts contradict each other. --watch never stops without --seconds.
    """
    if off and (call.values["complete"] or watch):
        raise typer.BadParameter("--off does not go with --complete or --watch")
    if watch:
        seconds = call.texts["seconds"]
        with suppress(KeyboardInterrupt):
            call.handle.keep_reasoning(lambda done: _show_run(done, json_), seconds=seconds)
    elif off:
        call.handle.forget_inferences()
        print("no inferences are kept")
    else:
        done = call()
        _show_run(done, json_)
        if done.contradictions:
            raise typer.Exit(1)


def _show_run(done: Reasoned, json_: bool) -> None:
    if json_:
        print_json(asdict(done))
    else:
        what = "all facts read" if done.complete else "changes only"
        print(
            f"{done.inferences:,} inferences, {done.added:,} new, {done.removed:,} removed "
            f"({what}, {done.seconds:.2f} s)"
        )
        if done.contradictions:
            print(f"{done.contradictions:,} contradictions: semmap knowledge contradictions")
    sys.stdout.flush()


@command_of("Map.contradictions")
def _contradictions(call: MethodCall, json_: Json = False) -> None:
    """List which facts contradict which axiom; exit code 1 if any do."""
    found = call()
    if json_:
        keys = ("name", "axiom", "because")
        print_json([dict(zip(keys, each.as_json().values(), strict=True)) for each in found])
    for each in () if json_ else found:
        print(f"{each.fact}: {each.axiom}, but:")
        for because in each.because:
            print("\n".join(because.lines("  ")))
    if found:
        raise typer.Exit(1)


@command_of("Map.why")
def _why(call: MethodCall, json_: Json = False) -> None:
    proof = call()
    if json_:
        print_json(proof.as_json())
    elif not proof.axiom:
        print(f"{proof.fact}: told")
    else:
        print("\n".join(proof.lines()))


@command_of("Map.validate")
def _validate(call: MethodCall, json_: Json = False) -> None:
    """Validate the map against SHACL shapes; exit code 1 if there are violations."""
    found = [asdict(each) for each in call()]
    show_table(found, json_, ("severity", "name", "message", "path", "value"))
    if any(each["severity"] == "violation" for each in found):
        raise typer.Exit(1)


@command_of("Map.bind_shapes", path="[SHAPES]")
def _bind(
    call: MethodCall,
    remove: str | None = Option(None, metavar="NAME", help="Let these shapes bind no more."),
    json_: Json = False,
) -> None:
    """Let shapes bind the map: from then on, an update that breaks them is refused as a whole.

    Without a file, list which shapes bind.
    """
    if "path" in call.values and remove is not None:
        raise typer.BadParameter("--remove does not go with a file")
    if "path" in call.values:
        call()
    if remove is not None:
        call.handle.unbind_shapes(remove)
    names = call.handle.binding_shapes
    if json_:
        print_json(names)
    else:
        print(f"binding shapes: {', '.join(names) or 'none'}")


@command_of("Map.serve_knowledge")
def _serve(call: MethodCall) -> None:
    """Serve the map by KnowledgeCore's protocol, to pykb and other clients; Ctrl-C stops.

    Clients act with the rights of the database role of this command: the protocol has no password.
    """
    stop = threading.Event()

    def started(host: str, port: int) -> None:
        stop_on_signals(stop)
        print(f"serving {call.handle.name} on {host}:{port}; Ctrl-C stops", flush=True)

    call(stop=stop, started=started)


rdf_command = group(_export, _mapping, _import, _push)
knowledge_command = group(_reason, _contradictions, _why, _validate, _bind, _serve)
