"""Random scenes, and what the reference is held to on them."""
