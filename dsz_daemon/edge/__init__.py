"""The only floor that touches the world: buses, logs, clocks, files."""
