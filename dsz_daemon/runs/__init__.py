"""Live, replay, simulate and the demonstration: short shells round ONE loop."""
