"""File formats of recordings: one object per format."""
