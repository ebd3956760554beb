"""Nonlinear model-predictive control by real-time iteration."""
