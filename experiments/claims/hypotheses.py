"""The paper's claims as hypotheses: `claims.yaml` into validated, frozen settings, and those into
the contrasts that are tested.

A hypothesis is a conjunction: its claim is of every filter, opponent and population that it lists,
and holds where all of them hold.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import Field, model_validator

from experiments.estimates import Where
from scenarios.settings import Settings, read_settings

FILE = Path(__file__).with_name("claims.yaml")

Source = Literal["synthetic", "recorded"]
SOURCES: tuple[Source, ...] = get_args(Source)

Text = Annotated[str, Field(min_length=1)]


class ClaimsError(ValueError):
    """A file of claims that cannot be used; the message is one line."""


class Rows(Settings):
    """Which rows of results a claim is tested on: the columns of `experiments.jobs.ROWS`, of which
    an empty one is not asked for; or why there are none."""

    study: Text | None = None
    scenario: list[Text] = Field(default_factory=list)
    detector: list[Text] = Field(default_factory=list)
    occlusion: list[Text] = Field(default_factory=list)
    bin: list[Text] = Field(default_factory=list)
    untestable: Text | None = None

    @model_validator(mode="after")
    def _one_or_the_other(self) -> "Rows":
        if (self.study is None) == (self.untestable is None):
            raise ValueError("expected either study or untestable")
        return self

    def every(self) -> Iterator[dict[str, str]]:
        """Each combination of what is listed."""
        columns = ("scenario", "detector", "occlusion", "bin")
        listed = {name: getattr(self, name) for name in columns if getattr(self, name)}
        for values in product(*listed.values()):
            yield {"study": str(self.study), **dict(zip(listed, values, strict=True))}


class Than(Settings):
    """What an effect is larger than: the same effect with these in place of its own. against: as
    many as the contrast has, one for each."""

    filter: Text = ""
    against: list[Text] = Field(default_factory=list)
    occlusion: Text = ""
    bin: Text = ""

    def columns(self) -> dict[str, str]:
        """The columns that are replaced on both sides."""
        return {name: getattr(self, name) for name in ("occlusion", "bin") if getattr(self, name)}


class Contrast(Settings):
    """A filter against each of its opponents; without any, its own value. also: opponents that
    the paper does not compare with there (`asked`)."""

    filter: Text
    against: list[Text] = Field(default_factory=list)
    also: list[Text] = Field(default_factory=list)
    than: Than = Than()

    @model_validator(mode="after")
    def _as_many(self) -> "Contrast":
        if self.also and self.than.filter:
            raise ValueError("expected no also where than.filter is given")
        if self.than.against and len(self.than.against) != len(self.against):
            raise ValueError("expected as many than.against as against")
        if bool(self.than.filter) != bool(self.than.against):
            raise ValueError("expected than.filter and than.against together")
        return self


class Hypothesis(Settings):
    """A claim: what must come out for it to hold, fixed before anything is run.

    quote, place: the paper's sentence and where it stands. measure: an effect is the difference of
    the filter's metric from the opponent's, or the ratio to it (of geometric means). limit: what
    the effect must be beyond, in the better direction: no effect, unless the paper names one that
    is worth having. paper: its own effect, of a conjunction the weakest. note: what to know of it.
    """

    id: Text
    quote: Text
    place: Text
    metric: Text
    unit: str
    better: Literal["higher", "lower"]
    contrasts: Annotated[list[Contrast], Field(min_length=1)]
    measure: Literal["difference", "ratio"] = "difference"
    limit: float | None = None
    paper: float | None = None
    note: str = ""
    synthetic: Rows
    recorded: Rows

    @property
    def threshold(self) -> float:
        """The limit; that of no effect if the paper names none."""
        return {"difference": 0.0, "ratio": 1.0}[self.measure] if self.limit is None else self.limit


class Claims(Settings):
    """All claims, each with an id of its own."""

    claims: list[Hypothesis]

    @model_validator(mode="after")
    def _ids(self) -> "Claims":
        ids = [claim.id for claim in self.claims]
        twice = sorted({name for name in ids if ids.count(name) > 1})
        if twice:
            raise ValueError(f"id {twice[0]!r} is given twice")
        return self


@dataclass(frozen=True)
class Part:
    """One contrast of a conjunction: the rows of `where`, less those with the columns of `against`
    in place; less the same of the rows with the columns of `than` in place, and `than_against`."""

    where: Where
    against: Where | None = None
    than: Where | None = None
    than_against: Where | None = None


def load(path: Path = FILE) -> tuple[Hypothesis, ...]:
    """The claims of a file, the paper's if none is given.

    Raises `ClaimsError`, one line with the file, the key and what was expected there.
    """
    claims = read_settings(path, lambda _: Claims, ClaimsError).claims
    return tuple(one for claim in claims for one in asked(claim))


def asked(claim: Hypothesis) -> Iterator[Hypothesis]:
    """The claim as the paper draws it, and, where it compares with the baseline alone, the same
    against IMM."""
    yield claim
    also = [
        contrast.model_copy(update={"against": contrast.also, "also": []})
        for contrast in claim.contrasts
        if contrast.also
    ]
    if also:
        note = "against IMM, with which the paper does not compare here"
        own = {"id": f"{claim.id}-imm", "contrasts": also, "paper": None, "note": note}
        yield claim.model_copy(update=own)


def parts_of(claim: Hypothesis, source: Source) -> list[Part]:
    """All that must hold for the claim to hold; nothing where it cannot be tested."""
    rows: Rows = getattr(claim, source)
    if rows.untestable is not None:
        return []
    return [
        part
        for where in rows.every()
        for contrast in claim.contrasts
        for part in _parts({**where, "metric": claim.metric}, contrast)
    ]


def _parts(where: Where, contrast: Contrast) -> Iterator[Part]:
    """Of each opponent."""
    than = contrast.than
    replaced: dict[str, str] = than.columns()
    if than.filter:
        replaced["filter"] = than.filter
    own = {**where, "filter": contrast.filter}
    if not contrast.against:
        yield Part(own, None, replaced or None)
    for opponent, other in zip(contrast.against, than.against or contrast.against, strict=True):
        against, than_against = {"filter": opponent}, {"filter": other}
        if replaced:
            yield Part(own, against, replaced, than_against)
        else:
            yield Part(own, against)
