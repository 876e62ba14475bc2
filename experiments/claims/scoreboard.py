"""Rows of results into verdicts on the paper's claims: a row for each hypothesis and source.

A hypothesis is a conjunction of parts. That it holds is an intersection-union test: its p-value is
the largest of the parts' (Berger, 1982), so of several opponents it is the strongest that counts.
That it is contradicted, in one part at least, is Simes' test of all parts. The p-value is
two-sided, twice the smaller of the two, and corrected for the number of hypotheses by Holm, of each
source by itself: a column of verdicts is one reading of the whole paper, and whether there are
recordings changes nothing of what simulation says.
"""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table
from scipy import stats

from experiments.claims.evidence import RESAMPLES, Evidence, evidence, evidence_of_recordings
from experiments.claims.hypotheses import SOURCES, Hypothesis, Part, Source, load, parts_of
from experiments.estimates import RECORDED, Where, by_scenario, chosen, paired
from experiments.statistics import SIGNIFICANCE, holm, mean_interval

HOLDS = "holds"
DOES_NOT_HOLD = "does not hold"
CONTRADICTED = "contradicted"
UNTESTABLE = "cannot be tested here"
VERDICTS = (HOLDS, DOES_NOT_HOLD, CONTRADICTED, UNTESTABLE)

_STYLES = {HOLDS: "[green]", DOES_NOT_HOLD: "[yellow]", CONTRADICTED: "[red]", UNTESTABLE: "[dim]"}

SCOREBOARD = {
    "id": pl.String,
    "source": pl.String,
    "verdict": pl.String,
    "reason": pl.String,
    "claim": pl.String,
    "place": pl.String,
    "metric": pl.String,
    "unit": pl.String,
    "better": pl.String,
    "measure": pl.String,
    "limit": pl.Float64,
    "paper": pl.Float64,
    "effect": pl.Float64,
    "low": pl.Float64,
    "high": pl.Float64,
    "p": pl.Float64,
    "p_holm": pl.Float64,
    "n": pl.Int64,
    "scenarios": pl.Int64,
    "scenarios_for": pl.Int64,
    "scenarios_against": pl.Int64,
    "parts": pl.Int64,
    "where": pl.String,
    "against": pl.String,
    "than": pl.String,
    "than_against": pl.String,
    "note": pl.String,
}
"""Columns of the verdicts. reason: why it cannot be tested, else null. claim: the paper's sentence.
effect: of one part of the conjunction, the one that `where`, `against`, `than` and `than_against`
name (JSON, `experiments.claims.hypotheses.Part`): where it is contradicted the one that does so
most surely, else the least favourable. low, high: its 95 % interval, not corrected; null on a side
that nothing bounds. p, p_holm: of all parts. scenarios_for, scenarios_against: in how many
scenarios this part's effect is beyond the limit, and short of it, by Student's t over their seeds
alone: for context. parts: of the conjunction."""


@dataclass(frozen=True)
class Trial:
    """A hypothesis on the rows of a source. values, found: the pairs of each part and the evidence
    they give; reason: why there is none."""

    claim: Hypothesis
    source: Source
    parts: Sequence[Part] = ()
    values: Sequence[pl.DataFrame] = ()
    found: Sequence[Evidence] = ()
    reason: str | None = None

    @property
    def holds(self) -> float:
        """p-value of the claim against "one part does not hold"."""
        return max(self._towards(one) for one in self.found)

    @property
    def contradicted(self) -> float:
        """p-value of "one part is reversed" against "all hold": Simes', the smallest p-value of the
        parts adjusted as for the false discovery rate."""
        return float(stats.false_discovery_control([self._away(one) for one in self.found]).min())

    @property
    def p(self) -> float:
        """Two-sided."""
        return min(1.0, 2 * min(self.holds, self.contradicted))

    def verdict(self, corrected: float) -> str:
        """By the corrected p-value."""
        if corrected > SIGNIFICANCE:
            return DOES_NOT_HOLD
        return HOLDS if self.holds <= self.contradicted else CONTRADICTED

    def shown(self, verdict: str) -> int:
        """Which part speaks for all."""
        if verdict == CONTRADICTED:
            return int(np.argmin([self._away(one) for one in self.found]))
        return int(np.argmin([self.sign * one.effect for one in self.found]))

    @property
    def sign(self) -> int:
        """Of a favourable effect."""
        return 1 if self.claim.better == "higher" else -1

    def _towards(self, one: Evidence) -> float:
        return one.above if self.claim.better == "higher" else one.below

    def _away(self, one: Evidence) -> float:
        return one.below if self.claim.better == "higher" else one.above


