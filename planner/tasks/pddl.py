from __future__ import annotations
from pathlib import Path
from planner.tasks.problem import Problem
def write_pddl(problem: Problem, folder: Path) -> tuple[Path, Path]:
    raise NotImplementedError
