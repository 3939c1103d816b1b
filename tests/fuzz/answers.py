"""What other programs give and get: recordings, settings, statements, standing queries, exports."""

from __future__ import annotations

import json
import re
import socket
import threading
import zipfile
from collections.abc import Sequence
from contextlib import closing, suppress
from functools import cache, partial
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

import numpy as np
from mcap.writer import CompressionType, Writer

import semmap
from semmap.limits import NO_CHARACTER
from tests.fields.service.ros_recordings import TYPES, transforms
from tests.fuzz.kind import Kind
from tests.fuzz.mutate import WORDS, bytes_of, lines_of, words_of, yaml_tree
from tests.fuzz.server import case_map, import_case, loft
from tests.fuzz.stored_knowledge import EXTRA, SECONDS, new_query
from tests.knowledge.test_query import QUERIES
from tests.planner.search.pomdp_reader import read_pomdp

NAMES = {"room": "hall", "other": "bath 2", "door": "door/1", "cup": "cup 1", "type": "Tasse"}
"""The names of a small map; `type` is the label of its cup."""


def house_of(names: dict[str, str]) -> str:
    """GeoJSON of two rooms, a door and a cup of these names."""

    def square(x: float, y: float, side: float) -> list[list[list[float]]]:
        return [[[x, y], [x + side, y], [x + side, y + side], [x, y + side], [x, y]]]

    shapes = (
        ("room", names["room"], "room", square(0, 0, 4)),
        ("room", names["other"], "bathroom", square(4, 0, 4)),
        ("connector", names["door"], "door", [[4, 1], [4, 2]]),
        ("object", names["cup"], "cup", square(1, 1, 0.2)),
    )
    features = [
        {
            "type": "Feature",
            "geometry": {
                "type": "LineString" if kind == "connector" else "Polygon",
                "coordinates": coordinates,
            },
            "properties": {"kind": kind, "name": name, "type": type_, "height": 0.1}
            | ({"label": names["type"]} if kind == "object" else {}),
        }
        for kind, name, type_, coordinates in shapes
    ]
    return json.dumps({"type": "FeatureCollection", "features": features})


def odd_names(random: Random, seed: bytes, _: Sequence[bytes]) -> bytes:
    """Names of words that are marks in a format."""
    names = json.loads(seed)
    for key in random.sample([*names], random.choice((1, 2, 5))):
        names[key] = "".join(random.choice((*WORDS, "é", "x")) for _ in range(3))
    return json.dumps(names).encode()


def run_names(data: bytes, folder: Path) -> None:
    names = json.loads(data)
    file = folder / "case.geojson"
    file.write_text(house_of(names))
    with case_map(file) as house:
        # An object whose name or label has a character that no text has is left out.
        assert len(house.objects) == (not NO_CHARACTER.search(names["cup"] + names["type"]))
        check_exports(house, folder)


def check_exports(house: semmap.Map, folder: Path) -> None:
    """Each program reads its export: the files are well-formed, and have all names."""
    house.write_topology(folder / "a.dot")
    quotes = (folder / "a.dot").read_text("utf-8").replace("\\\\", "").replace('\\"', "")
    assert quotes.count('"') % 2 == 0
    for ending in (".svg", ".gml", ".sdf", ".geojson", ".yaml", ".glb"):
        file = folder / f"out{ending}"
        house.draw().save(file) if ending == ".svg" else house.export(file)
        if ending in (".svg", ".gml", ".sdf"):
            ElementTree.parse(file)
    house.write_qgis_project(folder / "a.qgz")
    with zipfile.ZipFile(folder / "a.qgz") as packed:
        for name in packed.namelist():
            ElementTree.fromstring(packed.read(name))
    for cup in house.objects:
        house.export_belief([cup.name])
        search = house.search(cup.name, start=next(iter(house.rooms)).name)
        read_pomdp(search.write_pomdp(folder / "a.pomdp"))


def run_client(data: bytes, _: Path) -> None:
    """What a client of KnowledgeCore says: statements, a blank line, and patterns."""
    stated, _, asked = data.decode("utf-8", "replace").partition("\n\n")
    with loft().knowledge_client() as client:
        try:
            client.add(stated.split("\n"), model="fuzz")
            client.find("who", asked.split("\n"), model="fuzz")
        finally:
            client.retract("?s ?p ?o", model="fuzz")


CLIENT = b"""ann likes coffee
ann age 3
table label "a table"@en

?who likes coffee
?who age ?what"""


def run_standing(data: bytes, _: Path) -> None:
    """Follow a query, and answer it twice: the second answer is of its kept translation."""
    text = data.decode("utf-8", "replace")
    first = loft().sparql(text, seconds=SECONDS, rows=1000)
    again = loft().sparql(text, seconds=SECONDS, rows=1000)
    assert len(first.rows) == len(again.rows)
    with closing(loft().watch_sparql(text)) as live:
        assert live.count >= 0


def serve(**settings: object) -> None:
    """Run the service of fields for a moment."""
    loft().fields.with_voxel_size(0.2).serve(seconds=0.01, **settings)


