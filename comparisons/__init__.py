"""Comparison of runs with truths and with each other.

These classes describe a run, in the order in which they are used:

``bench.variants.Variant``              an engine with settings, over steps or tolerances
``bench.planned_runs.PlannedRun``       one step of a variant on a scene, before the run
``engines.isolation.Job``, ``Outcome``  the work of a child process, and its result
``bench.variants.Record``               a run with its trajectory, for `stiction validate` and `stiction compare`
``bench.planned_runs.Row``              a run with numbers (``Metric``) instead of its trajectory, for nightly runs
"""
