"""The small house as tools of the Model Context Protocol, for a client in another process."""

from __future__ import annotations

import base64
import inspect
import json
import sys
from collections.abc import Awaitable, Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import anyio
import pytest
import shapely
from mcp import StdioServerParameters
from mcp.client import Client
from mcp.client.stdio import stdio_client
from mcp.shared.exceptions import MCPError
from PIL import Image
from sqlalchemy import Engine

import semmap
from semmap.api.operations import OPERATIONS, TOOLS
from semmap.server.calls import OperationCall

SEMMAP = Path(sys.executable).with_name("semmap")
CHANGING = {each.method for each in OPERATIONS if each.right in ("robot", "admin")}


def dialogue(
    url: str, talk: Callable[[Client], Awaitable[None]], *options: str, **about: Any
) -> None:
    """Let a client talk to `semmap mcp` on the house."""
    words = ["--db", url, "mcp", "--map", "house", *options]

    async def main() -> None:
        with anyio.fail_after(120):
            async with Client(
                stdio_client(StdioServerParameters(command=str(SEMMAP), args=words)), **about
            ) as client:
                await talk(client)

    anyio.run(main)


@pytest.fixture(scope="module")
def url(house: Engine) -> str:
    return house.url.render_as_string(hide_password=False)


async def told(client: Client, tool: str, **arguments: Any) -> Any:
    found = await client.call_tool(tool, arguments)
    assert not found.is_error, found.content
    return found.structured_content


async def refusal(client: Client, tool: str, **arguments: Any) -> str:
    found = await client.call_tool(tool, arguments)
    assert found.is_error
    return str(found.content[0].text)  # type: ignore[union-attr]


def test_a_client_that_reads_finds_a_thing_and_the_way_to_it(url: str) -> None:
    async def talk(client: Client) -> None:
        listed = (await client.list_tools()).tools
        names = [tool.name for tool in listed]
        assert names == [m.partition(".")[2] for m in TOOLS if m not in CHANGING]
        assert all(tool.annotations and tool.annotations.read_only_hint for tool in listed)
        rooms = (await told(client, "find", type="room"))["result"]
        balls = (await told(client, "find", type="ball", limit=3))["result"]
        ball = balls[0]["name"]
        known = await told(client, "describe", name=ball)
        believed = (await told(client, "where", name=ball))["belief"]
        assert believed[0]["probability"] > 0.5
        assert (
            sum(row["probability"] for row in believed if isinstance(row, dict)) <= 1 + 1e-3
        )  # four digits each
        way = await told(client, "route", start="bedroom", goal=ball)
        with semmap.connect(url) as db:
            outlines = {room.name: room.footprint for room in db.map("house").rooms}
            place = shapely.Point(*db.map("house")[ball].pose[:2])
        (inside,) = (name for name, outline in outlines.items() if outline.contains(place))
        assert {row["name"] for row in rooms} == {*outlines}
        assert known["name"] == ball
        assert (way["from"], way["to"]) == ("bedroom", inside)
        drawn = await client.call_tool("draw", {})
        picture = Image.open(BytesIO(base64.b64decode(drawn.content[0].data)))  # type: ignore[union-attr]
        assert picture.format == "PNG"

    dialogue(url, talk)


def test_what_a_client_may_not_do_or_says_wrong_is_named(url: str) -> None:
    async def talk(client: Client) -> None:
        assert "no tool observe: there are find, " in await refusal(client, "observe", name="x")
        assert "no argument colour" in await refusal(client, "find", colour="red")
        trial = {"goal": "in(robot, kitchen)", "try_grasps": True}
        assert "no argument try_grasps" in await refusal(client, "plan", **trial)
        assert "route needs start" in await refusal(client, "route", goal="kitchen")
        words = {"start": "kitchen", "goal": "bedroom", "robot": "../etc/robot.urdf"}
        assert "give the name of one in the map" in await refusal(client, "route", **words)
        assert "give a time of ISO 8601" in await refusal(client, "where", name="x", at="noon")
        assert "Ball" in await refusal(client, "describe", name="Bal_01_001")
        assert "limit is 'many'" in await refusal(client, "find", limit="many")
        update = "INSERT DATA { <urn:a> <urn:b> <urn:c> }"
        assert await refusal(client, "sparql", text=update)

    dialogue(url, talk)


