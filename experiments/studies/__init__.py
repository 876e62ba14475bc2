"""Questions into jobs, and those into rows of results: what is run, whoever shows it."""
