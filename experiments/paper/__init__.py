"""The paper's tables, figures and claims, asked again: one item, one question, one answer."""
