"""The vocabulary: what may have been left out, one row each; read this first."""
