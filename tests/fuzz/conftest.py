collect_ignore = ["test_poisoning.py"]  # minutes long; `python tests/fuzz/poisoning.py` prints it
