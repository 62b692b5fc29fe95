"""Campaigns that try to break the package, each with its results in benchmarks/results/trust."""
