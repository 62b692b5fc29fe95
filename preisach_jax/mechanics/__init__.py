"""A hysteresis inside mechanics: a mass on a spring whose restoring force depends on its past."""