def judge(
    rows: pl.DataFrame,
    hypotheses: Sequence[Hypothesis] | None = None,
    resamples: int = RESAMPLES,
) -> pl.DataFrame:
    """The verdicts on hypotheses, the paper's if none are given, with the columns `SCOREBOARD`.

    rows: with the columns `experiments.jobs.ROWS`.
    """
    known = load() if hypotheses is None else hypotheses
    by_source = [[trial(rows, claim, source, resamples) for claim in known] for source in SOURCES]
    lines = [
        _line(one, corrected)
        for tests in by_source
        for one, corrected in zip(tests, _corrected(tests), strict=True)
    ]
    order = {claim.id: place for place, claim in enumerate(known)}
    return pl.DataFrame(sorted(lines, key=lambda line: order[line["id"]]), schema=SCOREBOARD)


def trial(
    rows: pl.DataFrame, claim: Hypothesis, source: Source, resamples: int = RESAMPLES
) -> Trial:
    """Test a hypothesis on the rows of a source, or tell why it cannot be."""
    asked = parts_of(claim, source)
    if not asked:
        return Trial(claim, source, reason=getattr(claim, source).untestable)
    study = asked[0].where["study"]
    own = rows.filter(study=study, metric=claim.metric)
    pairs, found = [], []
    for part in asked:
        values = values_of(own, part, claim.measure)
        if values.is_empty():
            return Trial(claim, source, reason=f"no rows: {_told(part)}")
        if values.select("scenario", "seed").is_duplicated().any():
            return Trial(claim, source, reason=f"several rows of one seed: {_told(part)}")
        one = _evidence(values, study, claim.measure, claim.threshold, resamples)
        if np.isnan(one.above):
            return Trial(claim, source, reason=f"one value alone: {_told(part)}")
        pairs.append(values)
        found.append(one)
    return Trial(claim, source, asked, pairs, found)


def values_of(rows: pl.DataFrame, part: Part, measure: str) -> pl.DataFrame:
    """scenario, seed and value of a part: paired differences, of logarithms for a ratio."""
    if measure == "ratio":
        rows = rows.filter(pl.col("value") > 0).with_columns(pl.col("value").log())
    values = _contrast(rows, part.where, part.against)
    if part.than is not None:
        other = _contrast(rows, {**part.where, **part.than}, part.than_against)
        both = values.join(other, on=["scenario", "seed"], suffix="_than", nulls_equal=True)
        values = both.select("scenario", "seed", pl.col("value") - pl.col("value_than"))
    # Jobs that overlap have the same row each.
    return values.unique()


def again(rows: pl.DataFrame, line: Mapping[str, Any]) -> Evidence:
    """The evidence of the part that a line of the verdicts shows, from the rows that it names."""
    where: Where = json.loads(line["where"])
    also = ("against", "than", "than_against")
    part = Part(where, *(None if line[name] is None else json.loads(line[name]) for name in also))
    values = values_of(rows, part, line["measure"])
    return _evidence(values, where["study"], line["measure"], line["limit"], RESAMPLES)


def counts(board: pl.DataFrame) -> str:
    """How often each verdict is given, by source, in one line."""
    told = []
    for source in SOURCES:
        number = Counter(board.filter(source=source)["verdict"])
        told.append(f"{source}: " + ", ".join(f"{one} {number[one]}" for one in VERDICTS))
    return "; ".join(told)


