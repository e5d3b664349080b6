"""The library against its peers and the live simulator against the clock: one timing, one list of promises."""
