"""What the instruments would show if the simulation were right, with any of the effects in it."""
