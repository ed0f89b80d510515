"""What no formula gives: the road and the air over time, by what the sensors have left over."""
