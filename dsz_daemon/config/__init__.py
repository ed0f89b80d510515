"""YAML to typed settings; every fault at once.

Reading order: `settings`, `vehicle`, `signal_settings`, `estimator` (what can be set);
`document` (YAML with lines), `explain` and `cross_checks` (faults in words), `load`;
`resolution` (the mapping against the DBC), `advice`, `check` (all of it, for `dsz check` and
before every run); `schema` (for editors).
"""
