"""Numbers of the steady state over the parameters of a scene."""
