"""Which effects could act on the ports of a model: one module per family of ports."""
