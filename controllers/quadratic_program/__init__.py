"""Small dense quadratic programs: the solver in Python and the same in C."""
