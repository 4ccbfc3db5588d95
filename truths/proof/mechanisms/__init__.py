"""Reduced mechanisms in ball arithmetic: `sliding_mass`, `moving_guide`, `trammel` and `pendulum`.

Their interface is `mechanism`, the contact of a single slider `one_slider`; `scene_reader` reads them from a scene. The
equations are derived again, not taken from the truths: each of the two is a check of the other.
"""
