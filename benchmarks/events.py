"""A move of one of 10,000 objects until clients (Python, HTTP, MCP, ROS 2, the viewer) hear it."""

from __future__ import annotations

import json
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from pathlib import Path
from queue import SimpleQueue

import httpx
import numpy as np
from anyio.from_thread import start_blocking_portal
from mcp import StdioServerParameters
from mcp.client import Client
from mcp.client.stdio import stdio_client
from mcp.shared.subscriptions import ResourceUpdated

import semmap
from benchmarks.inventory import building, stored
from benchmarks.timing import Row, print_rows
from tests.browser import SIZE, chromium, open_viewer
from tests.ros.conftest import new_environment, run
from tests.ros_python import ROS_PYTHON
from tests.served import served

Follow = Callable[[semmap.Database, Callable[[str], None]], AbstractContextManager[None]]

SEMMAP = Path(sys.executable).with_name("semmap")

MOVES = 200
OPENED = 5.0
"""Seconds within which the viewer shows a map."""

LIMIT = 200
"""Milliseconds within which 99 of 100 moves are heard of."""


def measured() -> list[Row]:
    """The delay from before the call that moves to the client that has the event."""
    with stored(building()) as session:
        info = session.info
        url = f"postgresql:///{info.dbname}?host={info.host}&port={info.port}&user={info.user}"
        with semmap.connect(url) as db:
            faces: dict[str, Follow] = {
                "a client in Python (Map.subscribe)": subscribed,
                "a client of HTTP (server-sent events)": streamed,
                "a client of MCP (a resource)": partial(listened, url),
            }
            if ROS_PYTHON:
                faces["a node of ROS 2 (markers)"] = partial(marked, url)
            return [*(_row(name, db, by) for name, by in faces.items()), *_viewer_rows(db)]


@contextmanager
def subscribed(db: semmap.Database, hear: Callable[[str], None]) -> Iterator[None]:
    """Call with the name of each entity that changes."""
    with db.map("building").subscribe(lambda event: hear(event.name or "")):
        yield


@contextmanager
def streamed(db: semmap.Database, hear: Callable[[str], None]) -> Iterator[None]:
    """Call with the name of each entity that changes."""
    ready = threading.Event()

    def follow(url: str) -> None:
        at = f"{url}/maps/building/events"
        with suppress(httpx.RemoteProtocolError), httpx.stream("GET", at, timeout=60) as events:
            for line in events.iter_lines():  # until the server stops
                ready.set()
                if line.startswith("data: "):
                    hear(json.loads(line[6:])["name"])

    with served(db) as url:
        threading.Thread(target=follow, args=(url,), daemon=True).start()
        ready.wait()
        yield


@contextmanager
def listened(url: str, _: semmap.Database, hear: Callable[[str], None]) -> Iterator[None]:
    """Call with the name of each entity whose resource a client in another process hears of."""
    uris = {f"semmap://entities/{name}": name for name in {*map(_name, range(MOVES))}}
    words = ["--db", url, "mcp", "--map", "building"]
    ready = threading.Event()

    async def follow() -> None:
        server = StdioServerParameters(command=str(SEMMAP), args=words)
        async with (
            Client(stdio_client(server)) as client,
            client.listen(resource_subscriptions=[*uris]) as heard,
        ):
            ready.set()
            async for event in heard:
                if isinstance(event, ResourceUpdated):
                    hear(uris[event.uri])

    with start_blocking_portal() as portal:
        following = portal.start_task_soon(follow)
        ready.wait()
        yield
        following.cancel()


@contextmanager
def marked(url: str, _: semmap.Database, hear: Callable[[str], None]) -> Iterator[None]:
    """Call with the name of each object whose marker comes to a node in another process."""
    values = {"url": url, "map": "building"}
    ready, environment = threading.Event(), new_environment()
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:  # JSON is YAML
        file.write(json.dumps({"/semmap": {"ros__parameters": values}}))
        file.flush()
        words = [ROS_PYTHON, "-m", "semmap_ros", "--ros-args", "--params-file", file.name]
        with run([ROS_PYTHON, "-c", MARKED], environment) as peer, run(words, environment):

            def follow() -> None:
                assert peer.stdout is not None
                for line in peer.stdout:
                    ready.set()
                    hear(line.strip())

            thread = threading.Thread(target=follow, daemon=True)
            thread.start()
            ready.wait()
            yield
        thread.join()


MARKED = """
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.qos import DurabilityPolicy, QoSProfile
from visualization_msgs.msg import MarkerArray

def hear(message):
    for name in [m.text for m in message.markers] if len(message.markers) < 100 else [""]:
        print(name, flush=True)

rclpy.init()
node = rclpy.create_node("peer")
latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
node.create_subscription(MarkerArray, "/semmap/markers", hear, latched)
try:
    rclpy.spin(node)
except (KeyboardInterrupt, ExternalShutdownException):
    pass
"""
"""Prints the names in each message, and an empty line for one that has all objects."""


def _row(name: str, db: semmap.Database, by: Follow) -> Row:
    heard: SimpleQueue[str] = SimpleQueue()
    took = []
    with by(db, heard.put):
        for moved, began in _moves(db):
            while heard.get(timeout=20) != moved:
                pass
            took.append(time.time() - began)
    return _told(name, took)


def _moves(db: semmap.Database) -> Iterator[tuple[str, float]]:
    """Move cups; yields the name of each, and when the call began."""
    for number in range(MOVES):
        cup = db.map("building")[_name(number)]
        assert cup.pose is not None
        x, y, z = cup.pose[:3]
        began = time.time()
        cup.move_to(x + 0.01, y, z)
        yield cup.name, began


def _name(number: int) -> str:
    return f"cup{number % 100}_3_{number % 9}"


def _told(name: str, took: list[float]) -> Row:
    middle, late = 1e3 * np.percentile(took, (50, 99))
    shown = f"{middle:.1f} ms, 99 of 100 in {late:.1f} ms"
    return Row(name, shown, "", f"99 of 100 in {LIMIT} ms", bool(late <= LIMIT))


def _viewer_rows(db: semmap.Database) -> Iterator[Row]:
    """The page of the viewer in Chromium; its drawing, by software here, is not measured."""
    with served(db) as url, chromium() as browser:
        page = browser.new_page(viewport=SIZE)
        began = time.time()
        open_viewer(page, f"{url}/view/?map=building")
        took = time.time() - began
        yield Row("the viewer, opened", f"{took:.1f} s", "", f"{OPENED} s", took <= OPENED)
        page.evaluate(HEARING)
        begun = dict(_moves(db))  # the last move of each cup
        heard: dict[str, float] = {}
        while len(heard) < len(begun):
            page.wait_for_timeout(100)
            heard = dict(page.evaluate("window.heard"))
        yield _told(
            "the viewer, until it has the new place",
            [heard[name] / 1e3 - begun[name] for name in begun],
        )


HEARING = """
() => {
    const { house } = semmap, hear = house.hear.bind(house);
    window.heard = [];
    semmap.stage.renderer.render = () => {};
    house.hear = (event) => {
        const done = hear(event);
        heard.push([event.name, performance.timeOrigin + performance.now()]);
        return done;
    };
}
"""
"""Notes when the page has taken each event."""


def main() -> None:
    """Print the table."""
    print_rows("A move of one of 10,000 objects, until it is heard of", measured())


if __name__ == "__main__":
    main()
