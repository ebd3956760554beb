"""Work: counted in units that no machine changes, and shared among processes."""
