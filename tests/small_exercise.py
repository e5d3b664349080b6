"""An exercise in the small scene, by its image alone; tests add what else they ask of it at its end, in ``[start]``."""

EXERCISE = """
name = "Block, by the image"
description = "Reach the vessel."
level = 2
scene = "small.toml"
target = "middle"
time_limit_s = 60
most_passes = 2
guides = []

[[targets]]
name = "middle"
at = [60.37, 29.61, 23.83]

[start]
u = [-30.0, -20.0]
angle = [20.0, 60.0]
"""
