"""Controllers for any linear model: a `LinearModel` or a continuous python-control system."""
