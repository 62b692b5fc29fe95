"""The page of the command line, from the help of each command."""

from __future__ import annotations

import io
import os
import re
from contextlib import redirect_stdout
from unittest.mock import patch

from preisach_jax.cli import main

WIDTH = "96"

HEAD = """# Command line

What `preisach COMMAND --help` says. Exit codes: 0 success, 2 a mistake of the user's (one line on
stderr), 1 a failure of the program, 130 an interruption. `PREISACH_TRACEBACK=1` shows the traceback
of a failure.
"""


def help_of(*words: str) -> str:
    """What a command prints when it is asked for help."""
    screen = io.StringIO()
    with patch.dict(os.environ, COLUMNS=WIDTH), redirect_stdout(screen):
        main([*words, "--help"])
    return screen.getvalue().strip("\n")


def commands() -> list[str]:
    """Names of the commands, in their order."""
    listed = help_of().partition("Commands:\n")[2].partition("\n\n")[0]
    return re.findall(r"^  (\w[\w-]*)", listed, re.MULTILINE)


def page() -> str:
    """The page in Markdown."""
    parts = [f"## preisach {name}\n\n```\n{help_of(name)}\n```\n" for name in commands()]
    return "\n".join([HEAD, *parts])
