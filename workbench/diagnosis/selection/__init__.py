"""Which effect of the library is missing: scores, refits, acceptance."""
