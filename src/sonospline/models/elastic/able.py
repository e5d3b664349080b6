"""What the elastic model can do, in the words of the contract."""

ABLE = frozenset({"forces", "time", "labels", "several needles"})
