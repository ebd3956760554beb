"""Small dense quadratic programs: a solver in C, and those of CasADi."""
