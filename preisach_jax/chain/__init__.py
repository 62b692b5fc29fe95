"""The signal chain: input effects, Preisach operator, weight, output, added and sensor effects."""
