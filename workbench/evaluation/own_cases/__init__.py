"""Cases made with the independent rig, on which the diagnosis is judged as a whole."""
