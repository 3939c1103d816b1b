"""The map as tools of the Model Context Protocol, for programs that speak for people.

See modelcontextprotocol.io. The tools are rows of the table of operations (`TOOLS`): their names,
arguments, rights and help.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

import anyio
from mcp.server import Server
from mcp.server.stdio import stdio_server
from mcp_types import (
    CallToolRequestParams,
    CallToolResult,
    ImageContent,
    ListToolsResult,
    PaginatedRequestParams,
    TextContent,
    Tool,
    ToolAnnotations,
)

from semmap.api.map import Map
from semmap.api.operations import TOOLS, Right
from semmap.draw.picture import Picture
from semmap.error import Error
from semmap.server.calls import OperationCall, offered
from semmap.server.mcp_resources import MapResources

MOST_VALUES = 20
"""The most values of a list in an answer; the rest is counted."""

INSTRUCTIONS = """\
A semantic map of a building: rooms, doors, objects, where they are, and how to get and bring them.
find lists entities, describe tells all of one, where says how probable each place of an object is,
route and plan answer how to get there and how to reach a goal such as on(mug1, desk4).
run lets a simulated robot pursue a goal in a copy: done there, nothing has moved in the map.
Places are named; metres are in the map's frame; probabilities are from 0 to 1."""


class ToolServer:
    """The tools of one map; one call at a time.

    `writable` is the map for what changes it; None: nothing does.
    """

    def __init__(self, readable: Map, writable: Map | None = None) -> None:
        self._readable, self._writable = readable, writable
        rights: tuple[Right, ...] = ("reader",)
        if writable is not None:
            rights = ("reader", "robot", "admin")
        self._calls = offered(TOOLS, rights)
        self._limiter = anyio.CapacityLimiter(1)
        self.resources = MapResources(readable, self._limiter)
        self.server: Server[Any] = Server(
            "semmap",
            version=version("semmap"),
            instructions=f"{INSTRUCTIONS}\nThe map is {readable.name}.",
            on_list_tools=self._list,
            on_call_tool=self._call,
            **self.resources.handlers,
        )

    async def _list(self, _: Any, __: PaginatedRequestParams | None) -> ListToolsResult:
        return ListToolsResult(tools=[_tool(call) for call in self._calls.values()])

    async def _call(self, _: Any, params: CallToolRequestParams) -> CallToolResult:
        call = self._calls.get(params.name)
        if call is None:
            return _refused(f"no tool {params.name}: there are {', '.join(self._calls)}")
        chosen = self._readable if call.operation.right == "reader" else self._writable
        try:
            found = await anyio.to_thread.run_sync(
                call, chosen, params.arguments or {}, limiter=self._limiter
            )
        except (Error, OSError) as error:  # of the files of a simulated world
            return _refused(str(error))
        if isinstance(found, Picture):
            data = base64.b64encode(found.png).decode()
            notes = [TextContent(text=note) for note in found.notes]
            return CallToolResult(content=[*notes, ImageContent(data=data, mime_type="image/png")])
        short = shortened(found)
        text = TextContent(text=json.dumps(short, ensure_ascii=False, allow_nan=False))
        structured = short if isinstance(short, Mapping) else {"result": short}
        return CallToolResult(content=[text], structured_content=dict(structured))


async def serve_stdio(tools: ToolServer) -> None:
    """Answer on standard input and output until the client leaves."""
    async with stdio_server() as (incoming, outgoing):
        options = tools.server.create_initialization_options()
        async with anyio.create_task_group() as tasks:
            await tasks.start(tools.resources.notify)
            await tools.server.run(incoming, outgoing, options)
            tasks.cancel_scope.cancel()


def shortened(value: Any) -> Any:
    """A plain value with the first values of each list, and how many more there are.

    Likewise of numbers by name. Numbers have four decimals, those below 1 four digits.

    >>> shortened({"rows": list(range(22))})["rows"][18:]
    [18, 19, '... 2 more']
    >>> shortened({"share": 1 / 3, "x": 456789.123456})
    {'share': 0.3333, 'x': 456789.1235}
    >>> shortened({str(number): float(number) for number in range(22)})["..."]
    '2 more'
    """
    if isinstance(value, float):
        return round(value, 4) if abs(value) >= 1 else float(f"{value:.4g}")
    if isinstance(value, dict):
        first = [*value][:MOST_VALUES]
        more = len(value) - len(first)
        if more and all(isinstance(each, float) for each in value.values()):
            return {key: shortened(value[key]) for key in first} | {"...": f"{more} more"}
        return {key: shortened(each) for key, each in value.items()}
    if not isinstance(value, list):
        return value
    more = len(value) - MOST_VALUES
    found = [shortened(each) for each in value[:MOST_VALUES]]
    return [*found, f"... {more} more"] if more > 0 else found


def _tool(call: OperationCall) -> Tool:
    reads = call.operation.right == "reader"
    return Tool(
        name=call.name,
        description=call.operation.help,
        input_schema=call.schema,
        annotations=ToolAnnotations(read_only_hint=reads, open_world_hint=False),
    )


def _refused(why: str) -> CallToolResult:
    return CallToolResult(content=[TextContent(text=why)], is_error=True)
