"""Which effects are there: screened, really fitted, held against each other, and kept or left."""
