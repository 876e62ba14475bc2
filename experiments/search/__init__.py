"""Two filters and a scenario into worst cases: where in the scenario's parameters one filter loses
most to the other, or fails, found by an optimiser and checked on seeds that it never saw."""

from experiments.search.goal import Goal
from experiments.search.plan import Plan
from experiments.search.run import Found, search
from experiments.search.space import Space

__all__ = ["Found", "Goal", "Plan", "Space", "search"]