def test_a_client_that_may_write_lets_a_robot_bring_it(url: str) -> None:
    async def talk(client: Client) -> None:
        tools = {tool.name for tool in (await client.list_tools()).tools}
        assert {"observe", "observe_point", "run"} <= tools
        (ball, *_) = (await told(client, "find", type="ball"))["result"]
        point = [*ball["position"][:2], ball["position"][2]] if "position" in ball else None
        assert point is None or len(point) == 3
        ended = await told(
            client,
            "run",
            goal=f"in(robot, {ball['room']})" if "room" in ball else "in(robot, kitchen)",
            start="bedroom",
            simulate=True,
            speed=1e5,
        )
        assert (ended["state"], ended["simulated"]) == ("done", True)
        assert "simulated" in ended["map"]

    dialogue(url, talk, "--write")


CHANGES, CHAIR = "semmap://changes", "semmap://entities/stool%201"


async def read(client: Client, uri: str) -> Any:
    found = await client.read_resource(uri)
    return json.loads(found.contents[0].text)  # type: ignore[union-attr]


@pytest.fixture(scope="module")
def db(url: str) -> Iterator[semmap.Database]:
    """The database of the house, in which there is a stool."""
    with semmap.connect(url) as db:
        db.map("house").add_object("stool 1", type="chair", size=(0.3, 0.3, 0.4), pose=(0, -2, 0))
        yield db


def test_a_client_hears_of_changes_and_reads_what_changed(url: str, db: semmap.Database) -> None:
    """By listening, as clients of 2026 do; each change is one that `Map.changes` has."""

    async def talk(client: Client) -> None:
        house = db.map("house")
        with anyio.fail_after(60):
            async with client.listen(resource_subscriptions=[CHANGES, CHAIR]) as heard:
                house["stool 1"].move_to(1.0, -2.0, 0.0)
                *_, last = (event for event in house.changes() if event.name == "stool 1")
                told = set()
                while told != {CHANGES, CHAIR}:
                    told.add((await anext(heard)).uri)
                while str(last.at) not in [e["at"] for e in await read(client, CHANGES)]:
                    await anyio.sleep(0.05)
        pose = (await read(client, CHAIR))["pose"]
        assert pose[:3] == pytest.approx([1, -2, 0])
        with pytest.raises(MCPError, match="no entity nobody"):
            await client.read_resource("semmap://entities/nobody")
        with pytest.raises(MCPError, match="no resource semmap://else"):
            await client.read_resource("semmap://else")

    dialogue(url, talk)


@pytest.mark.filterwarnings("ignore::mcp.MCPDeprecationWarning")
def test_a_client_of_2025_subscribes(url: str, db: semmap.Database) -> None:
    heard: list[str] = []

    async def hear(message: Any) -> None:
        heard.append(getattr(getattr(message, "params", None), "uri", ""))

    async def talk(client: Client) -> None:
        await client.session.subscribe_resource(CHAIR)
        stool = db.map("house")["stool 1"]
        with anyio.fail_after(60):
            while CHAIR not in heard:
                stool.move_to(1.5, -2.0, 0.0)
                await anyio.sleep(0.1)
                stool.move_to(1.0, -2.0, 0.0)
        await client.session.unsubscribe_resource(CHAIR)
        await anyio.sleep(0.5)
        count = len(heard)
        stool.move_to(1.2, -2.0, 0.0)
        await anyio.sleep(0.5)
        assert len(heard) == count

    dialogue(url, talk, message_handler=hear, mode="legacy")


def test_the_arguments_of_tools_are_those_of_the_methods() -> None:
    """The schema agrees with the signature that Python itself has of the method."""
    for operation in (each for each in OPERATIONS if each.method in TOOLS):
        call = OperationCall(operation)
        owner, _, member = operation.method.partition(".")
        found = getattr(getattr(semmap, owner), member)
        if isinstance(found, property):
            assert {*call.arguments} == {*call.required} == {"entity", "value"}
            continue
        real = dict(inspect.signature(found).parameters)
        if owner != "Map":
            real["entity"] = inspect.Parameter("entity", inspect.Parameter.KEYWORD_ONLY)
        conditions = any(p.kind is p.VAR_KEYWORD for p in real.values())
        assert conditions or {*call.arguments} <= {*real}
        needed = {n for n, p in real.items() if n != "self" and p.default is p.empty}
        assert conditions or {*call.required} == needed
        for name, schema in call.arguments.items():
            default = real[name].default if name in real else None
            assert schema.get("default") in (None, default, [*default] if default == () else None)
