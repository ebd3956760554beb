"""How fast the workbench is: ratios measured in one run, next to other ways of doing the same."""
