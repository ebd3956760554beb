"""Plants written in the language of models."""

DEFAULT_PLANT = "arm"
"""Plant of a verb or study that names none."""
