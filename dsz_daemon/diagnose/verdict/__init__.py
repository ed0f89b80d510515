"""What is said: causes and their numbers, what can't be told apart or tested, and how well it fits then."""
