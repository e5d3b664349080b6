"""The models against finite elements, and the library against its peers: errors, tuning, times, claims."""
