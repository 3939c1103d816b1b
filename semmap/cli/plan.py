"""`semmap plan`: the actions that reach a goal."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from semmap import cli
from semmap.cli.operation_command import MethodCall, command_of
from semmap.cli.options import Json
from semmap.cli.output import print_folded

if TYPE_CHECKING:
    from planner.plan import Plan


@command_of("Map.plan", start="--from", try_grasps="--try-grasps/--assume-grasps")
def plan_command(call: MethodCall, json_: Json = False) -> None:
    """Plan a task: the actions that reach a goal in the least time."""
    plan = call()
    if json_:
        print(json.dumps(plan.as_json()))
        return
    if (folder := call.values.get("pddl")) is not None:
        print(f"{Path(folder, 'domain.pddl')}, {Path(folder, 'problem.pddl')}")
    if plan.assumed:
        from semmap.query.geometry_notes import names_note

        cli.out.print(names_note(plan.assumed, "assumed_sizes"), style="cyan")
    for reason in plan.reasons:
        cli.out.print(reason, style="cyan")
    _show_plan(plan)
    if plan.assumed_body is not None:
        cli.out.print(plan.assumed_body, style="cyan")


def _show_plan(plan: Plan) -> None:
    """Print a plan as Figure 4 does, with durations."""
    if plan.actions:
        lines = [(str(n), str(a), f"{a.seconds:.1f}") for n, a in enumerate(plan.actions, 1)]
        print_folded(("", "action", "seconds"), lines, right=("", "seconds"))
    took = f"{plan.seconds:.1f} s" if plan.actions else "nothing to do, the goal is reached"
    print(f"{plan.goal}: {took} ({plan.proof})")
