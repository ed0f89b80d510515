"""The simulated car, written apart from what the estimator assumes."""
