"""The memory of what is done tile by tile, where nobody says how much."""

DEFAULT_MEMORY = "4GiB"
"""For samples and maps; the program and its libraries come on top."""
