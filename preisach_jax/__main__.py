"""Run the command line: `python -m preisach_jax` does what `preisach` does."""

from preisach_jax.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
