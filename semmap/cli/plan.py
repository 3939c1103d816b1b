"""`semmap plan`: the actions that reach a goal."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from semmap import cli
from semmap.cli.operation_command import MethodCall, command_of
from semmap.cli.options import Json
from semmap.cli.output import print_folded
from semmap.cli.route import step_as_json

if TYPE_CHECKING:
    from planner.plan import Action, Plan
    from semmap.api.map_results import MapPlan


@command_of("Map.plan", start="--from")
def plan_command(call: MethodCall, json_: Json = False) -> None:
    """Plan a task: the actions that reach a goal in the least time."""
    plan = call()
    if json_:
        print(json.dumps(_plan_as_json(plan)))
        return
    if (folder := call.values.get("pddl")) is not None:
        print(f"{Path(folder, 'domain.pddl')}, {Path(folder, 'problem.pddl')}")
    if plan.assumed:
        from semmap.query.geometry_notes import names_note

        cli.out.print(names_note(plan.assumed, "assumed_sizes"), style="cyan")
    for reason in plan.reasons:
        cli.out.print(reason, style="cyan")
    _show_plan(plan)


def _plan_as_json(plan: MapPlan) -> dict[str, Any]:
    """The plan as plain values; poses as x, y, z and quaternion."""
    return {
        "goal": plan.goal,
        "seconds": plan.seconds,
        "bound": plan.bound,
        "optimal": plan.optimal,
        "assumed_sizes": [*plan.assumed],
        "actions": [_action_as_json(action) for action in plan.actions],
    }


def _action_as_json(action: Action) -> dict[str, Any]:
    return {
        "name": action.name,
        "arguments": list(action.arguments),
        "entities": list(action.names),
        "seconds": action.seconds,
        "at": None if action.at is None else action.at._asdict(),
        "steps": [
            step_as_json(step) | {"seconds": step.seconds, "map": step.map} for step in action.steps
        ],
    }


def _show_plan(plan: Plan) -> None:
    """Print a plan as Figure 4 does, with durations."""
    if plan.actions:
        lines = [(str(n), str(a), f"{a.seconds:.1f}") for n, a in enumerate(plan.actions, 1)]
        print_folded(("", "action", "seconds"), lines, right=("", "seconds"))
    proof = f"at most {plan.gap:.0%} longer than the lower bound of {plan.bound:.1f} s"
    if plan.optimal:
        proof = "no plan is shorter"
    took = f"{plan.seconds:.1f} s" if plan.actions else "nothing to do, the goal is reached"
    print(f"{plan.goal}: {took} ({proof})")
