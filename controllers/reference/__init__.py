"""What is made of a reference before it is followed: planned moves, its way over a horizon."""
