"""Runs compared with truths and with each other.

The stages of a run are

``bench.variants.Variant``              an engine with settings, over steps or tolerances
``bench.planned_runs.PlannedRun``       a variant with one step on a scene, before it is run
``engines.isolation.Job``, ``Outcome``  the work of a child process, and its result
``bench.variants.Record``               a run with its trajectory, which a validation compares
``bench.planned_runs.Row``              a run with its numbers, each a ``Metric``, without its trajectory, for a history
"""
