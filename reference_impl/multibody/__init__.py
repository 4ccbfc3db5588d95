"""Mechanisms without friction: a scene as arrays, constraints, forces, consistent states, reactions."""
