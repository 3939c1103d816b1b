"""The processes that are killed, and the checks after each kill."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random

import psycopg
from sqlalchemy import Engine

import semmap
from semmap.database import Cluster, open_engine
from semmap.database.leftovers import servers_in
from semmap.ingest.importer import import_file
from tests.soak.actors import IMPORTED
from tests.soak.invariants import (
    last_line,
    signature,
    url_of,
    violations,
    wrong_cursors,
    wrong_follower,
    wrong_mirror,
    wrong_service,
    wrong_statements,
)
from tests.soak.power import copy_pages, cut, log_position, small_buffers

ROOT = Path(__file__).parents[2]
OFFICE = [ROOT / "examples/office" / name for name in ("office_rooms.geojson", "office.sdf")]
MIRRORED = "soaked"
"""The map that writers change and the mirror follows."""

STATERS = "stater", "http_writer"
"""The actors whose numbers the follower follows."""

THREADS = 10
"""Writers in one process."""

BUSY = """
SELECT pid FROM pg_stat_activity WHERE backend_type = 'client backend' AND state = 'active'
AND pid <> pg_backend_pid() AND coalesce(wait_event_type, '') NOT IN ('Lock', 'Client')
"""
"""Sessions that may end what they do while all clients are stopped."""

PAUSE = 0.5
"""Seconds between two kills, at most."""


def is_running(process: subprocess.Popen[bytes]) -> bool:
    """Return whether a thread of a process goes on: on a busy machine they stop one by one."""
    for thread in Path(f"/proc/{process.pid}/task").glob("*/stat"):
        with suppress(FileNotFoundError, ProcessLookupError):  # it ended
            state = thread.read_text().rpartition(")")[2].split()[0]
            if state not in "TtZX":
                return True
    return False


@dataclass
class Actor:
    """A process, and how it is started again."""

    name: str
    arguments: Sequence[object]
    process: subprocess.Popen[bytes] | None = None


class Soak:
    """A cluster with processes that work on it.

    Parameters
    ----------
    cluster : an embedded one, of this object alone
    folder : for what the processes store
    worlds : files that make the map
    seed : which process is killed, and when
    """

    def __init__(self, cluster: Cluster, folder: Path, worlds: Sequence[Path], seed: int) -> None:
        self.cluster, self.worlds = cluster, worlds
        self.state = folder / "state"
        self.state.mkdir()
        self.wrong: list[str] = []
        self.killed: Counter[str] = Counter()
        self.longest = 0.0
        self.moves = 0
        self._actors: list[Actor] = []
        self._stated: Sequence[str] = ()
        self._versions: set[str] = set()
        self._before: list[str] = []
        self._draw = Random(seed)

    def prepare(self, writers: int, readers: int) -> None:
        """Import the map and start all processes."""
        engine = open_engine(self.cluster)
        for world in self.worlds:
            import_file(engine, world, map_name=MIRRORED)
        files = [boxes(self.state / f"boxes{i}.sdf", range(5 * i, 20 + 5 * i)) for i in range(2)]
        for file in (*files, *files):
            import_file(engine, file, map_name=IMPORTED, source="versions")
            with engine.connect() as connection:
                self._versions.add(signature(connection, IMPORTED))
        with engine.connect() as connection:
            chosen = connection.exec_driver_sql(
                "SELECT e.id, e.name FROM entity e JOIN map m ON m.id = e.map_id AND m.name = %s "
                "JOIN placement p ON p.entity_id = e.id WHERE e.kind = 'object' "
                "ORDER BY p.relation = 'on' DESC, e.id LIMIT %s",
                (MIRRORED, writers),
            )
            entities, names = zip(*chosen, strict=True)
            rooms = connection.exec_driver_sql(
                "SELECT e.name FROM entity e JOIN map m ON m.id = e.map_id AND m.name = %s "
                "WHERE e.kind = 'room' ORDER BY e.id LIMIT 3",
                (MIRRORED,),
            ).scalars()
        engine.dispose()
        self._before = self._check()
        self._stated = names[:2]
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        self._actors = [
            *(Actor("writer", entities[i : i + THREADS]) for i in range(0, len(entities), THREADS)),
            Actor("importer", files),
            Actor("importer", files),
            Actor("poller", ()),
            Actor("mirror", (MIRRORED,)),
            Actor("service", (MIRRORED,)),
            Actor("stater", (MIRRORED, names[0])),
            Actor("http_server", (port,)),
            Actor("http_writer", (MIRRORED, names[1], port)),
            Actor("follower", (MIRRORED,)),
            Actor("observer", (MIRRORED, names[2], *rooms)),
            *(Actor("reader", ()) for _ in range(readers)),
        ]
        for actor in self._actors:
            self._start(actor)
        self._wait_for_writes()

    def kill(self, victim: str | None = None) -> str:
        """Kill a process at a random moment, check the map, and start it again."""
        self._wait_for_writes()
        time.sleep(self._draw.uniform(0, PAUSE))
        chosen = self._draw.choice([None, None, *self._actors])
        actors: dict[str, Actor | None] = {a.name: a for a in self._actors} | {"server": None}
        actor = actors[victim] if victim else chosen
        name = "server" if actor is None else actor.name
        if actor is None:
            self._kill_server()
        else:
            self._end(actor)
        self.killed[name] += 1
        start = time.monotonic()
        engine = open_engine(self.cluster, migrate=False)  # as the next command does
        self.longest = max(self.longest, time.monotonic() - start)
        found = self._violations(engine)
        if actor is not None:
            self._start(actor)
        if name in ("server", "follower"):
            with self._paused(STATERS):
                found += wrong_follower(engine, MIRRORED, self.state / "follower")
        engine.dispose()
        found += self._ended()
        self.wrong += [f"after the kill of the {name}: {each}" for each in found]
        return f"{name}: {'; '.join(found) or 'ok'}"

    def work(self, name: str, seconds: float) -> str:
        """Let all processes work for some time, and check the map."""
        time.sleep(seconds)
        self._wait_for_writes()
        engine = open_engine(self.cluster, migrate=False)
        found = self._violations(engine) + self._ended()
        engine.dispose()
        self.wrong += [f"{name}: {each}" for each in found]
        return f"{name}: {'; '.join(found) or 'ok'}"

    def _violations(self, engine: Engine) -> list[str]:
        found = violations(engine, self.state, IMPORTED, self._versions)
        found += wrong_service(engine, MIRRORED, self.state / "service")
        return found + wrong_statements(engine, MIRRORED, self.state)

    def use_small_buffers(self) -> None:
        """Restart the server, so that it writes changed pages soon."""
        self.close()
        small_buffers(self.cluster)
        for actor in self._actors:
            self._start(actor)

    def cut_power(self) -> str:
        """Cut the power after some work: pages in part, no log but what was flushed; check."""
        copy, url = self.state / "pages", url_of(open_engine(self.cluster, migrate=False))
        with psycopg.connect(url, autocommit=True) as connection:
            with self._paused():
                connection.execute("CHECKPOINT")
                begin = log_position(connection)[1]
                copy_pages(self.cluster.data, copy)
            self._wait_for_writes()
            time.sleep(self._draw.uniform(0, 4 * PAUSE))
            with self._paused():
                while connection.execute(BUSY).fetchone():
                    time.sleep(0.01)  # of what ends later, the clients would have the answers
                flushed, newest = log_position(connection)
                self._kill_server()
                while servers_in(self.cluster.data):
                    time.sleep(0.01)
                torn = 0
                if newest == begin:  # else pages that were flushed since are not known
                    torn = cut(self.cluster.data, copy, flushed, self._draw)
        shutil.rmtree(copy)
        self.killed["power"] += 1
        engine = open_engine(self.cluster, migrate=False)
        found = violations(engine, self.state, IMPORTED, self._versions) + self._ended()
        found += wrong_statements(engine, MIRRORED, self.state)
        engine.dispose()
        self.wrong += [f"after a power cut: {each}" for each in found]
        return f"power, {torn} pages torn: {'; '.join(found) or 'ok'}"

    @contextmanager
    def _paused(self, names: Sequence[str] = ()) -> Iterator[None]:
        """Stop processes, by default all: none has an answer of the server that is not stored."""
        chosen = [each for each in self._actors if not names or each.name in names]
        stopped = [each.process for each in chosen if each.process is not None]
        for process in stopped:
            process.send_signal(signal.SIGSTOP)
        while any(map(is_running, stopped)):
            time.sleep(0.01)
        yield
        for process in stopped:
            process.send_signal(signal.SIGCONT)

    def finish(self) -> None:
        """End all processes, and check what they stored."""
        self._wait_for_writes()
        self.wrong += self._ended()
        with self._paused(STATERS):
            engine = open_engine(self.cluster, migrate=False)
            self.wrong += wrong_follower(engine, MIRRORED, self.state / "follower")
            engine.dispose()
        self.close()
        self.moves = sum(int(last_line(file) or 0) for file in self.state.glob("writer-*"))
        self.wrong += self.look()
        if (after := self._check()) != self._before:
            self.wrong.append(f"semmap check: {sorted(set(after) - set(self._before))[:5]}")

    def look(self) -> list[str]:
        """What is wrong with the map, the stored mirror and the stored cursor."""
        engine = open_engine(self.cluster, migrate=False)
        wrong = self._violations(engine) + wrong_mirror(engine, MIRRORED)
        with psycopg.connect(url_of(engine), options="-c search_path=semmap,public") as connection:
            wrong += wrong_cursors(connection, self.state / "poller")
        engine.dispose()
        return wrong

    def close(self) -> None:
        """End all processes."""
        for actor in self._actors:
            self._end(actor)

    def table(self) -> str:
        """What was killed, and what went wrong."""
        lines = [f"{name:10}{number:>6} kills" for name, number in sorted(self.killed.items())]
        lines.append(
            f"{self.moves:,} committed moves; the next command waited {self.longest:.1f} s at most"
        )
        lines += dict.fromkeys(self.wrong) or ["nothing was lost, half done or wrong"]
        return "\n".join(lines)

    def _ended(self) -> list[str]:
        """The processes that ended although nobody killed them; they start again."""
        ended = [a for a in self._actors if a.process and a.process.poll() is not None]
        for actor in ended:
            self._start(actor)
        return [f"the {actor.name} ended by itself" for actor in ended]

    def _check(self) -> list[str]:
        url = self.cluster.ensure().render_as_string(hide_password=False)
        with semmap.connect(url) as db:
            found = (each for name in (MIRRORED, IMPORTED) for each in db.map(name).check())
            return [str(each) for each in found if each.severity == "error"]

    def _kill_server(self) -> None:
        pid = int((self.cluster.data / "postmaster.pid").read_text().split()[0])
        os.kill(pid, signal.SIGKILL)

    def _start(self, actor: Actor) -> None:
        command = [sys.executable, "-m", "tests.soak.actors", actor.name, self.cluster.home]
        actor.process = subprocess.Popen(
            [str(each) for each in (*command, self.state, *actor.arguments)], cwd=ROOT
        )

    def _end(self, actor: Actor) -> None:
        if actor.process is not None:
            actor.process.kill()
            actor.process.wait()
            actor.process = None

    def _wait_for_writes(self) -> None:
        """Until each process had its time to work."""
        deadline = time.monotonic() + 300  # all load their modules first
        before = {file: last_line(file) for file in self.state.glob("writer-*")}
        others = [self.state / name for name in ("poller", "service", "follower", "observed")]
        others += [self.state / f"stated-{name}" for name in self._stated]
        while not all(file.exists() for file in others) or not any(
            last_line(file) != before.get(file) for file in self.state.glob("writer-*")
        ):
            late = [file.name for file in others if not file.exists()] or "writers"
            assert time.monotonic() < deadline, f"an actor does not come to work: {late}"
            time.sleep(0.1)


def boxes(file: Path, numbers: range) -> Path:
    """A world file of boxes beside each other."""
    models = "".join(
        f'<model name="box{i}"><static>true</static><pose>{i} {len(numbers)} 0 0 0 0</pose>'
        '<link name="l"><visual name="v"><geometry><box><size>0.4 0.4 0.4</size></box></geometry>'
        "</visual></link></model>"
        for i in numbers
    )
    file.write_text(f'<sdf version="1.7"><world name="boxes">{models}</world></sdf>')
    return file
