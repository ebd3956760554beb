"""H-infinity control: the synthesis, and the controller that is scheduled around it."""
