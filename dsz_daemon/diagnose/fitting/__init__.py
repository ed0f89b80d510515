"""One model fitted to one drive, and what it gains on blocks that it has not seen."""