LINES = b"""{"do": "hello", "map": "loft"}
{"do": "query", "text": "SELECT * { ?a ?b ?c }"}
{"do": "at", "point": [1, 2, 0.5]}
{"do": "ls"}
{"do": "percept", "name": "people", "percept": {"people": {"ann": {"x": 1.0, "y": 2.0}}}}
{"do": "start", "name": "gaze", "percepts": "socket", "rate": 5}
{"do": "watch", "seconds": 0.01}
{"do": "stop", "name": "gaze"}
"""


def deep_line(random: Random, seed: bytes, others: Sequence[bytes]) -> bytes:
    """Requests of which one is nested deeply, has a number of many digits, or has no end."""
    lines = seed.splitlines(keepends=True)
    at = random.randrange(len(lines))
    depth = int(10 ** random.uniform(0, 5))
    value = random.choice((b"[" * depth, b"[" * depth + b"]" * depth, b"9" * depth, b"-1e999"))
    lines[at] = re.sub(
        rb": [^{}]+?([,}])", rb": %b\1" % value, lines[at], count=random.randrange(3)
    )
    return b"".join(lines).removesuffix(random.choice((b"", b"\n", b'"}\n')))


def run_lines(data: bytes, _: Path) -> None:
    """Send lines to the service of fields; afterwards it answers another client."""
    stop = threading.Event()

    def talk(_: str, path: Path, __: list[str]) -> None:
        for line in replies(path, data):
            assert json.loads(line).keys() <= {"reply", "error"}
        (hello,) = replies(path, b'{"do": "hello"}\n')
        assert json.loads(hello)["reply"]["map"] == "loft"
        stop.set()

    fields = loft().fields.with_voxel_size(0.2)
    fields.serve(sources=["people=socket"], stop=stop, started=talk)


def replies(path: Path, data: bytes) -> list[bytes]:
    """The lines that the service answers; it may follow events for ever."""
    found = b""
    with socket.socket(socket.AF_UNIX) as channel, suppress(TimeoutError, BrokenPipeError):
        channel.settimeout(1)
        channel.connect(str(path))
        channel.sendall(data)
        channel.shutdown(socket.SHUT_WR)
        while more := channel.recv(2**16):
            found += more
    return found.splitlines()


def percept_lines() -> list[bytes]:
    """A recording of people."""
    people = [{"ann": {"x": 0.1 * n, "y": 2, "yaw": 1}} for n in range(4)]
    return [
        b"".join(
            json.dumps({"time": f"2026-01-31T12:00:0{n}Z", "people": each}).encode() + b"\n"
            for n, each in enumerate(people)
        )
    ]


def run_percepts(data: bytes, folder: Path) -> None:
    (folder / "people.jsonl").write_bytes(data)
    serve(sources=[f"people=recording:{folder}"])


def run_settings(data: bytes, folder: Path) -> None:
    (folder / "settings.yaml").write_bytes(data)
    serve(config=folder / "settings.yaml")


SETTINGS = b"""
save_every: 5
sources:
  gaze: {source: gaze, percepts: socket, rate: 5, timeout: 2}
  people: {percepts: socket, options: {}}
"""


def recordings() -> list[bytes]:
    """A gaze in MCAP, packed in each way."""
    found = []
    message = transforms(("map", "gaze_ann", np.eye(4)))
    kind = message.__msgtype__
    text, _ = TYPES.generate_msgdef(kind, ros_version=2)
    with TemporaryDirectory() as folder:
        for packing in CompressionType:
            file = Path(folder, packing.name)
            with file.open("wb") as stream:
                writer = Writer(stream, compression=packing)
                writer.start()
                schema = writer.register_schema(kind, "ros2msg", text.encode())
                channel = writer.register_channel("/tf", "cdr", schema)
                data = TYPES.serialize_cdr(message, kind)
                for time in range(3):
                    writer.add_message(channel, time, data, time)
                writer.finish()
            found.append(file.read_bytes())
    return found


def run_recording(data: bytes, folder: Path) -> None:
    (folder / "case.mcap").write_bytes(data)
    serve(sources=[f"gaze=mcap:{folder / 'case.mcap'}"])


@cache
def exported(ending: str) -> list[bytes]:
    """The house in a format."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "case.geojson").write_text(house_of(NAMES))
        with case_map(folder / "case.geojson") as house:
            return [house.export(folder / f"out{ending}").read_bytes()]


def run_import(ending: str, data: bytes, folder: Path) -> None:
    (folder / f"case{ending}").write_bytes(data)
    import_case(folder / f"case{ending}")


TEXT = [words_of, words_of, bytes_of, lines_of]

ANSWER_KINDS = [
    Kind("names", lambda: [json.dumps(NAMES).encode()], [odd_names], run_names),
    Kind("client", lambda: [CLIENT], TEXT, run_client),
    Kind(
        "standing query",
        lambda: [(EXTRA + text).encode() for text in QUERIES if "SELECT" in text],
        [*TEXT, *[new_query] * 6],
        run_standing,
    ),
    Kind("settings", lambda: [SETTINGS], [*TEXT, yaml_tree], run_settings),
    Kind("fields socket", lambda: [LINES], [*TEXT, deep_line, deep_line], run_lines),
    Kind("percepts", percept_lines, [*TEXT, deep_line], run_percepts),
    Kind("recording", recordings, [bytes_of], run_recording),
    Kind(
        "geopackage", partial(exported, ".gpkg"), [bytes_of, words_of], partial(run_import, ".gpkg")
    ),
]
