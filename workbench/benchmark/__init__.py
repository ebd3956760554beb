"""Every family of controllers on the full plant: cases, variations, figures, table and page."""
