"""Real machines that the diagnosis starts on with the first model that comes to mind."""
