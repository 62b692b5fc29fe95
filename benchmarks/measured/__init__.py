"""A scoreboard of measured records: expectations written before, verdicts, and honest baselines."""
