"""YAML to typed settings; every fault at once."""
