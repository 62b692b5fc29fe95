"""The blind benchmark: how often is `preisach_jax.diagnose` right?"""
