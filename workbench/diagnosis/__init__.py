"""From recordings to a better model: refit, locate, name, model, prove."""
