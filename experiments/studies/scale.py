"""How much is run: a few seeds for a first look, or as many as the claims need."""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Scale:
    """worlds: seeds of each simulated scenario. scenes: seeds of a single scene. monte_carlo: seeds
    of what is drawn in closed form. rounds: of what is timed."""

    name: str
    worlds: int
    scenes: int
    monte_carlo: int
    rounds: int

    def with_seeds(self, seeds: int) -> "Scale":
        """As many seeds everywhere; rounds stay."""
        name = f"{seeds} seed{'s' * (seeds != 1)}"
        return replace(self, name=name, worlds=seeds, scenes=seeds, monte_carlo=seeds)


QUICK = Scale("quick", worlds=1, scenes=12, monte_carlo=60, rounds=7)
FULL = Scale("full", worlds=12, scenes=200, monte_carlo=500, rounds=31)
SCALES = {scale.name: scale for scale in (QUICK, FULL)}
