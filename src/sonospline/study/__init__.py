"""The models against finite elements, as in the paper and beyond: tuning, errors, times, claims."""
