"""The items of the paper by name."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from experiments.paper import regime_figure, regime_tables, regimes
from experiments.paper.item import Answer, Item, Options, Progress


def _regimes(options: Options) -> Callable[[Progress], Answer]:
    plan = regimes.Plan(
        seeds=options.seeds or regimes.SEEDS,
        noises=tuple(map(regimes.Noise.parse, options.noises or regimes.NOISES)),
        filters=options.filters or regimes.FILTERS,
    )
    for name in plan.filters:
        regimes.named(name)

    def work(progress: Progress) -> Answer:
        results = regimes.run(plan, progress)
        return Answer(
            results.rows,
            results.differences,
            tables=lambda: regime_tables.tables(results),
            figure=lambda: regime_figure.figure(results),
        )

    return work


_ALL = (
    Item(
        "regimes",
        "in which motion regimes does MD drift less in a gap than CA and IMM, with nothing else"
        " in play?",
        "the paper's claim that MD-KF consistently outperforms; its Occlusion Analysis",
        _regimes,
    ),
)

ITEMS: Mapping[str, Item] = MappingProxyType({item.id: item for item in _ALL})
