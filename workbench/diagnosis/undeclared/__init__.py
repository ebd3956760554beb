"""What a plant does not declare, taken from its recordings."""
