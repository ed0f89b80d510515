"""Simulation against recording: where they part, what physics was left out, and how well that explains it."""
