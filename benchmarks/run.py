"""Run every benchmark: `python benchmarks/run.py`, or `python benchmarks/run.py sweep` for one."""

from __future__ import annotations

import sys

import export
import inverse
import page
import paper
import peers
import relays
import streaming
import sweep
import whole_process

BENCHMARKS = {
    "sweep": sweep.main,
    "streaming": streaming.main,
    "relays": relays.main,
    "export": export.main,
    "inverse": inverse.main,
    "page": page.main,
    "paper": paper.main,
    "peers": peers.main,
    "whole_process": whole_process.main,
}


def main() -> None:
    """Run the benchmarks that were named, or all."""
    chosen = sys.argv[1:] or list(BENCHMARKS)
    if unknown := set(chosen) - set(BENCHMARKS):
        sys.exit(f"there is no benchmark {', '.join(unknown)}: choose from {', '.join(BENCHMARKS)}")
    for name in chosen:
        BENCHMARKS[name]()


if __name__ == "__main__":
    main()
