"""Reduced mechanisms in ball arithmetic: what is asked of one (`mechanism`), the contact of a single slider (`one_slider`), and
`sliding_mass`, `moving_guide`, `trammel` and `pendulum`."""
