"""A recording as arrays: on one grid, filtered alike, with what rounding and a sensor's end leave of it."""
