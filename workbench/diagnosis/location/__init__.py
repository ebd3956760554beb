"""Where a mismatch sits: unknown inputs, and what the sensors could tell apart."""
