"""Methods of results whose work is done above: `preisach_jax/__init__.py` says where.

A result is data and imports nothing that shows or exports it; `fit.plot()` works all the same.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

HOOKS: dict[str, Callable[..., Any]] = {}
"""By class and method, as `"Fit.plot"`: the function that does it, called with the result."""
