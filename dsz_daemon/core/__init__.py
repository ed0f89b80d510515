"""Pure mathematics: the paper, equation by equation."""
