"""The paper's claims: hypotheses in a file, and verdicts on them from rows of results."""
