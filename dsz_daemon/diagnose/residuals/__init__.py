"""Recording less simulation: which rows count, how much is left, where, and what of it is noise."""
