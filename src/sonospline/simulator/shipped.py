"""Names of the scenes that come with the package."""

SHIPPED = ("kidney", "gel", "cube")
