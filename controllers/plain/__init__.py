"""Controllers of one output by one command, for any linear model: nothing is known of an arm."""
