"""Parameters from recordings: filter, prediction errors, priors, refits, free runs."""
