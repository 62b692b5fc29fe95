"""What effects do, compiled as in models: an eager call compiles each of its operations alone."""

import equinox as eqx
import jax.numpy as jnp

from preisach_jax.effects.base import Signals


def arrays(values):
    """Values as arrays, so that what is compiled for some serves for others."""
    return {name: jnp.asarray(value, float) for name, value in values.items()}


def signals(time, values, aux=None):
    """What drives a model."""
    columns = {name: jnp.asarray(column, float) for name, column in (aux or {}).items()}
    return Signals(jnp.asarray(time, float), jnp.asarray(values, float), columns)


def _compiled(method):
    """What an effect at some values does with some arguments."""
    run = eqx.filter_jit(lambda effect, values, *given: method(effect.at(values), *given))
    return lambda effect, values, *given: run(effect, arrays(values), *given)


def applied(effect, values, time, course):
    """The effect on a signal."""
    return _applied(effect, values, jnp.asarray(course, float), jnp.asarray(time, float))


def _inside(acting, drives):
    if acting.feeds_back:
        return acting.fed_back(drives.input, jnp.cos(drives.input), drives.time)
    return acting.widening(drives.input, drives.time)


_applied = _compiled(lambda acting, course, time: acting.apply(course, time))
columns = _compiled(lambda acting, drives: acting.columns(drives))
"""The columns of an added effect."""
factor = _compiled(lambda acting, drives: acting.factor(drives))
"""The factor of an effect on the weights."""
inside = _compiled(_inside)
"""What an effect inside the hysteresis adds to the thresholds, or makes of the path.

What is fed back is the cosine of the path.
"""
