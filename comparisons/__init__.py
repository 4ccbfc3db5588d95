"""Runs compared with truths and with each other.

The stages of a run are

``variants.Variant``                    an engine with settings, over steps or tolerances
``campaigns.measurement.PlannedRun``    a variant with one step on a scene, before it is run
``engines.isolation.Job``, ``Outcome``  the work of a child process, and its result
``variants.Record``                     a run with its trajectory, which a validation compares
``campaigns.measurement.Row``           a run with its numbers, each a ``Metric``, without its trajectory, for a history
"""
