"""First models of the foreign machines, as a newcomer would write them."""
