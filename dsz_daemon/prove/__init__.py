"""The proof: recordings whose truth is sealed, diagnosed by a process that sees no truth, opened and scored."""
