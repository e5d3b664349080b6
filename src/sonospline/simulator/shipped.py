"""Names of the scenes that come with the package."""

SHIPPED = ("kidney", "kidney-wide", "gel", "cube")
