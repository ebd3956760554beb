"""A law without a name, where the library has none."""
