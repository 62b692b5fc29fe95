"""The command line: `preisach COMMAND ...`.

Little is imported here, so that an interruption finds `main` at work even while the rest is still
being loaded.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from preisach_jax.cli.process import INTERRUPTED, MESSAGE, leave, listen, stop_listening

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    is_process = arguments is None
    try:
        if is_process:
            listen()
        from preisach_jax.cli.application import run

        code = run(sys.argv[1:] if arguments is None else list(arguments))
    except KeyboardInterrupt:
        if is_process:
            stop_listening()
        sys.stderr.write(MESSAGE)
        code = INTERRUPTED
    if is_process and code == INTERRUPTED:
        leave(code)  # else the process would wait for the threads that compute
    return code
