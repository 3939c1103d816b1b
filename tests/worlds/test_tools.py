"""The small house as tools of the Model Context Protocol, for a client in another process."""

from __future__ import annotations

import base64
import inspect
import sys
from collections.abc import Awaitable, Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import anyio
import pytest
import shapely
from mcp import StdioServerParameters
from mcp.client import Client
from mcp.client.stdio import stdio_client
from PIL import Image
from sqlalchemy import Engine

import semmap
from semmap.api.operations import OPERATIONS, TOOLS
from semmap.server.calls import OperationCall

SEMMAP = Path(sys.executable).with_name("semmap")
CHANGING = {each.method for each in OPERATIONS if each.right in ("robot", "admin")}


def dialogue(url: str, talk: Callable[[Client], Awaitable[None]], *options: str) -> None:
    """Let a client talk to `semmap mcp` on the house."""
    words = ["--db", url, "mcp", "--map", "house", *options]

    async def main() -> None:
        with anyio.fail_after(120):
            async with Client(
                stdio_client(StdioServerParameters(command=str(SEMMAP), args=words))
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
        assert sum(row["probability"] for row in believed if isinstance(row, dict)) <= 1 + 1e-9
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
        assert ended["state"] == "done"

    dialogue(url, talk, "--write")


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
