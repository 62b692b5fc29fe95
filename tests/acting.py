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


def applied(effect, values, time, course):
    """The effect on a signal."""
    return _applied(effect, arrays(values), jnp.asarray(course, float), jnp.asarray(time, float))


def columns(effect, values, drives):
    """The columns of an added effect."""
    return _columns(effect, arrays(values), drives)


def factor(effect, values, drives):
    """The factor of an effect on the weights."""
    return _factor(effect, arrays(values), drives)


def inside(effect, values, drives):
    """What an effect inside the hysteresis adds to the thresholds, or makes of the path.

    What is fed back is the cosine of the path.
    """
    return _inside(effect, arrays(values), drives)


@eqx.filter_jit
def _inside(effect, values, drives):
    acting, path = effect.at(values), drives.input
    if effect.feeds_back:
        return acting.fed_back(path, jnp.cos(path), drives.time)
    return acting.widening(path, drives.time)


@eqx.filter_jit
def _applied(effect, values, course, time):
    return effect.at(values).apply(course, time)


@eqx.filter_jit
def _columns(effect, values, drives):
    return effect.at(values).columns(drives)


@eqx.filter_jit
def _factor(effect, values, drives):
    return effect.at(values).factor(drives)
