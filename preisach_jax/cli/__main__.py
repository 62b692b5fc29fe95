"""`python -m preisach_jax.cli` does what `preisach` does."""

import sys

from preisach_jax.cli import main

if __name__ == "__main__":
    sys.exit(main())
