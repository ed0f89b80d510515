"""What is connected or configured otherwise than it is said to be, which is no physics."""
