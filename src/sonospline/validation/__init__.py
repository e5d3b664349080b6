"""The model against finite elements: insertions, errors, tuning, baselines and readings of the paper."""
