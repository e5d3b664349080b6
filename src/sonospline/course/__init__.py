"""A lab of many stations: who sits where, what the trainer sees and sets, and results that are kept."""
