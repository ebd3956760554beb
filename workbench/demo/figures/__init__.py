"""Plots of the demonstration."""
