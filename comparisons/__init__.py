"""Runs beside truths and beside each other. A run is called by what there is of it:

``variants.Variant``                    an engine with settings, over a ladder of steps or tolerances
``campaigns.measurement.PlannedRun``    a variant at one step on a scene, before it is run
``engines.isolation.Job``, ``Outcome``  what a child process is given to run, and what became of it
``variants.Record``                     a run with its trajectory, by which a validation compares
``campaigns.measurement.Row``           a run with its numbers, each a ``Metric``, and without its trajectory: what a history keeps
"""
