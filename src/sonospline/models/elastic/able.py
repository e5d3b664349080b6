"""What the elastic model can do, in the words of the contract."""

ABLE = frozenset({"forces", "time", "labels", "several needles"})
RELAXATIONS = ("none", "tissue")
"""Whether tissue is elastic, or relaxes as its materials say."""
CONTACTS = ("pose", "track")
"""Whether the forces of a needle are those of its pose, or follow from the track that it has left in the tissue."""