def table(board: pl.DataFrame) -> Table:
    """The verdicts for a terminal: a line for each hypothesis, the sources side by side."""
    drawn = Table(
        title="Claims: verdict, effect and its 95 % interval in the least favourable part",
        title_justify="left",
        caption=counts(board),
        caption_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    drawn.add_column("claim", no_wrap=True)
    drawn.add_column("of", no_wrap=True)
    drawn.add_column("paper", justify="right")
    for source in SOURCES:
        drawn.add_column(source)
    for (name,), own in board.group_by("id", maintain_order=True):
        lines = {line["source"]: line for line in own.to_dicts()}
        first = lines[SOURCES[0]]
        paper = "" if first["paper"] is None else f"{first['paper']:g}"
        verdicts = (_told_verdict(lines[source]) for source in SOURCES)
        drawn.add_row(escape(str(name)), escape(_measured(first)), paper, *verdicts)
    return drawn


def _measured(line: Mapping[str, Any]) -> str:
    """The metric with its unit, and the limit if it is not that of no effect."""
    unit = f" [{line['unit']}]" if line["unit"] else ""
    beyond = ">" if line["better"] == "higher" else "<"
    limit = f" {beyond} {line['limit']:g}" if line["limit"] not in (0.0, 1.0) else ""
    return f"{line['metric']}{unit}{limit}"


def _told_verdict(line: Mapping[str, Any]) -> str:
    """The verdict and the effect with its interval."""
    verdict = f"{_STYLES[line['verdict']]}{line['verdict']}[/]"
    if line["effect"] is None:
        return verdict
    low, high = ("–" if line[end] is None else f"{line[end]:.2g}" for end in ("low", "high"))
    return f"{verdict} {line['effect']:.2g} ({low}, {high})"


def _contrast(rows: pl.DataFrame, where: Where, against: Where | None) -> pl.DataFrame:
    """scenario, seed and value of some rows, or of their paired differences."""
    return chosen(rows, where) if against is None else paired(rows, where, against)


def _evidence(
    values: pl.DataFrame, study: str, measure: str, limit: float, resamples: int
) -> Evidence:
    """Of a ratio, tested by its logarithm, back as a ratio."""
    scaled = _scaled(measure, limit)
    recorded = study == RECORDED
    found = (
        evidence_of_recordings(values, scaled) if recorded else evidence(values, scaled, resamples)
    )
    if measure != "ratio":
        return found
    effect, low, high = (float(value) for value in np.exp([found.effect, found.low, found.high]))
    return replace(found, effect=effect, low=low, high=high)


def _scaled(measure: str, value: float) -> float:
    """As it is tested: the logarithm of a ratio."""
    return float(np.log(value)) if measure == "ratio" else value


def _told(part: Part) -> str:
    """The rows of a part in a few words."""
    also = [of for of in (part.against, part.than, part.than_against) if of]
    return " less ".join(json.dumps(dict(of)) for of in (part.where, *also))


def _corrected(tests: Sequence[Trial]) -> list[float]:
    """Holm's p-values of the tests of a source; NaN for what could not be tested."""
    possible = [place for place, one in enumerate(tests) if one.reason is None]
    corrected = np.full(len(tests), np.nan)
    corrected[possible] = holm([tests[place].p for place in possible])
    return [float(value) for value in corrected]


def _line(test: Trial, corrected: float) -> dict[str, Any]:
    """A row of the verdicts."""
    claim = test.claim
    told = ("id", "place", "metric", "unit", "better", "measure", "paper", "note")
    line = {name: getattr(claim, name) for name in told}
    line |= {"source": test.source, "claim": claim.quote, "limit": claim.threshold}
    if test.reason is not None:
        return {**line, "verdict": UNTESTABLE, "reason": test.reason}
    verdict = test.verdict(corrected)
    place = test.shown(verdict)
    part, one = test.parts[place], test.found[place]
    for name in ("effect", "low", "high"):
        line[name] = getattr(one, name) if np.isfinite(getattr(one, name)) else None
    for name in ("where", "against", "than", "than_against"):
        chosen_rows = getattr(part, name)
        line[name] = None if chosen_rows is None else json.dumps(dict(chosen_rows))
    line |= {"verdict": verdict, "p": test.p, "p_holm": corrected, "parts": len(test.parts)}
    line |= {"n": one.n, "scenarios": one.scenarios}
    if test.source == "synthetic":
        line |= _alone(test, test.values[place])
    return line


def _alone(test: Trial, values: pl.DataFrame) -> dict[str, int]:
    """In how many scenarios an effect is beyond the limit by itself, and short of it."""
    limit = _scaled(test.claim.measure, test.claim.threshold)
    intervals = [mean_interval(test.sign * (own - limit)) for own in by_scenario(values)]
    return {
        "scenarios_for": sum(interval.low > 0 for interval in intervals),
        "scenarios_against": sum(interval.high < 0 for interval in intervals),
    }
