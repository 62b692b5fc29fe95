"""The Preisach operator: the plane, its hysterons along an input, and the output of a model."""
