"""The simulator in a browser: protocol, connections, access and the page."""
