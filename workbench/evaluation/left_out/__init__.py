"""The paper's own physics left out of the plant, one piece after the other, on the rig's data."""
